"""What a sensor does at rest: rest detection, noise density, Allan deviation.

Allan deviation of a rate sampled at tau0 (IEEE Std 952; overlapping estimator), theta its integral:

    sigma²(m tau0) = mean (theta[k + 2m] - 2 theta[k + m] + theta[k])² / (2 (m tau0)²)

White noise of density N [unit/sqrt(Hz)] (one-sided PSD N²) gives sigma = N / sqrt(2 tau); in the
inertial world the number quoted is the random-walk coefficient N/sqrt(2) per axis. A floor at
sigma = 0.664 B is the bias instability B; a random walk K [unit/sqrt(s)] gives sigma = K
sqrt(tau/3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError


@dataclass(frozen=True)
class NoiseFigures:
    """Noise of one rest segment; arrays per channel, units of the channel.

    Attributes:
        mean: bias over the segment.
        rms: standard deviation.
        density: white noise density (one-sided) [unit/sqrt(Hz)].
        instability: bias instability [unit]; zero where the segment does not show any.
        walk: rate random walk [unit/sqrt(s)]; likewise.
        tau: averaging times [s], shape (k,).
        allan: Allan deviation, shape (k, channels).
    """

    mean: Floats
    rms: Floats
    density: Floats
    instability: Floats
    walk: Floats
    tau: Floats
    allan: Floats


def allan_deviation(x: Floats, rate: float, points: int = 40) -> tuple[Floats, Floats]:
    """Return averaging times [s], (k,), and the overlapping Allan deviation, (k, channels).

    Args:
        x: samples (n, channels) or (n,).
        rate: sampling rate [Hz].
        points: number of averaging times, log-spaced up to a ninth of the record.
    """
    x = np.atleast_2d(np.asarray(x, dtype=float).T).T
    n = len(x)
    theta = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)]) / rate
    sizes = np.unique(np.geomspace(1, max(1, n // 9), points).astype(int))
    deviations = []
    for m in sizes:
        d = theta[2 * m :] - 2.0 * theta[m:-m] + theta[: -2 * m]
        deviations.append(np.sqrt(np.mean(d**2, axis=0) / 2.0) * rate / m)
    return sizes / rate, np.array(deviations)


def characterise(x: Floats, rate: float) -> NoiseFigures:
    """Return the noise figures of a rest segment, shape (n, channels) or (n,).

    The Allan variance is fitted by non-negative least squares on N²/(2 tau) + (0.664 B)² + K²
    tau/3, each point weighted with its relative error (tau over length).

    Raises:
        DataError: fewer than 50 samples.
    """
    x = np.atleast_2d(np.asarray(x, dtype=float).T).T
    if len(x) < 50:
        raise DataError(f"a rest segment of {len(x)} samples is too short for noise figures; >= 50")
    tau, allan = allan_deviation(x, rate)
    basis = np.stack([0.5 / tau, np.full_like(tau, 0.664**2), tau / 3.0], axis=1)
    weight = 1.0 / np.sqrt(tau)
    found = np.empty((x.shape[1], 3))
    for c in range(x.shape[1]):
        variance = np.maximum(allan[:, c] ** 2, 1e-300)
        rows = basis * (weight / variance)[:, None]
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        found[c] = nnls(rows / size, weight)[0] / size
    N, B, K = np.sqrt(found).T
    return NoiseFigures(x.mean(axis=0), x.std(axis=0), N, B, K, tau, allan)


def white_level(x: Floats) -> Floats:
    """Return the standard deviation of the fast part of moving signals (n, k), robustly, (k,).

    From third differences, which let a smooth motion through with little: median absolute deviation
    over sqrt(20). Noise that a low-pass has coloured reads too low.
    """
    d = np.diff(np.asarray(x, dtype=float), n=3, axis=0)
    return np.median(np.abs(d), axis=0) / 0.6745 / np.sqrt(20.0)


def rest(gyr: Floats, acc: Floats, rate: float, window: float = 0.3, factor: float = 2.0) -> Mask:
    """Return where the sensor rests, shape (n,).

    A window rests when the standard deviations of rate and force in it are within ``factor`` of
    the quietest ones (2 % quantile) and its mean rate is that of the quiet windows. The quietest
    windows count only if their readings scatter like noise and not like motion (von Neumann's
    ratio of successive differences) about a rate that can be a bias; else the mask is empty.

    Args:
        gyr: angular rate [rad/s], (n, 3).
        acc: specific force [m/s²], (n, 3).
        rate: sampling rate [Hz].
        window: length of a window [s].
        factor: how much above the quiet level still counts as rest.
    """
    m = max(8, round(window * rate))
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
    still = (sg <= factor * level_g) & (sa <= factor * level_a) & near
    cover = np.zeros(len(gyr) + 1)
    np.add.at(cover, np.flatnonzero(still), 1)
    np.add.at(cover, np.flatnonzero(still) + m, -1)
    return np.cumsum(cover)[:-1] > 0


def _window_std(x: Floats, m: int) -> tuple[Floats, Floats]:
    """Return standard deviation (norm over channels) and mean of sliding windows of m."""
    centre = np.mean(x, axis=0)  # differences of sums lose digits otherwise
    x = x - centre
    s1 = np.cumsum(np.vstack([np.zeros(x.shape[1]), x]), axis=0)
    s2 = np.cumsum(np.vstack([np.zeros(x.shape[1]), x**2]), axis=0)
    mean = (s1[m:] - s1[:-m]) / m
    variance = np.maximum((s2[m:] - s2[:-m]) / m - mean**2, 0.0)
    return np.sqrt(variance.sum(axis=1)), mean + centre
