"""Friction that differs from run to run of one machine: in every log each part is scaled as suits it best."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.rules import RULES
from pinotwin.signals import rms


def by_days(c: Comparison, joint: int) -> float:
    """Return the share of an axis' friction by which logs of one machine may differ [1]: at least the usual one."""
    days = c.twin.quality.get("days", {}) if c.change else {}
    return max([RULES.scatter, *days.get(c.machine.names[joint], {}).values()])


def scatter(c: Comparison, joint: int, most: float) -> float:
    """Return the RMS by which friction differs from the twin's [N or N·m]."""
    courses = _courses(c, joint, most, c.new.residual[joint])
    return float(np.sqrt(sum(x @ x for _, x in courses) / max(len(c.new.residual[joint]), 1)))


def _courses(c: Comparison, joint: int, most: float, left: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield of every stretch what is left there, and the friction more than the twin's that closes most of it.

    Dry and viscous friction differ each by itself: an axis that is warmer drags less, and holds as ever.
    """
    rows, rubs, whole = c.new.samples(joint), c.rubs[joint], c.rubbing[joint]
    for part in c.new.motion.segments:
        here = (rows >= part.start) & (rows < part.stop)
        if rubs[here].any():
            more = rubs[here] @ np.linalg.lstsq(rubs[here], left[here], rcond=None)[0]
            yield left[here], more * min(1.0, most * rms(whole[here]) / max(rms(more), 1e-300))
