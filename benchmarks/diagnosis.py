"""Time of one diagnosis: 24 s, five axes, 500 Hz, two repeats, the whole catalogue.

Run: ``OPENBLAS_NUM_THREADS=1 python benchmarks/diagnosis.py [--quick]``
"""

from __future__ import annotations

import sys
import time

from pinotwin.diagnosis import diagnose
from pinotwin.machine import Machine
from pinotwin.machine.bundled import bundled_path
from pinotwin.virtual import VirtualMachine, random_trajectory


def main() -> None:
    """Record, diagnose, and say where the time went."""
    quick = "--quick" in sys.argv
    virtual = VirtualMachine.load(bundled_path("laser_driller"), withhold=["joint_flexibility"])
    path = random_trajectory(virtual, 24.0, 3)
    logs = [virtual.record(path, seed=s).to_log() for s in (1, 2)]
    start = time.perf_counter()
    last, stage = start, "start"

    def report(name: str, done: float) -> None:
        nonlocal last, stage
        now = time.perf_counter()
        sys.stdout.write(f"{now - last:8.2f} s  {stage}\n")
        last, stage = now, name
        del done

    found = diagnose(Machine.load("laser_driller"), logs, quick=quick, report=report)
    report("end", 1.0)
    sys.stdout.write(f"{time.perf_counter() - start:8.2f} s  in all: {found.sentence}\n")


if __name__ == "__main__":
    main()
