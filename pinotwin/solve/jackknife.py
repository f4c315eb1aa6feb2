"""Least squares with every block of rows left out in turn.

For rows ``y = X theta`` cut into K blocks of time, the products ``X_k'X_k`` and ``X_k'y_k`` of each block
are all that a fit to any choice of blocks needs. The spread of the fits without one block (Quenouille 1956;
Efron 1982, chapter 2) is the covariance of the fit to all, whatever the colour of what is left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats


def without_each(X: Floats, y: Floats, blocks: Sequence[slice], ridge: float) -> Floats:
    """Return theta of X (n, p) and y (n,) without each block in turn, and last of all, shape (K + 1, p).

    A ridge is added to columns scaled to one.
    """
    N, g = np.array([X[b].T @ X[b] for b in blocks]), np.array([X[b].T @ y[b] for b in blocks])
    N, g = (np.concatenate([x.sum(axis=0) - x, x.sum(axis=0)[None]]) for x in (N, g))
    size = np.sqrt(np.mean(X**2, axis=0))
    scale = np.where(size == 0.0, 1.0, size) * np.sqrt(len(X))
    scaled = N / np.outer(scale, scale) + ridge * np.eye(X.shape[1])
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
