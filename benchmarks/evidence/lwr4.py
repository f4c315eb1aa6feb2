"""KUKA LWR4, a real robot (FloBaRoID): fitted on runs 2 and 3, judged on run 1, as its authors split it.

Errors of the joint torques over all axes; nothing is set by hand. Plain least squares is what the recording's own
tool chain gives on the same split.
"""

from __future__ import annotations

import pinotwin as pt
from benchmarks.evidence.real import folder, unseen_effort
from benchmarks.evidence.store import Figure

SEEDS = "none: a recording"


def figures() -> list[Figure]:
    """Measure."""
    data = folder("kuka_lwr4")
    logs = [pt.read(data / f"measurements_{k}.csv") for k in (2, 3)]
    twin = pt.identify(pt.Machine.load(data / "machine.yaml"), logs, loop=False)
    whole, axes = unseen_effort(twin, pt.read(data / "measurements_1.csv"))
    small, large = min(axes.values()), max(axes.values())
    fit = 100.0 * twin.quality["relative_error"]
    return [
        Figure("unseen", "torque of run 1, all axes", whole),
        Figure("axes", "torque of run 1, median axis", sorted(axes.values())[3], low=small, high=large),
        Figure("fit", "error norm of the fit", fit, kind="fitted"),
    ]
