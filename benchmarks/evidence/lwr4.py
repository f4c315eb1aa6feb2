"""KUKA LWR4, a real robot (FloBaRoID): fitted on runs 2 and 3, judged on run 1, as its authors split it.

Errors of the joint torques over all axes; nothing is set by hand. Plain least squares is what the recording's own
tool chain gives on the same split.
"""

from __future__ import annotations

import pinotwin as pt
from benchmarks._plain import plain_error
from benchmarks.evidence.real import folder, unseen_effort
from benchmarks.evidence.store import Figure

SEEDS = "none: a recording"


def figures() -> list[Figure]:
    """Measure."""
    data = folder("kuka_lwr4")
    judged, *logs = (pt.read(data / f"measurements_{k}.csv") for k in (1, 2, 3))
    machine = pt.Machine.load(data / "machine.yaml")
    twin = pt.identify(machine, logs, loop=False)
    whole, axes = unseen_effort(twin, judged)
    slow = [judged, logs[0]]
    other = pt.identify(machine, slow, loop=False)
    another = unseen_effort(other, logs[1])[0]
    small, large = min(axes.values()), max(axes.values())
    fit = 100.0 * twin.quality["relative_error"]
    return [
        Figure("unseen", "torque of run 1, all axes", whole, plain=100.0 * plain_error(twin, logs, judged)),
        Figure(
            "other",
            "torque of run 3, another kind of motion, of runs 1 and 2",
            another,
            plain=100.0 * plain_error(other, slow, logs[1]),
        ),
        Figure("axes", "torque of run 1, median axis", sorted(axes.values())[3], low=small, high=large),
        Figure("fit", "error norm of the fit", fit, kind="fitted"),
    ]
