"""Where a sensor rests, and the whitening of its noise by an autoregression fitted there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from pinotwin.arrays import Floats, Mask
from pinotwin.signals import roughness, runs


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


@dataclass(frozen=True)
class Whitener:
    """Turns noise into white noise of size one, channel by channel."""

    taps: Floats  # prediction-error filters, (channels, order + 1), first tap one
    sigma: Floats  # standard deviation of the innovations, (channels,)

    @classmethod
    def from_rest(cls, x: Floats, rate: float, order: int = 3) -> Whitener:
        """Fit to resting readings (m, 6) by Yule and Walker: on short rests a scale is 0.02 % off, 0.03 by Burg."""
        still = rest(x[:, :3], x[:, 3:], rate)
        pieces = [x[s] for s in runs(still) if s.stop - s.start > 40 * order]
        samples = sum(len(p) for p in pieces)
        if samples < 0.3 * rate:
            taps = np.tile(np.eye(order + 1)[:1], (x.shape[1], 1))
            level = [roughness([column]) for column in x.T]  # of coloured noise it reads too low
            return cls(taps, np.array(level))
        r = np.zeros((order + 1, x.shape[1]))  # autocovariance
        for p in (p - p.mean(axis=0) for p in pieces):
            r += np.array([np.sum(p[k:] * p[: len(p) - k], axis=0) for k in range(order + 1)]) / samples
        taps, sigma = np.ones((x.shape[1], order + 1)), np.empty(x.shape[1])
        for c in range(x.shape[1]):
            a = solve_toeplitz(r[:-1, c], r[1:, c])
            taps[c, 1:], sigma[c] = -a, np.sqrt(max(r[0, c] - a @ r[1:, c], 1e-30))
        return cls(taps, sigma)

    def at_least(self, residual: Floats) -> Whitener:
        """Return one whose sigma covers the bulk of whitened residuals (m, channels)."""
        size = np.median(np.abs(residual), axis=0) / 0.6745
        return replace(self, sigma=self.sigma * np.maximum(1.0, size))

    def __call__(self, x: Floats) -> Floats:
        """Return whitened rows of x (m, channels, ...)."""
        out = np.empty_like(x)
        for c in range(x.shape[1]):
            out[:, c] = lfilter(self.taps[c] / self.sigma[c], [1.0], x[:, c], axis=0)
        return out
