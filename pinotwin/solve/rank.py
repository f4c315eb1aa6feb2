"""Which directions of theta the data determine, and what to do about the others.

A pivoted QR of the scaled R factor splits the parameters' space into what the data see and a null space (Golub & Van
Loan 2013, section 5.4), where theta stays nearest the prior, in units of inverse column length. A parameter without a
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

    root: Floats  # F with F F' = (W'W)^+ in units of ``unit``, shape (p, rank)
    null: Floats  # basis of the unseen directions, orthonormal in these units, shape (p, p - rank)
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
        return ~self.empty & (np.sum(self.null**2, axis=1) < LINKED)

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Parameters that cannot be distinguished, each group ascending."""
        index = np.flatnonzero(~self.determined & ~self.empty)
        if not len(index):
            return ()
        tied = np.abs(self.null[index] @ self.null[index].T) > LINKED
        count, label = scipy.sparse.csgraph.connected_components(tied, directed=False)
        return tuple(tuple(index[label == k].tolist()) for k in range(count))

    def nearest(self, delta: Floats) -> Floats:
        """Return ``delta`` without its component in the unseen directions."""
        return delta - self.unit * (self.null @ (self.null.T @ (delta / self.unit)))


def analyse(R: Floats, tolerance: float) -> Rank:
    """Split the parameters' space of a factor R (k, p), by the smallest pivot relative to the largest."""
    p = R.shape[1]
    length = np.linalg.norm(R, axis=0)
    empty = length <= EMPTY * length.max(initial=0.0)
    used = np.flatnonzero(~empty)
    unit = np.where(empty, 1.0, 1.0 / np.where(empty, 1.0, length))
    if not len(used):
        return Rank(np.zeros((p, 0)), np.eye(p), unit, empty, np.zeros((0, 0)))
    T, pivot = scipy.linalg.qr(R[:, used] * unit[used], mode="r", pivoting=True)[0:2]
    diagonal = np.abs(np.diag(T))
    rank = int(np.sum(diagonal > tolerance * diagonal[0]))
    order = np.append(used[pivot], np.flatnonzero(empty))
    root, unseen = np.zeros((p, rank)), np.zeros((p, p - rank))
    root[order[:rank]] = scipy.linalg.solve_triangular(T[:rank, :rank], np.eye(rank))
    unseen[order[rank:]] = np.eye(p - rank)
    unseen[:, : len(used) - rank] -= root @ T[:rank, rank:]
    null = np.linalg.qr(unseen)[0]
    root = unit[:, None] * (root - null @ (null.T @ root))
    return Rank(root, null, unit, empty, T[:rank])
