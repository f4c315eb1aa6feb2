"""A linear least-squares problem whose rows remember which axis and which instant they belong to.

    y[r] = W[r] @ theta + e[r],    row r = (axis, block, time)

Every axis so has its own noise level, and the covariance respects that neighbouring residuals are alike: within a
*block*, a stretch of one log, whose missing rows leave a hole in its time axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError


@dataclass(frozen=True)
class Problem:
    """Rows of one linear problem, sorted by axis, then block, then time."""

    W: Floats  # regressor, shape (rows, p)
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
            if len(getattr(self, name)) != rows:
                raise DataError(f"{name} has {len(getattr(self, name))} rows, y has {rows}")
        if rows == 0:
            raise DataError("no rows left to fit: relax the data selection or record more motion")
        if not (np.isfinite(self.W).all() and np.isfinite(self.y).all()):
            raise DataError("regressor or effort holds NaN or infinite values; select the rows first")
        key = np.stack([self.axis, self.block, self.time])
        step = np.diff(key, axis=1)
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

    @cached_property
    def filled(self) -> dict[int, Ints]:
        """Columns that are not empty in the rows of each axis: those of an axis' own table are, in all others'."""
        return {i: np.flatnonzero(self.W[part].any(axis=0)) for i, part in self.slices.items()}

    @cached_property
    def grid(self) -> Grid:
        """The uniform time axis on which the rows of all axes lie."""
        return Grid.of(self.block, self.time)

    def seconds(self, few: int = 12) -> Iterator[dict[int, slice]]:
        """Yield the rows of each axis second by second, or by shorter blocks.

        They are at least ``few``, and as many as an axis has columns: a knot of a table is passed in a moment. But
        they are no shorter than a twentieth of a second, for neighbours are alike.
        """
        grid, lengths = self.grid, np.array(self.grid.lengths)
        second, most = self.second / grid.step, max(few, *map(len, self.filled.values()))
        longest = max(min(second, max(grid.times / most, second / 20 if np.isfinite(second) else 1.0)), 1.0)
        count = np.maximum(np.round(lengths / longest), 1).astype(int)
        place = (np.cumsum(count) - count)[grid.block] + grid.slot * count[grid.block] // lengths[grid.block]
        starts = np.arange(count.sum() + 1)
        edges = {i: part.start + np.searchsorted(place[part], starts) for i, part in self.slices.items()}
        for k in np.unique(place):
            yield {i: slice(int(edge[k]), int(edge[k + 1])) for i, edge in edges.items()}

    def rows(self, keep: Mask) -> Self:
        """Return the problem of the rows marked True in ``keep``, shape (rows,)."""
        kept = {k: getattr(self, k)[keep] for k in ("W", "y", "axis", "time", "block")}
        return replace(self, **kept, turning=None if self.turning is None else self.turning[keep])

    def with_columns(self, W: Floats, names: Sequence[str]) -> Self:
        """Return the same rows with another regressor."""
        return replace(self, W=W, names=tuple(names))


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
        pairs = np.unique(np.stack([block, time], axis=1), axis=0)
        same = pairs[1:, 0] == pairs[:-1, 0]
        gaps = np.diff(pairs[:, 1])[same]
        step = int(np.gcd.reduce(gaps)) if len(gaps) else 1
        numbers, place = np.unique(block, return_inverse=True)
        first = np.array([pairs[pairs[:, 0] == b, 1].min() for b in numbers])
        slot = (time - first[place]) // max(step, 1)
        lengths = np.zeros(len(numbers), int)
        np.maximum.at(lengths, place, slot + 1)
        return cls(slot, place, tuple(int(x) for x in lengths), len(pairs), max(step, 1))

    def starts(self, padding: int) -> Ints:
        """First slot of each block when ``padding`` empty slots follow every block."""
        sizes = np.array(self.lengths) + padding
        return np.concatenate([[0], np.cumsum(sizes)])

    def spread(self, values: Floats, padding: int) -> Floats:
        """Add row values (rows, k) into the slots of the grid, some empty ones after every block, shape (slots, k)."""
        starts = self.starts(padding)
        index = starts[self.block] + self.slot
        rows = np.arange(len(index))
        adder = scipy.sparse.csr_array((np.ones(len(index)), (index, rows)), (int(starts[-1]), len(index)))
        return np.asarray(adder @ values)
