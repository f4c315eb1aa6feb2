"""The virtual laser driller: identified on one log of 20 s, another command of 20 s simulated; every axis counts.

Five seeds by three friction laws that the model does not hold; RMS error over RMS of tracking error and effort. The
frame's mode, which bends behind the encoders of X and Y, is listed beside their friction (`joint_flexibility`).
"""

from __future__ import annotations

import pinotwin as pt
from benchmarks.evidence import virtual
from benchmarks.evidence.store import Figure
from pinotwin.effects import JointFlexibility

SEEDS = "50 to 54; unseen commands 1050 to 1054"
SLOW = True


def figures() -> list[Figure]:
    """Measure."""
    machine = pt.Machine.load("laser_driller")
    for axis in "XY":
        machine = machine.with_effects(axis, (*machine.axes[axis].effects, JointFlexibility(axis)))
    return virtual.measure("laser_driller", published=2.38, machine=machine)
