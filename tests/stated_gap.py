"""The gap that a diagnosis states is what the twin itself leaves: checked on every real machine."""

from __future__ import annotations

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis.conclusion.residuals import gap_table
from pinotwin.diagnosis.data.comparison import compare


def check_stated_gap(twin: pt.Twin, log: pt.Log) -> None:
    """Fail unless the gap of every axis is rms(u - twin.effort) over the rows at which it moves."""
    c = compare(twin, [log], [])
    gap = gap_table(c, {}, dict.fromkeys(c.new.joints, 0.0))
    motion = twin.motion(log)
    residual = motion.u - twin.effort(motion)
    assert set(gap) == set(twin.machine.names)
    for name, axis in twin.machine.axes.items():
        rows = motion.moving(axis.index)
        expected = np.sqrt(np.mean(residual[rows, axis.index] ** 2))
        assert gap[name]["u"].rms == pytest.approx(expected, rel=1e-9), name
