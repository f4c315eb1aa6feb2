"""The R factor of a tall matrix, block by block: [A1; A2; ...] = Q R, R = qr([qr(A1).R; qr(A2).R; ...]).R.

Demmel, Grigori, Hoemmen & Langou 2012, doi:10.1137/080731992. It is all that least squares needs of ``[W y]``; W'W
would square the condition number.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats

BLOCK = 1000  # Rows per block: small enough for the cache, large enough for the call


def r_factor(A: Floats, block: int = BLOCK) -> Floats:
    """Return upper triangular R with R'R = A'A, shape (k, k), for A of shape (rows, k), be they few or many."""
    rows, k = A.shape
    block = max(block, 4 * k)
    while rows > 2 * block:
        count = rows // block
        head = _qr(A[: count * block].reshape(count, block, k))
        A = np.concatenate([head.reshape(count * k, k), A[count * block :]])
        rows = len(A)
    if rows < k:
        A = np.concatenate([A, np.zeros((k - rows, k))])
    return _qr(A)


def _qr(A: Floats) -> Floats:
    """Return R alone; numpy's stub does not know what mode "r" returns."""
    return np.asarray(np.linalg.qr(A, mode="r"))
