r"""Which lines of a spectrum stand out from their neighbours, at a known false alarm rate.

What is left of a real spectrum is never white, so a line is compared with the median power z of N
neighbours, not with a level for all. For noise that is even over those, powers are exponentially
distributed, and the chance that one exceeds T z by accident is known exactly whatever the noise
level (Rohling 1983, doi:10.1109/TAES.1983.309350):

    P = product over i < N/2 of (N - i) / (N - i + T)

Times the number of lines that were looked at it bounds the chance of naming any line at all.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats, Ints

NEIGHBOURS = 24
"""N."""


def floor(orders: Floats, power: Floats, guard: int) -> Floats:
    """Return the median power of each line's neighbours.

    Neighbours are compared after the spectrum's slope is taken out, else a floor that falls with
    the order would make the lowest orders stand out.

    Args:
        orders: ascending, shape (m,).
        power: of each; zero takes a line out, shape (m,).
        guard: lines on either side that are no neighbours, since a strong line leaks into them.
    """
    slope = _slope(orders, power)
    level = power / slope
    places = np.arange(len(power))
    out = np.zeros(len(power))
    for k in places:
        distance = np.abs(places - k)
        order = np.argsort(distance, kind="stable")
        near: Ints = order[(distance[order] > guard) & (power[order] > 0.0)][:NEIGHBOURS]
        if len(near) == NEIGHBOURS:
            out[k] = np.sort(level[near])[NEIGHBOURS // 2 - 1]
    return out * slope


def _slope(orders: Floats, power: Floats) -> Floats:
    """Return the trend of the power, a parabola in logarithmic scales fitted by least moduli."""
    alive = power > 0.0
    x = np.log(orders / orders[-1])
    columns = np.stack([np.ones_like(x), x, x**2], axis=1)
    y = np.log(np.where(alive, power, 1.0))
    weight = alive.astype(float)
    theta = np.zeros(3)
    for _ in range(30):
        theta = np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=None)[0]
        # The square root of the usual weight 1/|r|, with a floor that keeps it bounded.
        weight = alive / np.sqrt(np.maximum(np.abs(y - columns @ theta), 0.05))
    return np.asarray(np.exp(columns @ theta))


def false_alarm(ratio: Floats) -> Floats:
    """Return the chance that noise exceeds ``ratio`` times the median of its neighbours."""
    i = np.arange(NEIGHBOURS // 2)
    left = (NEIGHBOURS - i)[:, None]
    return np.asarray(np.prod(left / (left + np.atleast_1d(ratio)), axis=0))


def ratio_at(chance: float) -> float:
    """Return the ratio to the neighbours' median that noise exceeds with a given chance."""
    from scipy.optimize import brentq

    return float(brentq(lambda x: float(false_alarm(np.array([x]))[0]) - chance, 0.0, 1e6))


def strongest(power: Floats, level: Floats, alpha: float) -> tuple[int | None, float]:
    """Return the strongest line that stands out, and the chance of naming any by accident.

    Args:
        power: of each line, shape (m,).
        level: see :func:`floor`.
        alpha: largest chance allowed; above it no line is returned.
    """
    alive = (power > 0.0) & (level > 0.0)
    ratio = np.where(alive, power / np.where(alive, level, 1.0), 0.0)
    chance = np.minimum(false_alarm(ratio) * max(int(alive.sum()), 1), 1.0)
    named = np.flatnonzero(alive & (chance < alpha))
    if not len(named):
        return None, 1.0
    best = int(named[np.argmax(power[named])])
    return best, float(chance[best])
