"""Hat functions: the weights of linear interpolation between evenly spaced knots."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats


def hats(x: Floats, low: float, high: float, count: int) -> Floats:
    """Return the weights of knots from ``low`` to ``high``, zero beyond, shape (n, count)."""
    place = (x - low) / (high - low) * (count - 1)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(count))))
