"""Reading in a process of its own, in limited time, and limited memory where the system tells of it (Linux).

One wrong byte is a segmentation fault in SciPy's reader of MATLAB v5, and keeps the HDF5 library busy for ever.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from pickle import HIGHEST_PROTOCOL

from pinotwin.errors import LogError
from pinotwin.logs.files.content import Content, limited

Loader = Callable[[Path, str], Content]
_ENDED = "cannot be read: {}: the file is damaged; export it again"
_TOO_LARGE = "holds more than its size allows for: the file is damaged; export it again"


def load(
    loader: Loader,
    path: Path,
    source: str,
    *,
    seconds: float = 30.0,
    rate: float = 4e6,
    memory: int = 3 * 2**29,
    expansion: int = 30,
) -> Content:
    """Return what ``loader`` reads from a file in a process of its own; LogError, its own or why it did not end well.

    Any file has some ``seconds``, and one more for so many bytes as ``rate`` says, that of the slowest compressed ones;
    ``memory`` [bytes], and ``expansion`` times its own size.
    """
    size = path.stat().st_size
    seconds += size / rate
    words = [sys.executable, "-P", "-m", __name__, loader.__module__, loader.__qualname__, str(path), source]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    end, content = time.monotonic() + seconds, b""
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment) as job:
        try:
            while job.returncode is None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    content, _ = job.communicate(timeout=0.05)
                    continue
                if time.monotonic() > end:
                    said = f"its reader was not done after {seconds:.0f} s"
                    raise LogError(f"{source}: {_ENDED.format(said)}")
                if _resident(job.pid) > memory + expansion * size:
                    raise LogError(f"{source}: {_TOO_LARGE}")
        finally:
            job.kill()
    if code := job.returncode:
        how = signal.Signals(-code).name if code < 0 else f"exit {code}"
        raise LogError(f"{source}: {_ENDED.format(f'it ended its reader ({how})')}")
    read: Content | str = ForkingPickler.loads(content)
    if isinstance(read, str):
        raise LogError(read)
    return read


def _resident(process: int) -> int:
    """Return the memory that a process holds [bytes], 0 where the system does not say."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def _loaded(loader: Loader, path: Path, source: str) -> Content | str:
    try:
        content = loader(path, source)
        limited(source, sum(x.size for x in content.arrays.values()), path.stat().st_size)
        return content
    except LogError as error:
        return str(error)
    except MemoryError:
        return f"{source}: {_TOO_LARGE}"


if __name__ == "__main__":
    module, name, given, called = sys.argv[1:]
    read = _loaded(getattr(importlib.import_module(module), name), Path(given), called)
    ForkingPickler(sys.stdout.buffer, HIGHEST_PROTOCOL).dump(read)  # array by array, never all of them twice
