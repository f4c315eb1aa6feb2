"""The virtual flexure rig: identified on one log of 20 s, another command of 20 s simulated; every axis counts.

Five seeds by three friction laws that the model does not hold; RMS error over RMS of tracking error and effort.
"""

from __future__ import annotations

from benchmarks.evidence import virtual
from benchmarks.evidence.store import Figure

SEEDS = "50 to 54; unseen commands 1050 to 1054"
SLOW = True


def figures() -> list[Figure]:
    """Measure."""
    return virtual.measure("flexure_rig", published=5.54)
