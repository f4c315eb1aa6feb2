"""Franka Panda, a real robot (Gaz et al. 2019): scattered stamps, lost samples, no setting given.

The error of the fit stands beside the published one; the unseen part is the last 40 % of the recording, of a twin
of the first 60 %. The effort holds a ripple of the gears (120 and 240 periods a turn on joints 1 to 4, 80 and 160 on
5 to 7; 15 to 60 Hz at the speeds of this log) that no listed effect accounts for: how much of it counts as error
depends on the band, so both errors stand also for the band below 20 Hz, the unseen one of the same twin.
"""

from __future__ import annotations

from dataclasses import replace

import pinotwin as pt
from benchmarks._plain import plain_error
from benchmarks.evidence.real import folder, percent, unseen_effort
from benchmarks.evidence.store import Figure

SEEDS = "none: a recording"
BAND = 20.0
"""Corner below most of the gears' ripple [Hz]."""


def figures() -> list[Figure]:
    """Measure."""
    data = folder("franka_panda")
    machine, log = pt.Machine.load(data / "machine.yaml"), pt.read(data / "exciting_traj.csv")
    twin = pt.identify(machine, log, loop=False)
    cut = int(0.6 * len(log))
    start, rest = log.rows(slice(0, cut)), log.rows(slice(cut, len(log)))
    first = pt.identify(machine, start, loop=False)
    whole, axes = unseen_effort(first, rest)
    small, large = min(axes.values()), max(axes.values())
    fit = 100.0 * twin.quality["relative_error"]
    narrow = replace(machine, data=replace(machine.data, cutoff=BAND))
    fit_narrow = 100.0 * pt.identify(narrow, log, loop=False).quality["relative_error"]
    return [
        Figure("corner", "corner chosen", twin.motion(log).cutoff, unit="Hz", kind="fitted"),
        Figure("fit", "error norm of the fit", fit, kind="fitted", published=1.41),
        Figure(
            "unseen",
            "torque of the last 40 %, all axes",
            whole,
            plain=100.0 * plain_error(first, [start], rest),
        ),
        Figure("fit_20", "error norm of the fit, below 20 Hz", fit_narrow, kind="fitted", published=1.41),
        Figure(
            "unseen_20",
            "torque of the last 40 %, below 20 Hz",
            _below(BAND, first, rest),
        ),
        Figure(
            "axes", "torque of the last 40 %, median axis", sorted(axes.values())[3], low=small, high=large
        ),
    ]


def _below(corner: float, twin: pt.Twin, log: pt.Log) -> float:
    """Return the error of a twin's effort in a band that is not its own [%]."""
    motion = pt.prepare(twin.machine, log, cutoff=corner)
    return percent(twin.effort(motion)[motion.inside], motion.u[motion.inside])
