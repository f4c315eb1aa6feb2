"""Where a sensor rests."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from pinotwin.arrays import Floats, Mask


def rest(gyr: Floats, acc: Floats, rate: float) -> Mask:
    """Return where a sensor rests, (n,), by rates [rad/s] and forces [m/s²], (n, 3) each, at ``rate`` [Hz].

    Windows of 0.3 s with deviations within twice those of the quietest (2 % quantile) and with their mean rate; these
    must scatter like noise (von Neumann's ratio) about a rate that can be a bias, else the mask is empty.
    """
    m = max(8, round(0.3 * rate))
    if len(gyr) < 2 * m:
        return np.zeros(len(gyr), dtype=bool)
    sg, mg = _window_std(gyr, m)
    sa, _ = _window_std(acc, m)
    jumps, _ = _window_std(np.diff(gyr, axis=0, prepend=gyr[:1]), m)
    level_g, level_a = np.quantile(sg, 0.02), np.quantile(sa, 0.02)
    quiet = sg <= 1.2 * level_g
    bias = np.median(mg[quiet], axis=0)
    like_noise = np.median(jumps[quiet]) > 0.5 * level_g  # sqrt(2) for white noise, 0 for motion
    if not like_noise or np.linalg.norm(bias) > 0.05:  # no MEMS bias is 3 deg/s
        return np.zeros(len(gyr), dtype=bool)
    near = np.linalg.norm(mg - bias, axis=1) < max(6.0 * level_g / np.sqrt(m), 5e-4)
    still = (sg <= 2.0 * level_g) & (sa <= 2.0 * level_a) & near
    return np.convolve(still, np.ones(m)) > 0


def _window_std(x: Floats, m: int) -> tuple[Floats, Floats]:
    """Return standard deviation (norm over channels) and mean of sliding windows of m."""
    centre = np.mean(x, axis=0)  # differences of sums lose digits otherwise
    x = x - centre
    whole = slice(m // 2, m // 2 + len(x) - m + 1)
    mean, square = (uniform_filter1d(y, m, axis=0)[whole] for y in (x, x**2))
    return np.sqrt(np.maximum(square - mean**2, 0.0).sum(axis=1)), mean + centre
