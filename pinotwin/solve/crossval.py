"""Prediction error on data that were not fitted: stretches of time, with a guard gap beside them.

Neighbouring residuals are alike, so random folds would let the fit see its own test. Every piece of rows is reduced
once to its R factor, so that all folds cost about one fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress, pairwise
from typing import Self

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError
from pinotwin.solve.linear import Options, Solution, merged, reduce, solve
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import BLOCK


@dataclass(frozen=True)
class HeldOut:
    """Prediction of held-out rows."""

    theta: Floats  # coefficients of each fold, shape (folds, p)
    error: Floats  # prediction error of every row, shape (rows,)
    sigma: Floats  # noise level of every axis with which the rows were weighted, shape (axes,)
    fits: tuple[Solution, ...]  # what each fold was fitted to, and how
    tests: Floats  # triangle of the weighted rows [W y] of each fold, shape (folds, p + 1, p + 1)
    fold: Ints  # of every row, shape (rows,)
    whole: Floats  # coefficients of a fit of all rows, shape (p,)

    def weighted(self, theta: Floats) -> float:
        """Return the RMS prediction error of one theta a fold, shape (folds, p), in sigma."""
        error = np.einsum("kij,kj->ki", self.tests, np.insert(theta, theta.shape[1], -1.0, axis=1))
        return float(np.sqrt(np.sum(error**2) / len(self.error)))

    def by(self, problem: Problem, theta: Floats, whole: Floats) -> Self:
        """Return the predictions by other coefficients of each fold, shape (folds, p), and of all rows, shape (p,)."""
        error = problem.y - (problem.W @ theta.T)[np.arange(len(self.fold)), self.fold]
        return replace(self, theta=theta, error=error, whole=whole)

    def unsure(self, problem: Problem, ridge: float = 1e-6) -> Floats:
        """Return the variance of each row's prediction over that of the noise, shape (rows,); beyond 1 it is none.

        The share ``ridge`` of what all rows tell of a column holds it where the fitted rows do not have it.
        """
        out = np.empty(len(problem.y))
        N = np.array([fit.factor.T @ fit.factor for fit in self.fits])
        size = np.sqrt(np.maximum(np.diagonal(N, axis1=1, axis2=2).max(axis=0), 1e-300))
        weight = 1.0 / self.sigma[problem.axis_place]
        for k, each in enumerate(N):
            spread = np.linalg.inv(each / np.outer(size, size) + ridge * np.eye(len(size)))
            rows = np.flatnonzero(self.fold == k)
            for some in np.split(rows, np.arange(BLOCK, len(rows), BLOCK)):
                own, A = problem.dense(some)
                x = A[:, :-1] * weight[some, None] / size[own]
                out[some] = np.einsum("np,np->n", x @ spread[np.ix_(own, own)], x)
        return out


def held_out(
    problem: Problem,
    folds: int = 5,
    guard: int | None = None,
    options: Options | None = None,
    edges: Ints | None = None,
) -> HeldOut:
    """Predict each of ``folds`` stretches of time from the others, ``guard`` slots (a twentieth) apart.

    ``edges`` are where other stretches, such as whole logs, begin and end, shape (folds + 1,); they need no guard.
    Shapes stay as found, noise levels are those of a fit of all rows where options do not say them. DataError for
    fewer instants than two per fold.
    """
    options = options or Options()
    order, times = fold_order(problem)
    if edges is not None:
        folds, guard = len(edges) - 1, 0
    if folds < 2 or times < 2 * folds:
        raise DataError(f"{times} instants cannot be split into {folds} folds of at least two")
    guard = times // (20 * folds) if guard is None else guard
    edges = np.linspace(0, times, folds + 1).astype(int) if edges is None else edges
    cuts = np.unique(np.clip(np.concatenate([edges - guard, edges, edges + guard]), 0, times))
    pieces = [
        reduce(problem.rows((order >= a) & (order < b)), tuple(problem.slices)) for a, b in pairwise(cuts)
    ]
    whole = solve(merged(pieces), options)
    options = replace(options, sigma=whole.sigma)
    theta = np.empty((folds, problem.parameters))
    fits, tests = [], []
    error, fold = np.empty(len(problem.y)), np.empty(len(problem.y), dtype=np.intp)
    for k, (a, b) in enumerate(pairwise(edges)):
        outside = (cuts[1:] <= a - guard) | (cuts[:-1] >= b + guard)
        fits.append(solve(merged(list(compress(pieces, outside))), options))
        theta[k] = fits[k].theta
        within = compress(pieces, (cuts[:-1] >= a) & (cuts[1:] <= b))
        tests.append(merged(list(within)).triangle(whole.sigma))
        inside = (order >= a) & (order < b)
        error[inside], fold[inside] = problem.y[inside] - problem.W[inside] @ theta[k], k
    return HeldOut(theta, error, whole.sigma, tuple(fits), np.array(tests), fold, whole.theta)


def fold_order(problem: Problem) -> tuple[Ints, int]:
    """Return each row's place in time, and how many there are: instants of all blocks one after the other."""
    starts = problem.grid.starts(0)
    _, order = np.unique(starts[problem.grid.block] + problem.grid.slot, return_inverse=True)
    return order, int(order.max()) + 1
