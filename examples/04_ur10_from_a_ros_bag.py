"""04: a UR10 of example-robot-data from a ROS 2 bag: machine, check, twin, diagnosis, MuJoCo file.

Run: .venv/bin/python examples/04_ur10_from_a_ros_bag.py. Bag and truth are made here (``robot_bag.py``).

You see 6 joints, how many parameters the motion determines, and the error of each joint's effort on the other bag,
some 0.4 to 4 %. In a third bag the dry friction of one joint is tripled: the diagnosis names it, with its size.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import pinotwin as pt

sys.path.insert(0, str(Path(__file__).parent))
from robot_bag import excited, write_bag


def main(
    robot: str = "ur10", seconds: float = 30.0, joints: int | None = None
) -> tuple[dict[str, float], pt.Diagnosis]:
    """Return per axis the RMS error over the RMS effort on a bag that was not fitted, and the diagnosis."""
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        true = pt.Machine.load(robot)
        arm = list(true.axes)[:joints]
        bags = []
        worn = arm[len(arm) // 2]
        for seed in (1, 2, 3):
            log = excited(true, seconds, seed, worn if seed == 3 else None)
            kept = {name: x for name, x in log.items() if name == "t" or name.rpartition(".")[0] in arm}
            bags.append(pt.read(write_bag(folder / f"bag{seed}", kept)))
        start = pt.new(robot, bags[0], out=folder / "arm")
        print(*start.said, sep="\n")
        checked = pt.check(start.machine, bags[0])
        print(
            f"check: {sum(checked.determined.values())} of {len(checked.determined)} parameters can be identified"
        )
        twin = pt.identify(start.machine, bags[0], loop=False)
        pt.export(twin, "mjcf", folder / "arm.xml")
        print(f"MuJoCo: {(folder / 'arm.xml').stat().st_size} bytes")
        found = pt.diagnose(twin, bags[2], quick=True)
        print(found.sentence)
        motion = twin.motion(bags[1])
        residual = motion.u - twin.effort(motion)
    out = {}
    for name, axis in start.machine.axes.items():
        rows = motion.use[:, axis.index]
        out[name] = float(
            np.sqrt(np.mean(residual[rows, axis.index] ** 2) / np.mean(motion.u[rows, axis.index] ** 2))
        )
        print(f"{name:<24}{out[name]:8.2%} of its effort on the other bag")
    return out, found


if __name__ == "__main__":
    main()
