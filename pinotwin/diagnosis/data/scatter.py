"""Friction that differs from run to run of one machine: in every log the twin's is scaled by what suits it best."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.diagnosis.data.comparison import Comparison


def scatter(c: Comparison, joint: int, most: float) -> float:
    """Return the RMS by which friction differs from the twin's [N or N·m].

    Args:
        c: the comparison.
        joint: which.
        most: share of the friction by which it may differ.
    """
    runs = list(_runs(c, joint, most))
    count = max(len(c.new.residual[joint]), 1)
    return float(np.sqrt(sum(more**2 * power for more, _, power in runs) / count))


def scattered(c: Comparison, joint: int, most: float) -> float:
    """Return what such friction closes on an axis [squared floors]; see :func:`scatter`."""
    closed = sum(more * (2.0 * along - more * power) for more, along, power in _runs(c, joint, most))
    return closed / c.floor[joint] ** 2


def _runs(c: Comparison, joint: int, most: float) -> Iterator[tuple[float, float, float]]:
    """Yield of every stretch: by how much friction is scaled, its product with the residual, and its power."""
    rows, left, rubs = c.new.samples(joint), c.new.residual[joint], c.rubbing[joint]
    for part in c.new.motion.segments:
        here = (rows >= part.start) & (rows < part.stop)
        along, power = float(left[here] @ rubs[here]), float(rubs[here] @ rubs[here])
        if power > 0.0:
            yield float(np.clip(along / power, -most, most)), along, power
