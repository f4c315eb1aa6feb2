"""Tall columns as small ones: every axis' rows reduced to coordinates that keep all lengths.

A QR factorisation finds the few dozen directions of an axis' fixed columns and effort; columns that move are split
into their part in it and the R factor of the rest. An evaluation of a variable projection is a few thin products with
sparse columns and R^-1 in the place of Q (corrected seminormal equations: Björck 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy
from scipy.sparse import csr_array

from pinotwin.arrays import Floats, Ints
from pinotwin.solve.linear import Reduced
from pinotwin.solve.moving import Moving
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import r_factor

RANK = 1e-12  # Directions shorter than this, relative to the longest scaled one, are dropped


@dataclass(frozen=True)
class Span:
    """A space of directions of one axis, with the coordinates of the columns in it."""

    # columns (n, c), and what makes directions of them, shape (c, k)
    parts: tuple[tuple[Floats | csr_array, Floats], ...]
    coordinates: Floats  # of the columns named by ``index``, shape (k, c)
    index: Ints  # number of each column among all columns (see :class:`Projection`), shape (c,)

    @classmethod
    def of(cls, problem: Problem, part: slice, *, effort: bool = True) -> Self:
        """Return the span of the columns, and the effort, of a slice of rows; empty columns are left out."""
        own, R = problem.triangle(part)
        index = np.append(own, problem.parameters) if effort else own
        _, root, coordinates = directions(R[:, : len(index)])
        starts = problem.W.indptr[part.start : part.stop + 1]
        some, shape = slice(starts[0], starts[-1]), (len(starts) - 1, problem.parameters)
        if 2 * (starts[-1] - starts[0]) > shape[0] * len(own):  # a dense product is faster
            return cls(((problem.dense(part)[1][:, : len(index)], root),), coordinates, index)
        wide, W = np.zeros((shape[1] + 1, root.shape[1])), csr_array(shape)
        wide[index] = root
        W.data, W.indices, W.indptr = problem.W.data[some], problem.W.indices[some], starts - starts[0]
        parts = ((W, wide[:-1]), (problem.y[part, None], wide[-1:]))
        return cls(parts, coordinates, index)

    def across(self, columns: Floats) -> Floats:
        """Return the products of all directions with columns (n, m), shape (k, m)."""
        return np.asarray(sum(root.T @ (tall.T @ columns) for tall, root in self.parts))

    def along(self, coordinates: Floats) -> Floats:
        """Return the columns, (n, m), of coordinates (k, m)."""
        return np.asarray(sum(tall @ (root @ coordinates) for tall, root in self.parts))

    def split(self, columns: Floats) -> tuple[Floats, Floats]:
        """Return the columns' coordinates within the span and their remainder outside it."""
        inside = self.across(columns)
        rest = columns - self.along(inside)
        again = self.across(rest)
        return inside + again, rest - self.along(again)

    def small(self, columns: Floats, index: Ints, width: int) -> Floats:
        """Return the span's columns and ``columns`` in small coordinates, shape (m, width)."""
        k = len(self.coordinates)
        out = np.zeros((k + len(index), width))
        out[:k, self.index] = self.coordinates
        if len(index):
            inside, rest = self.split(columns)
            out[:k, index] = inside
            R = np.linalg.qr(rest, mode="r")
            out[k : k + len(R), index] = R
        return out

    def wider(self, columns: Floats, index: Ints) -> Span:
        """Return the span with more columns in it."""
        if not len(index):
            return self
        inside, rest = self.split(columns)
        _, root, outside = directions(r_factor(rest))
        k, e = len(inside), len(outside)
        wide = tuple((tall, np.pad(own, ((0, 0), (0, e)))) for tall, own in self.parts)
        parts = (*wide, (rest, np.pad(root, ((0, 0), (k, 0)))))
        if all(isinstance(tall, np.ndarray) for tall, _ in parts):
            parts = ((np.hstack([tall for tall, _ in parts]), np.vstack([own for _, own in parts])),)
        coordinates = np.block([[self.coordinates, inside], [np.zeros((e, len(self.index))), outside]])
        return Span(parts, coordinates, np.concatenate([self.index, index]))


def directions(A: Floats) -> tuple[Floats, Floats, Floats]:
    """Return Q, (m, k), of orthonormal columns, and F and C with Q = A F and A = Q C, the same for all A of one A'A."""
    length = np.linalg.norm(A, axis=0)
    used = np.flatnonzero(length > 0)
    Q, T, pivot = scipy.linalg.qr(A[:, used] / length[used], mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(T)) > RANK))
    F, C, at = np.zeros((A.shape[1], rank)), np.zeros((rank, A.shape[1])), used[pivot]
    F[at[:rank]] = scipy.linalg.solve_triangular(T[:rank, :rank], np.eye(rank)) / length[at[:rank], None]
    C[:, at] = T[:rank] * length[at]
    return Q[:, :rank], F, C


@dataclass(frozen=True)
class Projection:
    """A problem with moving blocks, its fixed columns projected once: columns are fixed, effort, block by block."""

    parts: tuple[slice, ...]  # rows of each axis
    spans: tuple[Span, ...]  # per axis, the span of fixed columns and effort
    moving: tuple[Moving, ...]  # the blocks
    # per block, per axis (its place in ``parts``), what picks its rows; None where they are all rows of the axis
    placed: tuple[dict[int, csr_array | None], ...]
    first: tuple[int, ...]  # number of the first column of each block, and last the number of columns
    fixed: int  # number of fixed columns

    @classmethod
    def of(cls, problem: Problem, moving: Sequence[Moving]) -> Self:
        """Return the projection of a problem whose regressor holds the fixed columns."""
        parts = tuple(problem.slices.values())
        p0 = problem.parameters
        spans = tuple(Span.of(problem, s) for s in parts)
        placed, every = [], np.arange(len(problem.y))
        for block in moving:
            rows = every[block.rows]
            picks = csr_array((np.ones(len(rows)), (rows, every[: len(rows)])), (len(every), len(rows)))
            own = {i: x for i, s in enumerate(parts) if (x := picks[s]).nnz}
            square = {i for i, x in own.items() if x.shape[0] == len(rows)}
            whole = {i for i in square if np.array_equal(own[i].indices, every[: len(rows)])}
            placed.append({i: None if i in whole else x for i, x in own.items()})
        counts = [len(m.names) for m in moving]
        first = tuple(int(k) for k in p0 + 1 + np.concatenate([[0], np.cumsum(counts)]))
        return cls(parts, spans, tuple(moving), tuple(placed), first, p0)

    @property
    def width(self) -> int:
        """Number of columns: fixed, effort, moving."""
        return self.first[-1]

    def split(self, x: Floats) -> list[Floats]:
        """Return the search coordinates of each block, of those of all, shape (s,)."""
        return np.split(x, np.cumsum([len(m.shapes) for m in self.moving])[:-1])

    def numbers(self, b: int) -> Ints:
        """Return the numbers of a block's columns."""
        return np.arange(self.first[b], self.first[b + 1])

    def small(self, pieces: Sequence[tuple[int, Floats, Ints]], sigma: Floats, width: int) -> Floats:
        """Return all columns in small coordinates, axes divided by their levels ``sigma``, shape (m, width)."""
        out = []
        for i, span in enumerate(self.spans):
            columns, index = self.on_axis(i, pieces)
            out.append(span.small(columns, index, width) / sigma[i])
        return np.concatenate(out)

    def reduced(self, columns: Sequence[Floats] | None = None) -> Reduced:
        """Return the factors of the fixed columns and the effort, and between them those of all blocks if given."""
        pieces = [(b, C, self.numbers(b)) for b, C in enumerate(columns or ())]
        width = self.fixed + 1 if columns is None else self.width
        order = [*np.delete(np.arange(width), self.fixed), self.fixed]
        factors = [span.small(*self.on_axis(i, pieces), width)[:, order] for i, span in enumerate(self.spans)]
        return Reduced(tuple(factors), tuple(s.stop - s.start for s in self.parts))

    def on_axis(self, i: int, pieces: Sequence[tuple[int, Floats, Ints]]) -> tuple[Floats, Ints]:
        """Return the moving columns that touch an axis, on all its rows, and their numbers."""
        n = self.parts[i].stop - self.parts[i].start
        mine = [(self.placed[b][i], C, k) for b, C, k in pieces if i in self.placed[b]]
        here = [(C if place is None else place @ C, k) for place, C, k in mine]
        if not here:
            return np.zeros((n, 0)), np.zeros(0, int)
        return np.concatenate([c for c, _ in here], axis=1), np.concatenate([k for _, k in here])
