"""The gap of every axis: measured effort less the twin's on rows in motion, beside noise and misfit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.explained import Closed
from pinotwin.diagnosis.data.comparison import Comparison, by_days, scatter
from pinotwin.diagnosis.data.noise import noises, repeats
from pinotwin.diagnosis.data.samples import judged_rows
from pinotwin.diagnosis.result import Gap
from pinotwin.signals import rms


def gap_table(
    c: Comparison, closed: Mapping[int, Closed], levels: Mapping[int, float]
) -> dict[str, dict[str, Gap]]:
    """Return axis -> signal -> gap, on the rows in motion of the logs in question.

    ``after`` is what is left once the named causes are modelled, by the share that goes on rows that were not fitted;
    ``levels``: joint -> RMS of the noise [N or N·m].
    """
    motion = c.new.motion
    residual = motion.u - c.twin.effort(motion)
    out = {}
    for j in c.new.joints:
        rows = judged_rows(motion, j)
        level = rms(residual[rows, j])
        left = 1.0 - closed[j].bounded if j in closed else 1.0
        effort = rms(motion.u[rows, j])
        misfit, unsure = _expected(c, j)
        after, size = level * float(np.sqrt(left)), c.new.size(j)
        nrmse = level / max(effort, 1e-300)
        out[motion.names[j]] = {"u": Gap(level, nrmse, levels[j], after, misfit, size, unsure, c.worth)}
    for axis in c.gate.silent:
        j = motion.index(axis)
        rows = judged_rows(motion, j)
        if axis not in out and rows.any():
            out[axis] = {"u": unjudged_gap(residual[rows, j], motion.u[rows, j])}
    return out


def unjudged_gap(left: Floats, effort: Floats) -> Gap:
    """Return the gap of an axis that is not judged: what is left of its effort, (m,) [N or N·m], no noise known."""
    level = rms(left)
    return Gap(level, level / max(rms(effort), 1e-300), float("nan"), level)


def _expected(c: Comparison, joint: int) -> tuple[float, float]:
    """Return the twin's misfit and what it is less sure of here [N or N·m]; NaN and 0 where it knows none."""
    if c.twin.misfit is None or c.own is None or joint not in c.own.joints:
        return float("nan"), 0.0
    more = max(c.floor[joint] ** 2 - c.own.level(joint) ** 2, 0.0)
    return c.twin.misfit.summary[c.machine.names[joint]]["moving"], float(np.sqrt(more))


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
