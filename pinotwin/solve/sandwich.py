"""Covariance of parameters with coloured residuals, A^-1 S A^-1, on one time axis without gaps.

``A = J'J`` is the information, S the covariance of the sum of the scores ``s(t) = J(t)' e(t)``; that of a plant, with
gaps and several axes, is in :mod:`pinotwin.solve.covariance`.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.solve.jackknife import moved


def sandwich(scores: Floats, information: Floats, lag: int) -> Floats:
    """Return the covariance of parameters, (p, p), from scores J' r (n, p) correlated over ``lag`` samples."""
    inverse = np.linalg.inv(information)
    return inverse @ long_run(scores, lag) @ inverse


def long_run(scores: Floats, lag: int) -> Floats:
    """Return the covariance of the sum of correlated scores (n, p), triangular window, (p, p).

    Newey & West 1987, doi:10.2307/1913610.
    """
    window = min(lag, len(scores) - 1) + 1
    return bartlett(np.pad(scores, ((0, window), (0, 0))), window)


def bartlett(scores: Floats, window: int, chunk: int = 1 << 16) -> Floats:
    """Return the sum of lagged products of even scores (n, p) under a triangular window, (p, p), by ``chunk`` windows.

    Scores, with ``window`` rows of zeros after every stretch, are overwritten: an hour of five axes fills a gigabyte.
    """
    np.cumsum(scores, axis=0, out=scores)
    total = scores[:window].T @ scores[:window]
    for start in range(window, len(scores), chunk):
        stop = min(start + chunk, len(scores))
        sums = scores[start:stop] - scores[start - window : stop - window]
        total += sums.T @ sums
    return np.asarray(total / window)


def block_covariance(columns: Floats, residual: Floats) -> Floats:
    """Return the block-robust covariance (p, p) of a fit with columns (n, p) that leaves a residual (n,)."""
    own, _ = batch_means(columns.T @ columns, columns * residual[:, None], columns.shape[1], len(residual))
    return own


def batch_means(H: Floats, S: Floats, leading: int, count: int) -> tuple[Floats, int]:
    """Return covariance and number of blocks from H and the scores S (n, p) of ``count`` rows.

    The block length follows the memory of the influence on the first ``leading`` parameters (Liang & Zeger 1986,
    doi:10.1093/biomet/73.1.13, with time blocks as clusters).
    """
    size = np.sqrt(np.diag(H))
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(H / np.outer(size, size), rcond=1e-12, hermitian=True)
    influence = S @ (inverse / np.outer(size, size))
    sums = np.add.reduceat(influence, np.arange(0, len(influence), block_length(influence[:, :leading])))
    blocks = len(sums)
    few = blocks / max(blocks - 1, 1) * count / max(count - len(H), 1)
    return few * sums.T @ sums, blocks


def block_length(influence: Floats, fewest: int = 20) -> int:
    """Return five integrated autocorrelation times, at most the rows over the fewest blocks.

    By the initial positive sequence (Geyer 1992, doi:10.1214/ss/1177011137).
    """
    n = len(influence)
    longest = max(n // fewest, 1)
    padded = 1 << (2 * n - 1).bit_length()
    power = np.abs(np.fft.rfft(influence - influence.mean(axis=0), padded, axis=0)) ** 2
    correlation = np.fft.irfft(power, padded, axis=0)[: longest + 1]
    correlation = correlation / np.maximum(correlation[0], 1e-300)
    pairs = correlation[0 : longest - longest % 2 : 2] + correlation[1 : longest + 1 : 2][: longest // 2]
    times = [1.0]
    for column in pairs.T:
        stop = np.flatnonzero(column <= 0.0)
        times.append(2.0 * float(np.sum(column[: stop[0] if len(stop) else None])) - 1.0)
    return int(np.clip(np.ceil(5.0 * max(times)), 1, longest))


def left_out(J: Floats, e: Floats, inverse: Floats, block: int) -> Floats:
    """Return S of A^-1 S A^-1, (p, p), by leaving out blocks of samples in turn; J (n, k, p) and e (n, k) are white.

    See :mod:`pinotwin.solve.covariance`; ``inverse`` is that of A, (p, p).
    """
    L = np.linalg.cholesky(inverse)
    each = np.array_split(np.arange(len(e)), max(2, len(e) // max(block, 1)))
    scores = [moved(J[rows].reshape(-1, J.shape[2]) @ L, e[rows].ravel(), 0.25) for rows in each]
    s = np.linalg.solve(L.T, np.array(scores).T)
    return np.asarray(s @ s.T)


def at_least(cov: Floats, other: Floats) -> Floats:
    """Return ``cov`` with no variance below that of ``other``, correlations as they are."""
    grow = np.sqrt(np.maximum(1.0, np.diag(other) / np.maximum(np.diag(cov), 1e-300)))
    return cov * np.outer(grow, grow)
