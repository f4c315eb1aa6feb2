"""Friction that differs from run to run of one machine: in every log each part is scaled as suits it best."""

from __future__ import annotations

import numpy as np

from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.rules import RULES
from pinotwin.signals import rms


def by_days(c: Comparison, joint: int) -> float:
    """Return the share of an axis' friction by which logs of one machine may differ [1]: at least the usual one."""
    days = c.twin.quality.get("days", {}) if c.change else {}
    return max([RULES.scatter, *days.get(c.machine.names[joint], {}).values()])


def scatter(c: Comparison, joint: int, most: float) -> float:
    """Return the RMS by which friction differs from the twin's [N or N·m], by ``most`` of it [1] in every stretch.

    Dry and viscous friction differ each by itself: an axis that is warmer drags less, and holds as ever.
    """
    left, rows, rubs = c.new.residual[joint], c.new.samples(joint), c.rubs[joint]
    power = 0.0
    for part in c.new.motion.segments:
        here = (rows >= part.start) & (rows < part.stop)
        if rubs[here].any():
            more = rms(rubs[here] @ np.linalg.lstsq(rubs[here], left[here], rcond=None)[0])
            power += here.sum() * min(more, most * rms(rubs[here].sum(axis=1))) ** 2
    return float(np.sqrt(power / max(len(left), 1)))
