"""What the numbers of two columns say of each other: which follow, which push, in which sense."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from pinotwin.arrays import Floats
from pinotwin.logs.quality.values import has_more_values
from pinotwin.signals import autocorrelation


@dataclass(frozen=True)
class Push:
    """How well a column is explained as the effort of an axis."""

    share: float  # share of its variance that inertia, friction, position and a constant explain
    negative: bool  # whether both inertia and dry friction come out negative: the column's sign is turned


def moves(x: Floats) -> bool:
    """Whether a column is a motion: it varies, and its neighbours are alike."""
    good = x[np.isfinite(x)]
    return len(good) > 20 and has_more_values(good, 1) and float(autocorrelation(good, 1)[1]) > 0.9


def is_counter(x: Floats) -> bool:
    """Whether a column, shape (n,), only counts its rows."""
    steps = np.diff(x[np.isfinite(x)])
    return len(steps) > 5 and bool(np.all(steps == steps[0])) and steps[0] != 0.0


def distance(x: Floats, y: Floats) -> float:
    """Return how far two columns are apart, as a share of the motion of the first (0: equal)."""
    both = np.isfinite(x) & np.isfinite(y)
    size = float(np.std(x[both])) if both.any() else 0.0
    return float(np.std((x - y)[both])) / size if size > 0.0 else np.inf


def smoothness(x: Floats) -> float:
    """Return the share of a column that changes from sample to sample: less for a command than for an encoder."""
    good = x[np.isfinite(x)]
    size = float(np.std(good))
    return float(np.std(np.diff(good, 3))) / size if size > 0.0 and len(good) > 4 else np.inf


def lead(x: Floats, y: Floats) -> tuple[float, float]:
    """Return by how many samples ``x`` (n,) is ahead of ``y``, and the share of their difference that explains."""
    both = np.isfinite(x) & np.isfinite(y)
    speed = np.gradient(x[both])
    speed, apart = speed - speed.mean(), (x - y)[both] - np.mean((x - y)[both])
    power = float(speed @ speed) * float(apart @ apart)
    ahead = float(speed @ apart)
    return (ahead / float(speed @ speed), ahead**2 / power) if power > 0.0 else (0.0, 0.0)


def push(q: Floats, u: Floats, step: float, longest: int = 60_000) -> Push:
    """Return how much of a column ``u`` (n,) an axis that moves as ``q`` (n,) would need, asked of ``longest`` rows."""
    keep = slice(0, longest)
    position, effort = q[keep].astype(float), u[keep].astype(float)
    good = np.isfinite(position) & np.isfinite(effort)
    if good.sum() < 50 or np.ptp(effort[good]) == 0.0:
        return Push(0.0, False)
    position = np.interp(np.arange(len(position)), np.flatnonzero(good), position[good])
    width = max(3, int(0.02 / step) | 1) if step > 0.0 else 5
    v = np.gradient(uniform_filter1d(position, width, mode="nearest"), step)
    a = np.gradient(uniform_filter1d(v, width, mode="nearest"), step)
    slow = 0.02 * float(np.abs(v).max())
    columns = np.column_stack([a, np.tanh(v / slow) if slow > 0 else v, v, position, np.ones(len(v))])
    columns /= np.maximum(np.std(columns, axis=0), 1e-12) + (np.std(columns, axis=0) == 0)
    theta, *_ = np.linalg.lstsq(columns[good], effort[good], rcond=None)
    left = effort[good] - columns[good] @ theta
    share = 1.0 - float(np.var(left)) / float(np.var(effort[good]))
    power = float(np.mean((effort * v)[good]))
    return Push(share, bool(theta[0] < 0.0 and theta[1] + theta[2] < 0.0 and power < 0.0))
