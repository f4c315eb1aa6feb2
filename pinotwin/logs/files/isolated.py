"""Reading in a child process: what a damaged file does to a C library ends the child, not the user's work.

One wrong byte in a MATLAB v5 file is a segmentation fault in SciPy's reader, one in an HDF5 file keeps that
library busy for ever, deaf to signals. So a forked child reads them, with a limit of memory and of time,
and hands over what it read through a pipe. The fork costs milliseconds; the numbers are copied once.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import resource
import signal
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from pinotwin.errors import LogError
from pinotwin.logs.files.content import Content, limited

SECONDS = 30.0  # for any file, and in addition
BYTES_A_SECOND = 4e6  # what the slowest of compressed files is read at
MEMORY = 2**31  # bytes for any file, and in addition
EXPANSION = 30  # times the file's own size

Loader = Callable[[Path, str], Content]


def load(loader: Loader, path: Path, source: str) -> Content:
    """Return what ``loader`` reads from a file, in a process of its own.

    Raises:
        LogError: the loader's own, or that the file ended, or held up, its reader.
    """
    size = path.stat().st_size
    seconds = SECONDS + size / BYTES_A_SECOND
    here, there = Pipe(duplex=False)
    child = os.fork()
    if child == 0:
        _read(loader, path, source, there, MEMORY + EXPANSION * size)
    there.close()
    said: Content | str | None = None
    done = False
    try:
        done = here.poll(seconds)
        with contextlib.suppress(EOFError):
            said = here.recv() if done else None
    finally:
        here.close()
        if not done:
            os.kill(child, signal.SIGKILL)
        status = os.waitpid(child, 0)[1]
    if isinstance(said, Content):
        return said
    if said is not None:
        raise LogError(said)
    why = (
        f"it ended its reader ({_said(status)})" if done else f"its reader was not done after {seconds:.0f} s"
    )
    raise LogError(f"{source}: cannot be read: {why}: the file is damaged; export it again")


def _read(loader: Loader, path: Path, source: str, there: Connection, memory: int) -> None:
    """Read, hand over and end; nothing of the parent's may run here, not even at exit."""
    code = 70
    try:
        faulthandler.disable()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        limit = _in_use() + memory
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        if hard == resource.RLIM_INFINITY or limit < hard:
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        try:
            content = loader(path, source)
            limited(source, content.numbers, path.stat().st_size)
            said: Content | str = content
        except LogError as error:
            said = str(error)
        except MemoryError:
            said = f"{source}: holds more than its size allows for: the file is damaged; export it again"
        there.send(said)
        code = 0
    finally:
        os._exit(code)


def _in_use() -> int:
    """Return the address space of this process [bytes]; 0 where the system does not say."""
    with contextlib.suppress(OSError, ValueError):
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    return 2**34


def _said(status: int) -> str:
    code = os.waitstatus_to_exitcode(status)
    return signal.Signals(-code).name if code < 0 else f"exit {code}"
