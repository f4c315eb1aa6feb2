"""The residuals' colour as one autoregression per axis, and rows whitened by it.

    e(t) = sum_k a_k e(t - k) + w(t),   w white

Burg's method over all unbroken runs of an axis at once (:mod:`pinotwin.signals.autoregression`).
Whitening filters W and y of each run by 1 - sum a_k z^-k (feasible generalised least squares); the
first rows of every run, which lack a past, are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.signals.autoregression import burg
from pinotwin.solve.problem import Problem


@dataclass(frozen=True)
class Autoregression:
    """An autoregression of one axis.

    Attributes:
        coefficients: a_1 ... a_order, shape (order,).
    """

    coefficients: Floats

    @property
    def memory(self) -> int:
        """Slots after which its impulse response has died out to 1e-3, at most 5000."""
        poles = np.abs(np.roots(np.concatenate([[1.0], -self.coefficients])))
        largest = min(float(poles.max(initial=0.0)), 0.9999)
        return int(min(len(self.coefficients) + np.ceil(-7 / np.log(max(largest, 0.1))), 5000))


def runs(problem: Problem, rows: slice) -> list[slice]:
    """Return the unbroken runs (neighbouring slots of one block) among rows of one axis."""
    slot, block = problem.grid.slot[rows], problem.grid.block[rows]
    cuts = np.flatnonzero((np.diff(slot) != 1) | (np.diff(block) != 0)) + 1
    edges = [0, *cuts.tolist(), len(slot)]
    return [slice(rows.start + a, rows.start + b) for a, b in pairwise(edges)]


def autoregressions(problem: Problem, error: Floats, order: int) -> tuple[Autoregression, ...]:
    """Return one autoregression per axis, in the order of ``problem.slices``.

    Args:
        problem: says which residuals are neighbours in time.
        error: residuals, shape (rows,).
        order: number of coefficients; fewer where the runs are too short.
    """
    return tuple(
        Autoregression(burg([error[run] for run in runs(problem, rows)], order)[0])
        for rows in problem.slices.values()
    )


def whiten(problem: Problem, values: Floats, models: tuple[Autoregression, ...]) -> tuple[Floats, Mask]:
    """Return rows filtered to white residuals and the mask of rows that have a full past.

    Args:
        problem: says which rows are neighbours in time.
        values: row values, shape (rows, k).
        models: one per axis, in the order of ``problem.slices``.
    """
    out = values.copy()
    keep = np.zeros(len(values), bool)
    for model, rows in zip(models, problem.slices.values(), strict=True):
        order = len(model.coefficients)
        for run in runs(problem, rows):
            keep[run.start + order : run.stop] = True
            n = run.stop - run.start
            for k, a in enumerate(model.coefficients, start=1):
                if k < n:
                    out[run.start + k : run.stop] -= a * values[run.start : run.stop - k]
    return out, keep
