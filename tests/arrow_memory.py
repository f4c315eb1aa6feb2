"""How much memory Arrow takes to read a file, in a process of its own: the peak of a process never falls."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

_READ = "import sys, pyarrow, pinotwin; pinotwin.read(sys.argv[1]); print(pyarrow.default_memory_pool().max_memory())"


def arrow_peak(path: Path) -> int:
    """Return the most that Arrow holds at once while a log is read [bytes]."""
    done = subprocess.run(
        [sys.executable, "-c", _READ, str(path)], capture_output=True, text=True, check=True
    )
    return int(done.stdout)
