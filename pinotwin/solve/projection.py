"""Tall columns as small ones: every axis' rows reduced to coordinates that keep all lengths.

A QR factorisation finds the few dozen directions of an axis' fixed columns and effort; columns that move are split
into their part in it and the R factor of the rest. An evaluation of a variable projection is a few thin products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.solve.linear import Reduced
from pinotwin.solve.moving import Moving
from pinotwin.solve.problem import Problem

RANK = 1e-12  # Directions shorter than this, relative to the longest scaled one, are dropped


@dataclass(frozen=True)
class Placed:
    """Where the rows of a moving block lie among the rows of one axis."""

    own: Ints  # rows of the block that belong to the axis
    there: Ints  # the same rows, counted within the axis
    whole: bool  # whether they are all rows of the axis, in order

    @classmethod
    def of(cls, rows: Ints, part: slice) -> Self:
        """Return the place of stacked row numbers ``rows`` within an axis' slice."""
        own = np.flatnonzero((rows >= part.start) & (rows < part.stop))
        there = rows[own] - part.start
        n = part.stop - part.start
        whole = len(own) == n == len(rows) and bool(np.all(there == np.arange(n)))
        return cls(own, there, whole)

    def take(self, columns: Floats, n: int) -> Floats:
        """Return the block's columns on all ``n`` rows of the axis."""
        if self.whole:
            return columns
        out = np.zeros((n, columns.shape[1]))
        out[self.there] = columns[self.own]
        return out


@dataclass(frozen=True)
class Span:
    """A space of directions of one axis, with the coordinates of the columns in it."""

    basis: Floats  # orthonormal, shape (n, k)
    coordinates: Floats  # of the columns named by ``index``, shape (k, c)
    index: Ints  # number of each column among all columns (see :class:`Projection`), shape (c,)

    @classmethod
    def of(cls, columns: Floats, index: Ints) -> Self:
        """Return the span of columns; empty columns are left out."""
        length = np.linalg.norm(columns, axis=0)
        used = length > 0
        columns, index, length = columns[:, used], index[used], length[used]
        if not len(index):
            return cls(np.zeros((len(columns), 0)), np.zeros((0, 0)), index)
        Q, R, pivot = scipy.linalg.qr(columns / length, mode="economic", pivoting=True)
        rank = int(np.sum(np.abs(np.diag(R)) > RANK))
        coordinates = np.empty((rank, len(index)))
        coordinates[:, pivot] = R[:rank] * length[pivot]
        return cls(np.ascontiguousarray(Q[:, :rank]), coordinates, index)

    def split(self, columns: Floats) -> tuple[Floats, Floats]:
        """Return the columns' coordinates within the span and their remainder outside it."""
        inside = self.basis.T @ columns
        rest = columns - self.basis @ inside
        again = self.basis.T @ rest
        return inside + again, rest - self.basis @ again

    def small(self, columns: Floats, index: Ints, width: int) -> Floats:
        """Return the span's columns and ``columns`` in small coordinates, shape (m, width)."""
        out = np.zeros((len(self.basis.T) + len(index), width))
        k = self.basis.shape[1]
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
        extra = Span.of(rest, np.arange(len(index)))
        k, e = self.basis.shape[1], extra.basis.shape[1]
        coordinates = np.zeros((k + e, len(self.index) + len(index)))
        coordinates[:k, : len(self.index)] = self.coordinates
        coordinates[:k, len(self.index) :] = inside
        coordinates[k:, len(self.index) + extra.index] = extra.coordinates
        return Span(
            np.concatenate([self.basis, extra.basis], axis=1),
            coordinates,
            np.concatenate([self.index, index]),
        )


@dataclass(frozen=True)
class Projection:
    """A problem with moving blocks, its fixed columns projected once: columns are fixed, effort, block by block."""

    parts: tuple[slice, ...]  # rows of each axis
    spans: tuple[Span, ...]  # per axis, the span of fixed columns and effort
    moving: tuple[Moving, ...]  # the blocks
    placed: tuple[dict[int, Placed], ...]  # per block, per axis (its place in ``parts``) where its rows lie
    first: tuple[int, ...]  # number of the first column of each block, and last the number of columns
    fixed: int  # number of fixed columns

    @classmethod
    def of(cls, problem: Problem, moving: Sequence[Moving]) -> Self:
        """Return the projection of a problem whose regressor holds the fixed columns."""
        parts = tuple(problem.slices.values())
        p0 = problem.parameters
        numbers = np.arange(p0 + 1)
        spans = tuple(Span.of(np.column_stack([problem.W[s], problem.y[s]]), numbers) for s in parts)
        placed = []
        every = np.arange(len(problem.y))
        for block in moving:
            rows = every[block.rows]
            found = {i: Placed.of(rows, s) for i, s in enumerate(parts)}
            placed.append({i: place for i, place in found.items() if len(place.own)})
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
        here = [(self.placed[b][i].take(C, n), k) for b, C, k in pieces if i in self.placed[b]]
        if not here:
            return np.zeros((n, 0)), np.zeros(0, int)
        return np.concatenate([c for c, _ in here], axis=1), np.concatenate([k for _, k in here])
