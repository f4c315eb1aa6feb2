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


def left_out(J: Floats, e: Floats, inverse: Floats, block: int, most: float = 4.0) -> Floats:
    """Return S of A^-1 S A^-1 by leaving out blocks of samples in turn, (p, p).

    The delete-a-group jackknife (Bell and McCaffrey 2002, "CR3"): without block b the parameters
    move by (A - J_b'J_b)^-1 J_b'e_b = A^-1 s_b, s_b = (I - J_b'J_b A^-1)^-1 J_b'e_b, and S is the
    sum of s_b s_b'. Against :func:`long_run` it allows for what the fit has taken out of the
    residuals of a short record, and for every correlation within a block. What one block alone
    determines would blow up; the factors 1 / (1 - leverage) stop at ``most``.

    Args:
        J: Jacobian, whitened, (n, k, p).
        e: residuals, whitened, (n, k).
        inverse: of the information A of all data and priors, its part for these parameters, (p, p).
        block: samples of a block.
        most: largest factor.
    """
    size = J.shape[2]
    L = np.linalg.cholesky(inverse)
    scores = []
    for rows in np.array_split(np.arange(len(e)), max(2, len(e) // max(block, 1))):
        flat = J[rows].reshape(-1, size)
        leverage, V = np.linalg.eigh(L.T @ (flat.T @ flat) @ L)
        factor = 1.0 / np.maximum(1.0 - leverage, 1.0 / most)
        scores.append(V @ (factor * (V.T @ (L.T @ (flat.T @ e[rows].ravel())))))
    s = np.linalg.solve(L.T, np.array(scores).T)
    return np.asarray(s @ s.T)


def at_least(cov: Floats, other: Floats) -> Floats:
    """Return ``cov`` with no variance below that of ``other``, correlations as they are."""
    grow = np.sqrt(np.maximum(1.0, np.diag(other) / np.maximum(np.diag(cov), 1e-300)))
    return cov * np.outer(grow, grow)


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
