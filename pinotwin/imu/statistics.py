"""Covariance of a least-squares fit whose residuals are neither white nor of one size."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats


def sandwich(scores: Floats, information: Floats, lag: int) -> Floats:
    """Return the covariance of parameters, (p, p), robust to correlated residuals.

    Newey and West 1987 (DOI 10.2307/1913610): with scores s[k] = J[k]' r[k] of the samples and the
    information A = J'J, the covariance is A^-1 S A^-1, S the sum of the lagged products of s under
    a triangular window.

    Args:
        scores: J' r of every sample, (n, p).
        information: J'J plus the priors' precision, (p, p).
        lag: samples over which residuals are correlated.
    """
    inverse = np.linalg.inv(information)
    return inverse @ long_run(scores, lag) @ inverse


def long_run(scores: Floats, lag: int) -> Floats:
    """Return the covariance of the sum of correlated scores (n, p), triangular window, (p, p)."""
    n = len(scores)
    lag = min(lag, n - 1)
    size = 1 << int(np.ceil(np.log2(n + lag + 1)))
    window = np.zeros(size)
    taper = 1.0 - np.arange(lag + 1) / (lag + 1)
    window[: lag + 1] = taper
    window[size - lag :] = taper[:0:-1]
    spectrum = np.fft.rfft(scores, size, axis=0) * np.fft.rfft(window)[:, None]
    S = scores.T @ np.fft.irfft(spectrum, size, axis=0)[:n]
    return 0.5 * (S + S.T)
