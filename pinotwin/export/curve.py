"""Piecewise-linear curves with as few knots as a tolerance allows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats


class Curve(NamedTuple):
    """A function of one number: straight between the knots ``x``, its end values beyond them."""

    x: list[float]
    y: list[float]

    def __call__(self, x: Floats) -> Floats:
        """Return the values at ``x``, shape (n,)."""
        return np.interp(x, self.x, self.y)


def curve(x: Floats, y: Floats, tolerance: float) -> Curve:
    """Return a curve within ``tolerance`` of the samples y at increasing x, both of shape (n,) (Reumann & Witkam)."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if len(x) == 1 or np.ptp(y) <= 2.0 * tolerance:
        return Curve([float(x[0])], [float(0.5 * (y.min() + y.max()))])
    kept, low, high = [0], -np.inf, np.inf
    for k in range(1, len(x)):
        slope = (y[k] - y[kept[-1]]) / (x[k] - x[kept[-1]])
        if not low <= slope <= high:  # the straight line to k would leave a sample in between
            kept.append(k - 1)
            low, high = -np.inf, np.inf
        run = x[k] - x[kept[-1]]
        rise = y[k] - y[kept[-1]]
        low, high = max(low, (rise - tolerance) / run), min(high, (rise + tolerance) / run)
    kept.append(len(x) - 1)
    return Curve([float(v) for v in x[kept]], [float(v) for v in y[kept]])
