"""Columns that move with a few shape parameters, and the coordinates of their search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError


@dataclass(frozen=True)
class Moving:
    """One block of columns with shapes: a Stribeck curve, a ripple, a pole pair."""

    name: str  # name of the block, e.g. ``"Y.stribeck"``
    rows: slice | Ints  # rows of the stacked problem on which the columns live; elsewhere they are zero
    columns: Callable[[Floats], Floats]  # from shape values, shape (s,), to columns, shape (rows, p)
    names: tuple[str, ...]  # names of the linear coefficients, length p
    shapes: tuple[str, ...]  # names of the shapes, length s
    lower: Floats  # lower bounds of the shapes, shape (s,)
    upper: Floats  # upper bounds, shape (s,)
    log: Mask  # shapes searched on a logarithmic scale, shape (s,)
    starts: tuple[Floats, ...]  # for each shape the values to try first, ascending, one in every basin

    def __post_init__(self) -> None:
        s = len(self.shapes)
        for name in ("lower", "upper", "log", "starts"):
            if len(getattr(self, name)) != s:
                raise DataError(f"{self.name}: {s} shapes but {len(getattr(self, name))} values of {name}")
        if (np.asarray(self.lower) >= np.asarray(self.upper)).any():
            raise DataError(f"{self.name}: a lower bound is not below its upper bound")
        if (np.asarray(self.lower)[np.asarray(self.log, bool)] <= 0).any():
            raise DataError(f"{self.name}: a shape searched on a log scale needs a positive bound")
        if any(len(grid) == 0 for grid in self.starts):
            raise DataError(f"{self.name}: no start value")

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Bounds in search coordinates, each of shape (s,)."""
        return self.search(np.asarray(self.lower, float)), self.search(np.asarray(self.upper, float))

    @cached_property
    def grids(self) -> tuple[Floats, ...]:
        """Start values in search coordinates, ascending and within the bounds."""
        low, high = self.bounds
        out = []
        for k, grid in enumerate(self.starts):
            values = np.clip(np.asarray(grid, float), self.lower[k], self.upper[k])
            out.append(np.unique(np.clip(np.log(values) if self.log[k] else values, low[k], high[k])))
        return tuple(out)

    def search(self, values: Floats) -> Floats:
        """Return search coordinates of shape values."""
        log = np.asarray(self.log, bool)
        return np.where(log, np.log(np.where(log, values, 1.0)), values)

    def values(self, x: Floats) -> Floats:
        """Return shape values of search coordinates."""
        log = np.asarray(self.log, bool)
        plain = np.where(log, np.exp(np.where(log, x, 0.0)), x)
        return np.clip(plain, self.lower, self.upper)

    def at(self, x: Floats) -> Floats:
        """Return the columns at search coordinates, shape (rows, p)."""
        return np.asarray(self.columns(self.values(x)), float)

    def slopes(self, x: Floats, theta: Floats, size: float = 1e-6) -> Floats:
        """Return the derivative of ``columns @ theta`` in search coordinates, shape (rows, s), by differences."""
        low, high = self.bounds
        out = []
        for k in range(len(x)):
            step = np.zeros(len(x))
            step[k] = size * max(abs(x[k]), 1e-3 * (high[k] - low[k]), 1e-9)
            above, below = np.minimum(x + step, high), np.maximum(x - step, low)
            change = self.values(above)[k] - self.values(below)[k]
            slope = (self.at(above) - self.at(below)) @ theta
            out.append(slope / (above[k] - below[k]) if change else 0.0 * slope)
        return np.stack(out, axis=1)
