"""What a command costs before it works: CPU seconds of whole processes, each beside its limit.

    python -m benchmarks startup

Byte code is compiled beforehand, as pip does; of three runs the least counts. The last row is the first `identify`
of a user, whose folder of compiled functions is empty, over the second.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

LIMITS = {"check": 1.5, "simulate": 2.0, "missing file": 0.3, "first identify / second": 1.3}
"""CPU seconds, and a ratio."""


def cpu_seconds(words: str, folder: Path, code: int = 0) -> float:
    """Return the CPU time of one ``pinotwin`` command run in a folder [s]; it must end with that exit code."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"NUMBA_CACHE_DIR": str(folder / "kernels"), "PYTHONPYCACHEPREFIX": str(folder / "bytes")}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "pinotwin.cli.main", *words.split()]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != code:
        raise SystemExit(f"pinotwin {words}: exit code {done.returncode}: {done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def least(words: str, folder: Path, code: int = 0) -> float:
    """Return the least CPU time of three runs after one that compiles byte code [s]."""
    return min([cpu_seconds(words, folder, code) for _ in range(4)][1:])


def measured(folder: Path) -> dict[str, float]:
    """Return what :data:`LIMITS` limits, in a folder of its own."""
    cpu_seconds("record trunnion --seconds 20 --seed 3 --out log.csv", folder)
    checked = least("check trunnion log.csv", folder)
    missing = least("check trunnion none.csv", folder, code=2)
    cpu_seconds("identify --help", folder)
    ratio = cpu_seconds("identify trunnion log.csv --out twin", folder)
    ratio /= cpu_seconds("identify trunnion log.csv --out twin", folder)
    simulated = least("simulate twin log.csv --out predicted.csv", folder)
    values = (checked, simulated, missing, ratio)
    return dict(zip(LIMITS, values, strict=True))


def main() -> None:
    """Print each figure with its limit; fail where one is above it."""
    with tempfile.TemporaryDirectory() as folder:
        found = measured(Path(folder))
    print(f"{'':<26}{'measured':>10}{'limit':>10}")
    for name, value in found.items():
        unit = "" if "/" in name else " s"
        print(f"{name:<26}{value:>8.2f}{unit:<2}{LIMITS[name]:>8.2f}{unit:<2}")
    above = [name for name, value in found.items() if value > LIMITS[name]]
    if above:
        raise SystemExit(f"above its limit: {', '.join(above)}")


if __name__ == "__main__":
    main()
