"""Least squares from block sums: with every block left out in turn, and with all.

For rows ``y = X theta`` cut into K blocks of time, the products ``X_k'X_k`` and ``X_k'y_k`` of each block
are all that a fit to any choice of blocks needs. The spread of the fits without one block (Quenouille 1956;
Efron 1982, chapter 2) is the covariance of the fit to all, whatever the colour of what is left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats


def block_sums(X: Floats, y: Floats, blocks: Sequence[slice]) -> tuple[Floats, Floats]:
    """Return X'X and X'y of every block, shapes (K, p, p) and (K, p)."""
    N = np.array([X[b].T @ X[b] for b in blocks])
    return N, np.array([X[b].T @ y[b] for b in blocks])


def without_each(sums: Floats) -> Floats:
    """Return block sums (K, ...) over all blocks but one, and last over all, shape (K + 1, ...)."""
    total = sums.sum(axis=0)
    return np.concatenate([total - sums, total[None]])


def solved(N: Floats, g: Floats, ridge: float, scale: Floats | None = None) -> Floats:
    """Return the solutions, shape (K, p), of N (K, p, p) and g; a ridge is added to columns scaled to one."""
    if scale is None:
        scale = np.sqrt(np.maximum(np.diagonal(N[-1]), 1e-300))
    scaled = N / np.outer(scale, scale) + ridge * np.eye(N.shape[1])
    return np.asarray(np.linalg.solve(scaled, (g / scale)[:, :, None])[:, :, 0] / scale)


def moved(V: Floats, e: Floats, least: float = 0.5, power: float = 1.0) -> Floats:
    """Return (I - V'V)^-power V'e, (p,): how far a fit of orthonormal columns moves without the rows V (n, p), e (n,).

    Of no direction they count for more than all but the share ``least``: the other rows know too little of it.
    """
    few = len(V) <= V.shape[1]
    leverage, U = np.linalg.eigh(V @ V.T if few else V.T @ V)
    e = U @ (U.T @ (e if few else V.T @ e) / np.maximum(1.0 - leverage, least) ** power)
    return np.asarray(V.T @ e if few else e)


def jackknife(each: Floats) -> Floats:
    """Return the covariance of an estimate from what it was without each block, (K, p) -> (p, p)."""
    d = each - each.mean(axis=0)
    return np.asarray((len(each) - 1) / len(each) * d.T @ d)
