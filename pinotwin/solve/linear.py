"""Weighted, rank-revealing linear least squares with an honest covariance.

    minimise  sum over axes of || y_i - W_i theta ||^2 / sigma_i^2

Weights follow from the residuals of each axis until both rest (iterated generalised least squares, Gautier 1997), on
the R factor of ``[W_i y_i]``, so that the iterations cost nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.solve.bounds import bounded
from pinotwin.solve.covariance import Inference, spread
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import Rank, analyse, r_factor
from pinotwin.solve.result import LinearFit


@dataclass(frozen=True)
class Options:
    """How :func:`linear` solves.

    A ridge keeps coefficients with hardly any data (the edge knots of a table) from running away, a belief tells how
    coefficients hang together, but neither makes one count as determined.
    """

    prior: Floats | None = None  # of equally good theta the nearest to it is taken, (p,); None is zero
    ridge: Floats | None = None  # how near the prior it is believed, shape (p,), inf for none
    belief: Floats | None = None  # rows B, shape (k, p): B theta is believed to be zero, give or take a sigma
    alike: Floats | None = None  # rows of the data that tell as much as one of B's, shape (k,)
    lower: Floats | None = None  # bounds on theta, shape (p,); None for none
    upper: Floats | None = None  # bounds on theta, shape (p,); None for none
    sigma: Floats | None = None  # known noise level per axis; None to find it
    start: Floats | None = None  # noise level per axis from which it is found; None for the effort's size
    tolerance: float = 1e-9  # smallest relative pivot of the scaled columns that counts as seen
    inference: Inference = "blocks"  # see :mod:`pinotwin.solve.covariance`

    def bounds(self, p: int) -> tuple[Floats, Floats]:
        """Return the smallest and the largest values of p coefficients, shape (p,) each."""
        return _or(self.lower, -np.inf, p), _or(self.upper, np.inf, p)

    def by_coefficient(self, change: Callable[[Floats, float], Floats]) -> Options:
        """Return the same for other coefficients: each array (p,) changed, given what stands for none in it."""
        none = {"prior": 0.0, "ridge": np.inf, "lower": -np.inf, "upper": np.inf}
        given = {name: x for name in none if (x := getattr(self, name)) is not None}
        changed: dict[str, Any] = {name: change(x, none[name]) for name, x in given.items()}
        if self.belief is not None:
            changed["belief"] = np.array([change(row, 0.0) for row in self.belief])
        return replace(self, **changed)


@dataclass(frozen=True)
class Reduced:
    """Rows of a problem reduced to one factor per axis; all that the estimate itself needs."""

    factors: tuple[Floats, ...]  # R of ``[W_i y_i]`` per axis, shape (k, p + 1), k the columns that it has
    rows: tuple[int, ...]  # number of rows per axis

    def triangle(self, sigma: Floats) -> Floats:
        """Return R of ``[W y]`` of all axes together, each axis divided by its noise level."""
        return r_factor(np.concatenate([F / s for F, s in zip(self.factors, sigma, strict=True)]))


@dataclass(frozen=True)
class Solution:
    """Theta of a reduced problem, without a covariance."""

    theta: Floats  # shape (p,)
    sigma: Floats  # noise level per axis
    rank: Rank  # analysis of the weighted factor, and of the ridge, if any
    active: Mask  # parameters on a bound, shape (p,)
    factor: Floats  # weighted R, shape (p, p)
    right: Floats  # weighted z, shape (p,)
    options: Options  # how it was solved

    @property
    def held(self) -> tuple[Floats, Floats]:
        """R and z with the rows of the ridge, of which theta is the least squares within the bounds."""
        return _with_ridge(self.factor, self.right, self.options)


def reduce(problem: Problem, axes: Sequence[int] | None = None) -> Reduced:
    """Return the factors of a problem's axes, or of some others too, of which it may have no rows."""
    factors, rows = [], []
    for i in problem.slices if axes is None else axes:
        part = problem.slices.get(i, slice(0, 0))
        own, R = problem.triangle(part)
        factor = np.zeros((len(R), problem.parameters + 1))
        factor[:, [*own, -1]] = R
        factors.append(factor)
        rows.append(part.stop - part.start)
    return Reduced(tuple(factors), tuple(rows))


def merged(pieces: Sequence[Reduced]) -> Reduced:
    """Return the factors of several pieces together: the rows themselves would be the problem once more."""
    factors = zip(*(piece.factors for piece in pieces), strict=True)
    rows = zip(*(piece.rows for piece in pieces), strict=True)
    return Reduced(tuple(r_factor(np.concatenate(F)) for F in factors), tuple(map(sum, rows)))


def linear(problem: Problem, options: Options | None = None) -> LinearFit:
    """Fit a linear problem; DataError for fewer rows than parameters."""
    options = options or Options()
    found = solve(reduce(problem), options)
    plain, (factor, right) = options.ridge is None and options.belief is None, found.held
    seen = found.rank if plain else analyse(found.factor, options.tolerance)  # without the ridge
    if len(problem.y) <= seen.rank:
        raise DataError(
            f"{len(problem.y)} rows for {problem.parameters} parameters leave nothing to judge the "
            "fit by: record more motion, or relax the data selection"
        )
    error = problem.y - problem.W @ found.theta
    covariance, dof = spread(problem, found.sigma, error, found.rank.root, options.inference)
    believed = spread_of_belief(found.rank.root, options)
    lower, upper = options.bounds(problem.parameters)
    return LinearFit(
        problem=problem,
        theta=found.theta,
        covariance=covariance + believed,
        dof=dof,
        sigma=found.sigma,
        rank=seen.rank,
        condition=seen.condition,
        determined=seen.determined,
        unexcited=seen.unexcited,
        groups=seen.groups,
        active=found.active,
        lower=lower,
        upper=upper,
        factor=factor,
        right=right,
    )


def solve(reduced: Reduced, options: Options | None = None) -> Solution:
    """Return theta and the noise levels of a reduced problem; inference is not made."""
    options = options or Options()
    given = options.start if options.sigma is None else options.sigma
    sigma = _first_levels(reduced) if given is None else np.asarray(given, float)
    told, steps = list[Floats](), list[Floats]()
    for _ in range(50):
        found = _weighted(reduced, sigma, options)
        if options.sigma is not None:
            break
        told.append(np.log(_levels(reduced, found)))
        steps.append(told[-1] - np.log(sigma))
        if np.all(np.abs(steps[-1]) <= 1e-10):
            break
        # the fixed point of the line through the last steps (Anderson 1965; Walker & Ni 2011, doi:10.1137/10078356X)
        change, bend = (np.diff(x[-5:], axis=0).T for x in (told, steps))
        sigma = np.exp(told[-1] - change @ np.linalg.lstsq(bend, steps[-1])[0])
    return found


def _weighted(reduced: Reduced, sigma: Floats, options: Options) -> Solution:
    """Return theta for given noise levels."""
    whole = reduced.triangle(sigma)
    R, z, p = whole[:-1, :-1], whole[:-1, -1], len(whole) - 1
    mean = _or(options.prior, 0.0, p)
    A, b = _with_ridge(R, z, options)
    rank = analyse(A, options.tolerance)
    theta = mean + rank.nearest(rank.root @ (rank.root.T @ (A.T @ (b - A @ mean))))
    theta += rank.root @ (rank.root.T @ (A.T @ (b - A @ theta)))
    active = np.zeros(p, bool)
    lower, upper = options.bounds(p)
    if ((theta < lower) | (theta > upper)).any():
        theta, active = bounded(A, b, lower, upper, mean, rank)
    return Solution(theta, sigma, rank, active, R, z, options)


def _with_ridge(R: Floats, z: Floats, options: Options) -> tuple[Floats, Floats]:
    """Return a factor and its right side with the rows of the weak belief."""
    if options.belief is not None:
        R, z = np.concatenate([R, options.belief]), np.append(z, np.zeros(len(options.belief)))
    if options.ridge is None:
        return R, z
    weak = np.flatnonzero(np.isfinite(options.ridge))
    extra = np.zeros((len(weak), R.shape[1]))
    extra[np.arange(len(weak)), weak] = 1.0 / options.ridge[weak]
    mean = 0.0 if options.prior is None else options.prior[weak]
    return np.concatenate([R, extra]), np.concatenate([z, mean / options.ridge[weak]])


def spread_of_belief(root: Floats, options: Options) -> Floats:
    """Return the covariance that theta has because a belief pulls it, shape (p, p), of F (p, rank) with its rows."""
    if options.belief is None or options.alike is None:
        return np.zeros((len(root), len(root)))
    pull = root @ (root.T @ (options.belief * np.sqrt(options.alike)[:, None]).T)
    return np.asarray(pull @ pull.T)


def _first_levels(reduced: Reduced) -> Floats:
    """Return the effort's RMS per axis: unit weights up to the axis' size."""
    size = np.array([np.linalg.norm(F[:, -1]) for F in reduced.factors])
    level = size / np.sqrt(reduced.rows)
    return np.where(level > 0, level, 1.0)


def _levels(reduced: Reduced, found: Solution) -> Floats:
    """Return the residuals' level per axis, with the degrees of freedom that each axis has left."""
    floor = 1e-10 * _first_levels(reduced)
    out = np.empty(len(reduced.rows))
    step = np.concatenate([found.theta, [-1.0]])
    for i, (F, n) in enumerate(zip(reduced.factors, reduced.rows, strict=True)):
        own = np.flatnonzero(F[:, :-1].any(axis=0))
        used = float(np.sum((F[:, own] @ found.rank.root[own]) ** 2)) / found.sigma[i] ** 2
        left = max(n - used, 0.5 * n / (1 + used))
        out[i] = np.linalg.norm(F @ step) / np.sqrt(left)
    return np.maximum(out, floor)


def _or(given: Floats | None, default: float, p: int) -> Floats:
    return np.full(p, default) if given is None else np.asarray(given, float)
