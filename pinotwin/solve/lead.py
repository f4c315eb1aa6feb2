"""By how much a signal comes late for what explains it, and how sure that is.

The share of its power that is left off a basis of all that may cause it (friction, gravity) is drawn against the
shift; a parabola through the lowest three points gives the fraction of a sample, a jackknife its standard error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.solve.jackknife import jackknife


@dataclass(frozen=True)
class Lag:
    """A signal at its best shift."""

    late: int  # samples that it is late by, a whole number; negative when it is ahead
    part: float  # the same between samples
    error: float  # its standard error [samples], infinite where there is no best shift, only a slope
    left_now: float  # share of its power (about its mean) that nothing explains as it is
    left: float  # the same at the best shift


def lag(u: Floats, rows: Ints, basis: Floats, reach: int, *, most: int = 61, blocks: int = 8) -> Lag:
    """Return by how many samples a signal u (n,) is late for causes with an orthonormal basis (m, k) at rows (m,).

    At most ``most`` shifts up to ``reach`` samples are tried, and ``blocks`` stretches left out in turn.
    """
    shifts = np.unique(np.linspace(-reach, reach, min(2 * reach + 1, most)).round().astype(int))
    starts = np.linspace(0, len(rows), blocks + 1).astype(int)[:-1]
    power, size = np.empty((len(shifts), blocks)), np.empty(len(shifts))
    for i, shift in enumerate(shifts):
        y = u[rows + shift]
        power[i] = np.add.reduceat((y - basis @ (basis.T @ y)) ** 2, starts)
        size[i] = np.sum((y - y.mean()) ** 2)
    total = power.sum(axis=1)
    left = np.divide(total, size, out=np.ones(len(size)), where=size > 0.0)
    best = int(np.argmin(left))
    now = float(left[np.argmin(np.abs(shifts))])
    if best in (0, len(shifts) - 1):
        return Lag(0, 0.0, np.inf, now, now)
    each = np.array([_lowest(shifts, total - one) for one in power.T])
    error = float(np.sqrt(jackknife(each[:, None])[0, 0]))
    return Lag(int(shifts[best]), _lowest(shifts, total), error, now, float(left[best]))


def _lowest(x: Ints, y: Floats) -> float:
    """Return where the parabola through the lowest point and its neighbours is lowest."""
    k = int(np.clip(np.argmin(y), 1, len(y) - 2))
    before, after = np.diff(y[k - 1 : k + 2]) / np.diff(x[k - 1 : k + 2])
    bend = (after - before) / (x[k + 1] - x[k - 1])
    lowest = 0.5 * (x[k - 1] + x[k] - before / bend) if bend > 0 else x[k]
    return float(np.clip(lowest, x[k - 1], x[k + 1]))


def put_back(t: Floats, u: Floats, lead: float) -> Floats:
    """Return an unbroken signal that is ahead by ``lead`` [s] where it belongs, held beyond its ends; shapes (n,)."""
    return np.asarray(scipy.interpolate.CubicSpline(t, u)(np.clip(t - lead, t[0], t[-1])))
