"""Where a sensor rests, and how large its white noise is."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.signals import roughness


def white_level(x: Floats) -> Floats:
    """Return the standard deviation of the noise on moving signals (n, k), (k,); coloured noise reads too low."""
    return np.array([roughness([column]) for column in np.asarray(x, dtype=float).T])


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
    s1 = np.cumsum(np.vstack([np.zeros(x.shape[1]), x]), axis=0)
    s2 = np.cumsum(np.vstack([np.zeros(x.shape[1]), x**2]), axis=0)
    mean = (s1[m:] - s1[:-m]) / m
    variance = np.maximum((s2[m:] - s2[:-m]) / m - mean**2, 0.0)
    return np.sqrt(variance.sum(axis=1)), mean + centre
