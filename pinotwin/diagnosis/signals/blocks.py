"""Least squares by blocks: every block predicted from all others, and how the coefficients differ without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.signals import rms
from pinotwin.solve.jackknife import jackknife, without_each

RIDGE = 1e-9  # Of a column's own square: keeps a singular system solvable, moves nothing that is determined


@dataclass(frozen=True, eq=False)
class Blocked:
    """A fit whose every block was also left out."""

    theta: Floats  # coefficients from all rows, shape (p,)
    folds: Floats  # the same without each block, shape (K, p)
    rest: Floats  # what is left of each row, predicted from the other blocks, shape (n,)
    blocks: Sequence[slice]  # rows of each block

    @cached_property
    def covariance(self) -> Floats:
        """Block jackknife covariance of ``theta``, shape (p, p)."""
        return jackknife(self.folds)

    @property
    def error(self) -> Floats:
        """Standard errors, shape (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def left(self) -> float:
        """RMS of what is left of rows that were not fitted."""
        return rms(self.rest)

    @property
    def powers(self) -> Floats:
        """Squared sum of it, one a block, shape (K,)."""
        return np.array([float(self.rest[b] @ self.rest[b]) for b in self.blocks])


def by_blocks(X: Floats, y: Floats, blocks: Sequence[slice]) -> Blocked:
    """Return the least-squares fit of ``y`` (n,) by ``X`` (n, p), every block left out once."""
    every = without_each(X, y, blocks, RIDGE)
    rest = y.copy()
    for b, theta in zip(blocks, every, strict=False):
        rest[b] = y[b] - X[b] @ theta
    return Blocked(every[-1], every[:-1], rest, blocks)


def blocks_of(rows: int, step: float) -> list[slice]:
    """Return stretches of rows that are ``step`` [s] apart, each one witness: 6 to 40, of half a second."""
    count = int(np.clip(rows * step / 0.5, 6, 40))
    edges = np.linspace(0, rows, count + 1).astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def posterior(wins: int, trials: int) -> float:
    """Return the confidence after so many trials, some of them won: beside one that was right and half a wrong one."""
    return (wins + 1.0) / (trials + 1.5)
