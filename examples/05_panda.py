"""05: the same for a Panda: seven joints in the bag, fingers that are not, held at zero and said to be.

Run: .venv/bin/python examples/05_panda.py.

You see the finger that follows the other one, the one held at zero, an error of some 1 to 7 % of each joint's effort
on the other bag, and the joint whose friction is tripled in the third.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pinotwin as pt

sys.path.insert(0, str(Path(__file__).parent))


def main(seconds: float = 30.0) -> tuple[dict[str, float], pt.Diagnosis]:
    """Return per axis the RMS error over the RMS effort on a bag that was not fitted, and the diagnosis."""
    return importlib.import_module("04_ur10_from_a_ros_bag").main("panda", seconds, joints=7)


if __name__ == "__main__":
    main()
