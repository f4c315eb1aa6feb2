"""Least squares under bounds: minimise || R theta - z ||^2 subject to lower <= theta <= upper, on the small factor.

An active-set method (Stark & Parker 1995, `scipy.optimize.lsq_linear`, BVLS) on scaled columns. The directions that
the data leave open are held at the prior by weak extra rows.
"""

from __future__ import annotations

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.solve.rank import Rank, r_factor


def bounded(
    R: Floats, z: Floats, lower: Floats, upper: Floats, start: Floats, rank: Rank, weak: float = 1e-6
) -> tuple[Floats, Mask]:
    """Return theta of R (k, p) and z (k,) in bounds, near ``start``, and which are active, each of shape (p,)."""
    if (lower > upper).any():
        raise DataError("a lower bound lies above its upper bound")
    unit, hold = rank.unit, rank.null.T / rank.unit
    A = np.concatenate([R, weak * hold]) * unit
    b = np.concatenate([z, weak * (hold @ start)])
    low, high = lower / unit, upper / unit
    limited = np.isfinite(low) | np.isfinite(high)
    theta, free = np.zeros(len(unit)), np.count_nonzero(~limited)
    T = r_factor(np.column_stack([A[:, ~limited], A[:, limited], b]))
    theta[limited] = _within(T[free:, free:-1], T[free:, -1], low[limited], high[limited])
    right = T[:free, -1] - T[:free, free:-1] @ theta[limited]  # the unbounded columns follow anyway
    theta[~limited] = scipy.linalg.solve_triangular(T[:free, :free], right)
    theta = np.clip(theta * unit, lower, upper)
    return theta, (theta <= lower) | (theta >= upper)


def _within(A: Floats, b: Floats, low: Floats, high: Floats) -> Floats:
    """Return the bounded solution of the columns that have bounds."""
    fixed = low == high
    out = np.where(fixed, low, 0.0)
    if not fixed.all():
        out[~fixed] = active_set(A[:, ~fixed], b - A[:, fixed] @ out[fixed], low[~fixed], high[~fixed])
    return out


def active_set(A: Floats, b: Floats, low: Floats, high: Floats) -> Floats:
    """Return the bounded solution; none of the columns is fixed.

    Bounds from below alone are Lawson and Hanson's, in a tenth of the time. A column that the data leave open and whose
    prior is its bound ends a rounding beyond it: scipy's BVLS then divides by zero.
    """
    try:
        if np.isfinite(low).all() and np.isinf(high).all():
            return low + scipy.optimize.nnls(A, b - A @ low)[0]
        with np.errstate(divide="raise", invalid="raise"):
            return scipy.optimize.lsq_linear(A, b, (low, high), method="bvls", tol=1e-14).x
    except (FloatingPointError, RuntimeError):  # divided by zero, too many steps
        return scipy.optimize.lsq_linear(A, b, (low, high), method="trf", tol=1e-14).x
