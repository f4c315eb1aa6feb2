"""The gap of every axis: measured effort less the twin's on rows in motion, beside noise and misfit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.explained import Closed
from pinotwin.diagnosis.data.comparison import Comparison, by_days, scatter
from pinotwin.diagnosis.data.noise import noises, repeats
from pinotwin.diagnosis.data.samples import judged_rows
from pinotwin.diagnosis.result import Gap
from pinotwin.motion import Motion
from pinotwin.signals import rms


def gap_table(
    c: Comparison, closed: Mapping[str, Closed], levels: Mapping[int, float]
) -> dict[str, dict[str, Gap]]:
    """Return axis -> signal -> gap, on the rows in motion of the logs in question.

    ``after`` is what is left once the named causes are modelled, by the share that goes on rows that were not fitted;
    ``closed``: axis -> what they close; ``levels``: joint -> RMS of the noise [N or N·m].
    """
    motion = c.new.motion
    residual = motion.u - c.twin.effort(motion)
    out = {}
    for j in c.new.joints:
        rows = judged_rows(motion, j)
        level = rms(residual[rows, j])
        # What makes a gap larger closes nothing.
        axis = motion.names[j]
        gone = min(max(closed[axis].share, 0.0), 1.0) if axis in closed else 0.0
        effort = rms(motion.u[rows, j])
        misfit, unsure = float("nan"), 0.0  # where the twin knows none
        if c.twin.misfit is not None and c.own is not None and j in c.own.joints:
            misfit = c.twin.misfit.summary[axis]["moving"]
            unsure = float(np.sqrt(max(c.floor[j] ** 2 - c.own.level(j) ** 2, 0.0)))
        after, size = level * float(np.sqrt(1.0 - gone)), c.new.size(j)
        nrmse = level / max(effort, 1e-300)
        out[axis] = {"u": Gap(level, nrmse, levels[j], after, misfit, size, unsure, c.worth)}
    return {**out, **unjudged_gaps(motion, residual, [x for x in c.gate.silent if x not in out])}


def unjudged_gaps(motion: Motion, left: Floats, axes: Iterable[str]) -> dict[str, dict[str, Gap]]:
    """Return the gaps of axes that are not judged: what is left of their effort, (n, nv) [N or N·m], no noise known."""
    out = {}
    for axis in axes:
        j = motion.index(axis)
        rows = judged_rows(motion, j)
        if rows.any():
            level = rms(left[rows, j])
            nrmse = level / max(rms(motion.u[rows, j]), 1e-300)
            out[axis] = {"u": Gap(level, nrmse, float("nan"), level)}
    return out


def noise_levels(c: Comparison) -> tuple[dict[int, float], str]:
    """Return joint -> RMS of the noise, and where it comes from: ``repeats`` or ``assumed``.

    Two runs of one command differ by noise and by the scatter from run to run; of a single run only the roughness from
    row to row is known, which counts in any case. A twin adds what friction scatters from its runs to these.
    """
    motions = c.motions[: len(c.logs)]
    out = noises(c.new, motions, [m.u for m in motions])
    if c.change:
        out = {j: float(np.hypot(x, scatter(c, j, by_days(c, j)))) for j, x in out.items()}
    return out, "repeats" if repeats(motions) else "assumed"
