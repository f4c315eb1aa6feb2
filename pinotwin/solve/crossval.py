"""Prediction error on data that were not fitted: stretches of time, with a guard gap beside them.

Neighbouring residuals are alike, so random folds would let the fit see its own test. Each fold here
is one stretch of time, and ``guard`` slots on both sides of it are used neither to fit nor to test.
Every piece of rows is reduced once to its R factor, so that all folds cost about one fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError
from pinotwin.solve.linear import Options, Reduced, reduce, solve
from pinotwin.solve.problem import Problem
from pinotwin.solve.tsqr import r_factor


@dataclass(frozen=True)
class HeldOut:
    """Prediction of held-out rows."""

    theta: Floats  # coefficients of each fold, shape (folds, p)
    error: Floats  # prediction error of every row, shape (rows,)
    sigma: Floats  # noise level of every axis with which the rows were weighted, shape (axes,)
    factors: Floats  # R of the weighted rows that each fold was fitted to, shape (folds, p, p)
    fold: Ints  # of every row, shape (rows,)
    whole: Floats  # coefficients of a fit of all rows, shape (p,)

    def unsure(self, problem: Problem, ridge: float = 1e-6) -> Floats:
        """Return the variance of each row's prediction over that of the noise, shape (rows,).

        Of a regular fit it is a few parameters over the number of rows. Beyond one the rows that were fitted
        tell less of a prediction than the noise does: of a table's knots that only this fold visits they tell
        nothing. The share ``ridge`` of what all rows tell of a column holds it where the fitted rows do not
        have it.
        """
        out = np.empty(len(problem.y))
        N = self.factors.transpose(0, 2, 1) @ self.factors
        size = np.sqrt(np.maximum(np.diagonal(N, axis1=1, axis2=2).max(axis=0), 1e-300))
        weight = 1.0 / self.sigma[problem.axis_place]
        for k, each in enumerate(N):
            spread = np.linalg.inv(each / np.outer(size, size) + ridge * np.eye(len(size)))
            for i, part in problem.slices.items():
                own, rows = problem.filled[i], np.flatnonzero(self.fold[part] == k) + part.start
                x = problem.W[np.ix_(rows, own)] * weight[rows, None] / size[own]
                out[rows] = np.einsum("np,np->n", x @ spread[np.ix_(own, own)], x)
        return out


def held_out(
    problem: Problem, folds: int = 5, guard: int | None = None, options: Options | None = None
) -> HeldOut:
    """Predict each of ``folds`` stretches of time from the others, ``guard`` slots (a twentieth) apart.

    Shapes stay as found, noise levels are those of a fit of all rows where options do not say them.

    Raises:
        DataError: fewer instants than two per fold.
    """
    options = options or Options()
    order, times = fold_order(problem)
    if folds < 2 or times < 2 * folds:
        raise DataError(f"{times} instants cannot be split into {folds} folds of at least two")
    guard = times // (20 * folds) if guard is None else guard
    edges = np.linspace(0, times, folds + 1).astype(int)
    cuts = np.unique(np.clip(np.concatenate([edges - guard, edges, edges + guard]), 0, times))
    pieces = [
        reduce(problem.rows((order >= a) & (order < b)), tuple(problem.slices)) for a, b in pairwise(cuts)
    ]
    whole = solve(_merge(pieces), options)
    options = replace(options, sigma=whole.sigma)
    theta = np.empty((folds, problem.parameters))
    held = np.empty((folds, problem.parameters, problem.parameters))
    error, fold = np.empty(len(problem.y)), np.empty(len(problem.y), dtype=np.intp)
    for k, (a, b) in enumerate(pairwise(edges)):
        outside = (cuts[1:] <= a - guard) | (cuts[:-1] >= b + guard)
        chosen = [piece for piece, use in zip(pieces, outside, strict=True) if use]
        found = solve(_merge(chosen), options)
        theta[k], held[k] = found.theta, found.factor
        inside = (order >= a) & (order < b)
        error[inside], fold[inside] = problem.y[inside] - problem.W[inside] @ theta[k], k
    return HeldOut(theta, error, whole.sigma, held, fold, whole.theta)


def fold_order(problem: Problem) -> tuple[Ints, int]:
    """Return each row's place in time, and how many there are: instants of all blocks one after the other."""
    starts = problem.grid.starts(0)
    _, order = np.unique(starts[problem.grid.block] + problem.grid.slot, return_inverse=True)
    return order, int(order.max()) + 1


def _merge(chosen: Sequence[Reduced]) -> Reduced:
    """Return the factors of several pieces together: the rows themselves would be the problem once more."""
    factors = zip(*(piece.factors for piece in chosen), strict=True)
    rows = zip(*(piece.rows for piece in chosen), strict=True)
    return Reduced(tuple(r_factor(np.concatenate(F)) for F in factors), tuple(map(sum, rows)))
