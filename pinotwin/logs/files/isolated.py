"""Reading in a child process: what a damaged file does to a C library ends the child, not the user's work.

One wrong byte in a MATLAB v5 file is a segmentation fault in SciPy's reader, one in an HDF5 file keeps that
library busy for ever, deaf to signals. So a forked child reads them, with a limit of memory and of time,
and hands over what it read through a pipe. The fork costs milliseconds; the numbers are copied once. Where there
is no fork (Windows), a new interpreter reads, with a limit of time alone.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from pathlib import Path

from pinotwin.errors import LogError
from pinotwin.logs.files.content import Content, limited

Loader = Callable[[Path, str], Content]


def load(
    loader: Loader,
    path: Path,
    source: str,
    *,
    seconds: float = 30.0,
    rate: float = 4e6,
    memory: int = 2**31,
    expansion: int = 30,
) -> Content:
    """Return what ``loader`` reads from a file, in a process of its own.

    Args:
        loader: reads it.
        path: the file.
        source: its name in messages.
        seconds: given to any file; large ones have more.
        rate: what the slowest of compressed files is read at [bytes/s].
        memory: given to any file [bytes], and ``expansion`` times its own size.
        expansion: of the most compressed.

    Raises:
        LogError: the loader's own, or that the file ended, or held up, its reader.
    """
    size = path.stat().st_size
    seconds += size / rate
    if hasattr(os, "fork"):
        said, code = _forked(loader, path, source, seconds, memory + expansion * size)
    else:
        said, code = _begun(loader, path, source, seconds)
    if isinstance(said, Content):
        return said
    if said is not None:
        raise LogError(said)
    if code is None:
        why = f"its reader was not done after {seconds:.0f} s"
    else:
        why = f"it ended its reader ({signal.Signals(-code).name if code < 0 else f'exit {code}'})"
    raise LogError(f"{source}: cannot be read: {why}: the file is damaged; export it again")


def _forked(
    loader: Loader, path: Path, source: str, seconds: float, memory: int
) -> tuple[Content | str | None, int | None]:
    """Return what a forked child read or complains of, and its exit code; None if it was not done in time."""
    here, there = Pipe(duplex=False)
    child = os.fork()
    if child == 0:
        _read(loader, path, source, there, memory)
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
    return said, os.waitstatus_to_exitcode(status) if done else None


def _read(loader: Loader, path: Path, source: str, there: Connection, memory: int) -> None:
    """Read, hand over and end; nothing of the parent's may run here, not even at exit."""
    code = 70
    try:
        faulthandler.disable()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        _limit(memory)
        there.send(_loaded(loader, path, source))
        code = 0
    finally:
        os._exit(code)


def _loaded(loader: Loader, path: Path, source: str) -> Content | str:
    try:
        content = loader(path, source)
        limited(source, content.numbers, path.stat().st_size)
        return content
    except LogError as error:
        return str(error)
    except MemoryError:
        return f"{source}: holds more than its size allows for: the file is damaged; export it again"


def _limit(memory: int) -> None:
    """Let this process have no more than so many further bytes, and leave no core file."""
    import resource

    limit = 2**34 + memory  # where the system does not say what is in use
    with contextlib.suppress(OSError, ValueError):
        limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + memory
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    if hard == resource.RLIM_INFINITY or limit < hard:
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _begun(
    loader: Loader, path: Path, source: str, seconds: float
) -> tuple[Content | str | None, int | None]:
    """Return the same of a new interpreter, whose output is what it read, as a pipe has it."""
    words = [sys.executable, "-m", __name__, loader.__module__, loader.__qualname__, str(path), source]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        done = subprocess.run(words, capture_output=True, timeout=seconds, env=environment)
    except subprocess.TimeoutExpired:
        return None, None
    said = ForkingPickler.loads(done.stdout) if done.returncode == 0 else None
    return said, done.returncode


if __name__ == "__main__":
    module, name, given, called = sys.argv[1:]
    content = _loaded(getattr(importlib.import_module(module), name), Path(given), called)
    sys.stdout.buffer.write(ForkingPickler.dumps(content))
