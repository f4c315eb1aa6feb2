"""A linear least-squares problem whose rows remember which axis and which instant they belong to.

    y[r] = W[r] @ theta + e[r],    row r = (axis, block, time)

Every axis so has its own noise level, and the covariance respects that neighbouring residuals are alike: within a
*block*, a stretch of one log, whose missing rows leave a hole in its time axis. W is sparse, as the columns of a table
are; the few rows that a step needs at a time are made dense, without the columns that are empty there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.sparse import csr_array, hstack

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError
from pinotwin.solve.rank import BLOCK, r_factor


@dataclass(frozen=True)
class Problem:
    """Rows of one linear problem, sorted by axis, then block, then time."""

    W: csr_array  # regressor, shape (rows, p)
    y: Floats  # measured effort, shape (rows,)
    axis: Ints  # axis number of each row, ascending, shape (rows,)
    time: Ints  # sample index of each row; lags are differences of it, shape (rows,)
    names: tuple[str, ...]  # name of every parameter, length p
    block: Ints  # identity of the unbroken stretch each row belongs to, shape (rows,)
    second: float = np.inf  # samples of ``time`` in a second; inf where nobody knows
    turning: Mask | None = None  # rows after a turn, where a law of dry friction is least true, shape (rows,)

    def __post_init__(self) -> None:
        rows = len(self.y)
        if self.W.ndim != 2 or self.W.shape[1] != len(self.names):
            raise DataError(f"regressor has shape {self.W.shape} for {len(self.names)} named parameters")
        for name in ("W", "axis", "time", "block"):
            if (count := getattr(self, name).shape[0]) != rows:
                raise DataError(f"{name} has {count} rows, y has {rows}")
        if rows == 0:
            raise DataError("no rows left to fit: relax the data selection or record more motion")
        if not (np.isfinite(self.W.data).all() and np.isfinite(self.y).all()):
            raise DataError("regressor or effort holds NaN or infinite values; select the rows first")
        step = [np.diff(key) for key in (self.axis, self.block, self.time)]
        later = (step[0] > 0) | ((step[0] == 0) & ((step[1] > 0) | ((step[1] == 0) & (step[2] > 0))))
        if not later.all():
            raise DataError("rows must be sorted by axis, then block, then strictly increasing time")

    @property
    def parameters(self) -> int:
        """Number of parameters p."""
        return self.W.shape[1]

    @cached_property
    def slices(self) -> dict[int, slice]:
        """Rows of each axis that has any, keyed by axis number."""
        numbers, first = np.unique(self.axis, return_index=True)
        ends = [*first[1:], len(self.axis)]
        return {int(i): slice(int(a), int(b)) for i, a, b in zip(numbers, first, ends, strict=True)}

    @cached_property
    def axis_place(self) -> Ints:
        """Place of each row's axis in :attr:`slices`, shape (rows,)."""
        return np.searchsorted(np.array(list(self.slices)), self.axis)

    def dense(self, rows: slice | Ints, right: Floats | None = None) -> tuple[Ints, Floats]:
        """Return the columns, (k,), that are not empty in some rows, and dense [W y] there, or ``right`` for y."""
        y, first = (self.y if right is None else right)[rows], self.W.indptr[:-1][rows]
        count = self.W.indptr[1:][rows] - first
        at: slice | Ints
        if isinstance(rows, slice):
            at = slice(*self.W.indptr[[rows.start, rows.stop]])
        else:
            at = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
        columns, seen = self.W.indices[at], np.zeros(self.parameters, dtype=bool)
        seen[columns] = True
        out = np.zeros((len(y), np.count_nonzero(seen) + 1))
        starts = np.repeat(np.arange(0, out.size, out.shape[1]), count)
        out.reshape(-1)[starts + (np.cumsum(seen) - 1)[columns]] = self.W.data[at]
        out[:, -1] = y
        return np.flatnonzero(seen), out

    def triangle(self, part: slice) -> tuple[Ints, Floats]:
        """Return the columns, (k,), that are not empty in a slice of rows, and R of [W y], shape (k + 1, k + 1)."""
        factors = [np.zeros((0, self.parameters + 1))]
        for start in range(part.start, part.stop, BLOCK):  # in which few places of a table are passed
            own, A = self.dense(slice(start, min(start + BLOCK, part.stop)))
            R = r_factor(A)
            if len(A) == part.stop - part.start:
                return own, R
            factors.append(np.zeros((len(R), self.parameters + 1)))
            factors[-1][:, [*own, -1]] = R
        F = np.concatenate(factors)
        own = np.flatnonzero(F[:, :-1].any(axis=0))
        return own, r_factor(F[:, [*own, -1]])

    @cached_property
    def grid(self) -> Grid:
        """The uniform time axis on which the rows of all axes lie."""
        return Grid.of(self.block, self.time)

    def seconds(self, few: int = 12) -> Iterator[dict[int, slice]]:
        """Yield the rows of each axis second by second, or by shorter blocks.

        They are at least ``few``, and as many as an axis has columns: a knot of a table is passed in a moment. But
        they are no shorter than a twentieth of a second, for neighbours are alike.
        """
        grid, lengths, W = self.grid, np.array(self.grid.lengths), self.W
        acting = [np.unique(W.indices[W.indptr[s.start] : W.indptr[s.stop]]) for s in self.slices.values()]
        second, most = self.second / grid.step, max(few, *map(len, acting))
        longest = max(min(second, max(grid.times / most, second / 20 if np.isfinite(second) else 1.0)), 1.0)
        count = np.maximum(np.round(lengths / longest), 1).astype(int)
        place = (np.cumsum(count) - count)[grid.block] + grid.slot * count[grid.block] // lengths[grid.block]
        starts = np.arange(count.sum() + 1)
        edges = {i: part.start + np.searchsorted(place[part], starts) for i, part in self.slices.items()}
        for k in np.unique(place):
            yield {i: slice(int(edge[k]), int(edge[k + 1])) for i, edge in edges.items()}

    def rows(self, keep: Mask) -> Self:
        """Return the problem of the rows marked True in ``keep``, shape (rows,)."""
        if keep.all():
            return self
        kept = {k: getattr(self, k)[keep] for k in ("W", "y", "axis", "time", "block")}
        return replace(self, **kept, turning=None if self.turning is None else self.turning[keep])

    def with_columns(self, W: csr_array, names: Sequence[str]) -> Self:
        """Return the same rows with another regressor."""
        return replace(self, W=W, names=tuple(names))

    def beside(self, columns: Floats, names: Sequence[str]) -> Self:
        """Return the same rows with more columns, shape (rows, n)."""
        count, names = np.count_nonzero(columns, axis=1), (*self.names, *names)
        starts = self.W.indptr + np.append(0, np.cumsum(count)).astype(self.W.indptr.dtype)
        values, index = np.empty(starts[-1]), np.empty(starts[-1], self.W.indices.dtype)
        for start in range(0, len(self.y), 8 * BLOCK):  # scipy's own copies are several times as large
            rows = slice(start, min(start + 8 * BLOCK, len(self.y)))
            some = hstack([self.W[rows], csr_array(columns[rows])], format="csr")
            where = slice(starts[rows.start], starts[rows.stop])
            values[where], index[where] = some.data, some.indices
        return self.with_columns(csr_array((values, index, starts), (len(self.y), len(names))), names)


@dataclass(frozen=True)
class Grid:
    """Slots of a uniform time axis, one block after the other."""

    slot: Ints  # slot of each row inside its block, shape (rows,)
    block: Ints  # place of each row's block in ``lengths``, shape (rows,)
    lengths: tuple[int, ...]  # number of slots of each block, holes included
    times: int  # number of distinct instants that hold at least one row
    step: int  # samples from slot to slot

    @classmethod
    def of(cls, block: Ints, time: Ints) -> Self:
        """Return the grid of rows given by block and sample index."""
        numbers, place = np.unique(block, return_inverse=True)
        instants = np.unique(place * (far := int(time.max()) + 1) + time)
        owner = instants // far
        gaps = np.diff(instants)[np.diff(owner) == 0]
        step = max(int(np.gcd.reduce(gaps)) if len(gaps) else 1, 1)
        edges = np.searchsorted(owner, np.arange(len(numbers) + 1))
        first, last = instants[edges[:-1]] % far, instants[edges[1:] - 1] % far
        lengths = tuple(((last - first) // step + 1).tolist())
        return cls((time - first[place]) // step, place, lengths, len(instants), step)

    def starts(self, padding: int) -> Ints:
        """First slot of each block when ``padding`` empty slots follow every block."""
        sizes = np.array(self.lengths) + padding
        return np.concatenate([[0], np.cumsum(sizes)])

    def spread(self, values: Floats, padding: int) -> Floats:
        """Add row values (rows, k) into the slots of the grid, some empty ones after every block, shape (slots, k)."""
        starts = self.starts(padding)
        index = starts[self.block] + self.slot
        rows = np.arange(len(index))
        adder = csr_array((np.ones(len(index)), (index, rows)), (int(starts[-1]), len(index)))
        return np.asarray(adder @ values)
