"""08: the inverse model as one NumPy file: effort from q, v, a, friction and tables included.

Run: .venv/bin/python examples/08_leave_the_tool.py.

You see the head of the file, and how far its effort is from the twin's: below 1 %.
"""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path

import numpy as np

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


def main(seconds: float = 10.0) -> float:
    """Return the RMS difference between the file's effort and the twin's, over the twin's RMS."""
    virtual = VirtualMachine.load(pt.machines()["emps"])
    log = virtual.record(random_trajectory(virtual, seconds, 1), seed=1).to_log()
    twin = pt.identify(pt.Machine.load("emps"), log, loop=False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.py"
        pt.export(twin, "numpy", path)
        spec = importlib.util.spec_from_file_location("drive", path)
        drive = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(drive)
        print(drive.__doc__.splitlines()[0])
    motion = twin.motion(log)
    motion = motion.cut(500, len(motion) - 500)  # the ends of a record differentiate badly
    own = drive.MODEL.run(motion.q, motion.v, motion.a, motion.step)
    effort = twin.effort(motion)
    apart = float(np.sqrt(np.mean((own - effort) ** 2) / np.mean(effort**2)))
    print(f"the file gives the twin's effort within {apart:.2%}")
    return apart


if __name__ == "__main__":
    main()
