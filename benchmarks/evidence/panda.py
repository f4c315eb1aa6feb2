"""Franka Panda, a real robot (Gaz et al. 2019): scattered stamps, lost samples, no setting given.

The error of the fit stands beside the published one; the unseen part is the last 40 % of the recording, of a twin
of the first 60 %.
"""

from __future__ import annotations

import pinotwin as pt
from benchmarks.evidence.real import folder, unseen_effort
from benchmarks.evidence.store import Figure

SEEDS = "none: a recording"


def figures() -> list[Figure]:
    """Measure."""
    data = folder("franka_panda")
    machine, log = pt.Machine.load(data / "machine.yaml"), pt.read(data / "exciting_traj.csv")
    twin = pt.identify(machine, log, loop=False)
    cut = int(0.6 * len(log))
    first = pt.identify(machine, log.rows(slice(0, cut)), loop=False)
    whole, axes = unseen_effort(first, log.rows(slice(cut, len(log))))
    small, large = min(axes.values()), max(axes.values())
    fit = 100.0 * twin.quality["relative_error"]
    return [
        Figure("fit", "error norm of the fit", fit, kind="fitted", published=1.41),
        Figure("unseen", "torque of the last 40 %, all axes", whole),
        Figure(
            "axes", "torque of the last 40 %, median axis", sorted(axes.values())[3], low=small, high=large
        ),
    ]
