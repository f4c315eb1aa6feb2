"""Least squares under bounds on the coefficients, on the small factor.

    minimise || R theta - z ||^2   subject to   lower <= theta <= upper

An active-set method (Stark & Parker 1995, `scipy.optimize.lsq_linear`, BVLS) on scaled columns. The
directions that the data leave open are held at the prior by weak extra rows.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.fit.rank import Rank

WEAK = 1e-6
"""Weight of the rows that hold unseen directions at the prior, relative to a unit column."""


def bounded(
    R: Floats, z: Floats, lower: Floats, upper: Floats, start: Floats, rank: Rank
) -> tuple[Floats, Mask]:
    """Return theta within its bounds and the mask of active bounds, each of shape (p,).

    Args:
        R: factor of the weighted regressor, shape (k, p).
        z: right side, shape (k,).
        lower: smallest values, shape (p,), -inf for free.
        upper: largest values, shape (p,).
        start: prior mean, held where the data are silent, shape (p,).
        rank: analysis of R.
    """
    if (lower > upper).any():
        raise DataError("a lower bound lies above its upper bound")
    length = np.linalg.norm(R, axis=0)
    unit = np.where(length > 0, 1.0 / np.where(length > 0, length, 1.0), rank.scale)
    hold = rank.null.T / rank.scale
    A = np.concatenate([R, WEAK * hold]) * unit
    b = np.concatenate([z, WEAK * (hold @ start)])
    fixed = lower == upper
    theta = np.where(fixed, lower, 0.0)
    free = ~fixed
    if free.any():
        rest = b - A[:, fixed] @ (theta[fixed] / unit[fixed])
        found = lsq_linear(
            A[:, free], rest, (lower[free] / unit[free], upper[free] / unit[free]),
            method="bvls", tol=1e-14,
        )  # fmt: skip
        theta[free] = found.x * unit[free]
    theta = np.clip(theta, lower, upper)
    return theta, (theta <= lower) | (theta >= upper)
