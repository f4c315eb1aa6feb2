"""Which directions of theta the data determine, and what to do about the others.

A pivoted QR of the scaled R factor splits the parameters' space into what the data see and a null space (Golub & Van
Loan 2013, section 5.4), where theta stays nearest the prior, in units of its standard deviation. A parameter without a
component there is determined; those that it ties together form a group that these data cannot distinguish.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask

BLOCK = 1000  # Rows per block: small enough for the cache, large enough for the call


def r_factor(A: Floats, block: int = BLOCK) -> Floats:
    """Return upper triangular R with R'R = A'A, shape (k, k), for A of shape (rows, k), be they few or many.

    Block by block, R = qr([qr(A1).R; qr(A2).R; ...]).R (Demmel, Grigori, Hoemmen & Langou 2012, doi:10.1137/080731992):
    it is all that least squares needs of ``[W y]``; W'W would square the condition number.
    """
    rows, k = A.shape
    block = max(block, 4 * k)
    while rows > 2 * block:
        count = rows // block
        A = np.concatenate([*map(_qr, A[: count * block].reshape(count, block, k)), A[count * block :]])
        rows = len(A)
    if rows < k:
        A = np.concatenate([A, np.zeros((k - rows, k))])
    return _qr(A)


def _qr(A: Floats) -> Floats:
    """Return R alone; LAPACK with room for its blocks is twice as fast as numpy."""
    k = A.shape[1]
    return np.triu(scipy.linalg.lapack.dgeqrf(A, lwork=64 * k)[0][:k]) if k else A


EMPTY = 1e-13  # A column shorter than this times the longest one is taken as empty
LINKED = 1e-6  # Entries of the null space's projector above this tie two parameters together


@dataclass(frozen=True, eq=False)
class Rank:
    """The split of the parameters' space into seen and unseen directions."""

    root: Floats  # F with F F' = (W'W)^+ in the prior's metric, shape (p, rank)
    null: Floats  # basis of the unseen directions, orthonormal in that metric, shape (p, p - rank)
    scale: Floats  # the metric, one length per parameter, shape (p,)
    unit: Floats  # inverse length of each column, 1 of an empty one, shape (p,)
    empty: Mask  # parameters whose column is, shape (p,)
    factor: Floats  # of the seen, scaled columns, shape (rank, number of columns that are not empty)

    @property
    def rank(self) -> int:
        """Number of directions that the data determine."""
        return len(self.factor)

    @property
    def unexcited(self) -> tuple[int, ...]:
        """Parameters whose column is empty."""
        return tuple(np.flatnonzero(self.empty).tolist())

    @cached_property
    def condition(self) -> float:
        """Ratio of the largest to the smallest singular value of the seen, scaled columns."""
        if not self.rank:
            return np.inf
        singular = np.linalg.svd(self.factor, compute_uv=False)
        return float(singular[0] / singular[-1])

    @cached_property
    def determined(self) -> Mask:
        """Whether the data determine each parameter, shape (p,)."""
        return ~self.empty & (np.sum(self._unseen**2, axis=1) < LINKED)

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Parameters that cannot be distinguished, each group ascending."""
        index = np.flatnonzero(~self.determined & ~self.empty)
        if not len(index):
            return ()
        tied = np.abs(self._unseen[index] @ self._unseen[index].T) > LINKED
        count, label = scipy.sparse.csgraph.connected_components(tied, directed=False)
        return tuple(tuple(index[label == k].tolist()) for k in range(count))

    @cached_property
    def _unseen(self) -> Floats:
        """Basis of the unseen directions, orthonormal in units of column length, shape (p, p - rank)."""
        return np.linalg.qr(self.null * (self.scale / self.unit)[:, None])[0]

    def nearest(self, delta: Floats) -> Floats:
        """Return ``delta`` without its component in the unseen directions."""
        return delta - self.scale * (self.null @ (self.null.T @ (delta / self.scale)))


def analyse(R: Floats, tolerance: float, scale: Floats | None = None) -> Rank:
    """Split the parameters' space of a factor R (k, p), by the smallest pivot relative to the largest.

    ``scale`` is the length that counts as one unit of each parameter, the inverse column length where not given.
    """
    p = R.shape[1]
    length = np.linalg.norm(R, axis=0)
    empty = length <= EMPTY * length.max(initial=0.0)
    used = np.flatnonzero(~empty)
    unit = np.where(empty, 1.0, 1.0 / np.where(empty, 1.0, length))
    scale = unit if scale is None else np.where(scale > 0, scale, unit)
    if not len(used):
        return Rank(np.zeros((p, 0)), np.eye(p), scale, unit, empty, np.zeros((0, 0)))
    T, pivot = scipy.linalg.qr(R[:, used] * unit[used], mode="r", pivoting=True)[0:2]
    diagonal = np.abs(np.diag(T))
    rank = int(np.sum(diagonal > tolerance * diagonal[0]))
    T11, T12 = T[:rank, :rank], T[:rank, rank:]
    null = _null_space(T11, T12, used[pivot], p, unit, scale, empty)
    root = np.zeros((p, rank))
    root[used[pivot[:rank]]] = scipy.linalg.solve_triangular(T11, np.eye(rank))
    root *= unit[:, None]
    root -= scale[:, None] * (null @ (null.T @ (root / scale[:, None])))
    return Rank(root, null, scale, unit, empty, T[:rank])


def _null_space(
    T11: Floats, T12: Floats, order: Floats, p: int, unit: Floats, scale: Floats, empty: Mask
) -> Floats:
    """Return the basis of the unseen directions, orthonormal in units of ``scale``."""
    rank, missing = T12.shape
    blank = np.flatnonzero(empty)
    basis = np.zeros((p, missing + len(blank)))
    basis[order[:rank], :missing] = -scipy.linalg.solve_triangular(T11, T12) if missing else 0.0
    basis[order[rank:], :missing] = np.eye(missing)
    basis *= unit[:, None]
    basis[blank, missing:] = np.eye(len(blank))
    return np.linalg.qr(basis / scale[:, None])[0]
