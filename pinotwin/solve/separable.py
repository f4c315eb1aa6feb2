"""Least squares with a few nonlinear shapes: variable projection with a global start strategy.

    y = W0 theta0 + sum over blocks of C_b(shape_b) theta_b + e

Each block is scanned over its own grid with everything else projected out, the strongest first, then all again with
the others at their new values; the best basins are refined, and a bounded Gauss-Newton search polishes all shapes
together. The covariance comes from the full Jacobian, so that the shapes' uncertainty widens that of theta.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.solve.bounds import bounded
from pinotwin.solve.covariance import spread
from pinotwin.solve.descent import End, Remembered, rival, trust_region
from pinotwin.solve.linear import Options, linear, reduce, solve, spread_of_belief
from pinotwin.solve.moving import Moving
from pinotwin.solve.problem import Problem
from pinotwin.solve.projection import Projection, directions
from pinotwin.solve.rank import analyse, r_factor
from pinotwin.solve.result import LinearFit, ShapeFit
from pinotwin.solve.scan import Basin, Scan

Found = tuple[LinearFit, tuple[ShapeFit, ...]]  # At the shapes found; fixed columns first, then blocks


def separable(
    problem: Problem,
    moving: Sequence[Moving],
    options: Options | None = None,
    known: Mapping[int, Floats] | None = None,
) -> Found:
    """Fit fixed columns, then moving blocks, in the order of prior and bounds; ``known`` shapes are only polished."""
    options = options or Options()
    if not moving:
        return linear(problem, options), ()
    search = _Search(problem, tuple(moving), options, known or {})
    del problem  # see judge
    search.look()
    search.sweep()
    search.finish()
    return search.judge()


class _Search:
    """The state of one search: where the shapes are now, and what has been found on the way."""

    def __init__(
        self, problem: Problem, moving: tuple[Moving, ...], options: Options, known: Mapping[int, Floats]
    ) -> None:
        self.problem = problem
        self.moving = moving
        self.options = options
        self.projection = Projection.of(problem, moving)
        self.names = (*problem.names, *(name for m in moving for name in m.names))
        middle = [np.array([g[len(g) // 2] for g in m.grids]) for m in moving]
        self.x = [moving[b].search(known[b]) if b in known else x for b, x in enumerate(middle)]
        self.unknown = [b for b in range(len(moving)) if b not in known]
        self.basins: list[list[Basin]] = [[Basin(x, 0.0)] for x in self.x]
        fixed = Options(sigma=options.sigma, tolerance=options.tolerance)
        self.sigma = solve(self.projection.reduced(), fixed).sigma

    def look(self) -> None:
        """Scan every unknown block beside the known ones and take the best of each as a first guess."""
        known = [b for b in range(len(self.moving)) if b not in self.unknown]
        columns = [(b, self.moving[b].at(self.x[b])) for b in known]
        for b in self.unknown:
            self.scan(b, columns, refine=False)
        self.reweigh()

    def sweep(self, most: int = 3) -> None:
        """Scan every unknown block with the others in place, strongest first, until none jumps.

        A block is scanned again if one with rows of its own has jumped since: what reaches it through coefficients
        that axes share moves no basin, and the polish takes it up.
        """
        columns = [m.at(x) for m, x in zip(self.moving, self.x, strict=True)]
        stale, axes = set(self.unknown), [placed.keys() for placed in self.projection.placed]
        for _ in range(most):
            for b in sorted(stale, key=lambda b: -self.basins[b][0].gain):
                before = self.x[b]
                self.scan(b, [(k, C) for k, C in enumerate(columns) if k != b])
                columns[b] = self.moving[b].at(self.x[b])
                stale.discard(b)
                if self.cell(b, before) != self.cell(b, self.x[b]):
                    stale |= {k for k in self.unknown if k != b and axes[b] & axes[k]}
            self.reweigh()
            if not stale:
                break

    def scan(self, b: int, others: Sequence[tuple[int, Floats]], refine: bool = True) -> None:
        """Scan one block and move it to its best basin."""
        scan = Scan(self.projection, b, others, self.sigma)
        self.basins[b] = scan.basins(self.x[b], refine)
        self.x[b] = self.basins[b][0].x

    def cell(self, b: int, x: Floats) -> tuple[int, ...]:
        """Return the grid value nearest each shape of a block."""
        grids = self.moving[b].grids
        return tuple(int(np.argmin(np.abs(g - v))) for g, v in zip(grids, x, strict=True))

    def reweigh(self) -> bool:
        """Find the noise levels anew; return whether they changed by more than a percent."""
        if self.options.sigma is not None:
            return False
        old = self.sigma
        columns = [m.at(x) for m, x in zip(self.moving, self.x, strict=True)]
        self.sigma = solve(self.projection.reduced(columns), self.options).sigma
        return bool(np.any(np.abs(self.sigma - old) > 0.01 * old))

    def finish(self, near: float = 1.02) -> None:
        """Move all blocks to the end of the best combination, or of a rival that comes near it and ends lower."""
        low = np.concatenate([m.bounds[0] for m in self.moving])
        high = np.concatenate([m.bounds[1] for m in self.moving])

        def polished() -> Callable[..., End]:
            return partial(
                polish, variable_projection(self.projection, self.sigma, self.options), (low, high)
            )

        first, *rivals = self.starts()
        best = polished()(first)
        for start in rivals:
            best = min(best, *rival(polished(), start, best, near), key=lambda end: end.cost)
        for _ in range(3):
            self.x = self.projection.split(best.x)
            if not self.reweigh():
                break
            best = polished()(best.x)

    def starts(self, rival: float = 0.9, most: int = 3) -> list[Floats]:
        """Return the best combination, then at most a few with one block in a basin of nearly as much gain."""
        best = np.concatenate(self.x)
        rivals: list[tuple[float, Floats]] = []
        for b, basins in enumerate(self.basins):
            for basin in basins[1:]:
                if basin.gain >= rival * basins[0].gain:
                    x = [*self.x[:b], basin.x, *self.x[b + 1 :]]
                    rivals.append((basins[0].gain - basin.gain, np.concatenate(x)))
        rivals.sort(key=lambda pair: pair[0])
        return [best, *(x for _, x in rivals[:most])]

    def judge(self) -> Found:
        """Return the result with the covariance of coefficients and shapes together."""
        del self.projection  # as large as what is now judged row by row, and so is the problem
        p, at = self.problem.parameters, 0
        columns = np.zeros((len(self.problem.y), len(self.names) - p))
        for m, x in zip(self.moving, self.x, strict=True):
            columns[m.rows, at : at + len(m.names)] = m.at(x)
            at += len(m.names)
        full = self.problem.beside(columns, self.names[p:])
        del self.problem, columns
        sigma = self.sigma if self.options.sigma is None else self.options.sigma
        fit = linear(full, replace(self.options, sigma=sigma, inference="none"))
        slopes = np.zeros((len(full.y), sum(map(len, self.x))))
        at, p, k = p, full.parameters, 0
        for m, x in zip(self.moving, self.x, strict=True):
            theta = fit.theta[at : at + len(m.names)]
            slopes[m.rows, k : k + len(x)] = m.slopes(x, theta)
            at, k = at + len(m.names), k + len(x)
        joint = full.beside(slopes, [f"{m.name}.{s}" for m in self.moving for s in m.shapes])
        options = self.options.by_coefficient(lambda x, none: np.append(x, np.full(slopes.shape[1], none)))
        R = reduce(joint).triangle(fit.sigma)[:-1, :-1]
        rank = analyse(R, self.options.tolerance)
        root = rank.root
        if options.belief is not None:
            root = analyse(np.concatenate([R, options.belief]), self.options.tolerance).root
        covariance, dof = spread(joint, fit.sigma, fit.residual, root, self.options.inference)
        covariance += spread_of_belief(root, options)
        determined = fit.determined & rank.determined[:p]
        fit = replace(fit, covariance=covariance[:p, :p], dof=dof[:p], determined=determined)
        error = np.where(rank.determined, np.sqrt(np.maximum(np.diag(covariance), 0)), np.inf)[p:]
        return fit, tuple(self.shapes(iter(error.tolist())))

    def shapes(self, errors: Iterator[float]) -> Iterator[ShapeFit]:
        """Yield what was found about every shape, with its standard error."""
        for m, x in zip(self.moving, self.x, strict=True):
            for name, *numbers, log in zip(m.shapes, x, *m.bounds, m.log, strict=True):
                value, low, high = map(float, numbers)
                yield ShapeFit(m.name, name, value, next(errors), low, high, bool(log))


GAUSS_NEWTON, MAX_EVALUATIONS = 8, 40  # Most evaluations of the first and of both searches
CLOSE = 1e-9  # Relative fall of the cost that ends the search: far below one unit of deviance in 1e6 rows


def variable_projection(projection: Projection, sigma: Floats, options: Options) -> Remembered:
    """Return residual and Jacobian of the variable projection as functions of the search coordinates.

    || P(x) y ||^2 with P(x) the projector off the columns W(x), and Kaufman's Jacobian -P dW/dx theta (Kaufman 1975,
    doi:10.1007/BF01932995; Golub & Pereyra 2003, doi:10.1088/0266-5611/19/2/201), in small coordinates, at noise levels
    of the axes; bounds are those of fixed coefficients first.
    """
    width, bounds = projection.width, options.bounds(projection.width - 1)
    linear_columns = np.delete(np.arange(width), projection.fixed)
    cuts = np.cumsum([0, *(len(m.shapes) for m in projection.moving)])

    def evaluate(x: Floats) -> tuple[Floats, Floats]:
        blocks = list(zip(projection.moving, projection.split(x), strict=True))
        pieces = [(b, m.at(part), projection.numbers(b)) for b, (m, part) in enumerate(blocks)]
        small = projection.small(pieces, sigma, width)
        theta, free = _bounded(
            small[:, linear_columns], small[:, projection.fixed], bounds, options.tolerance
        )
        for b, (m, part) in enumerate(blocks):
            slopes = m.slopes(part, theta[projection.numbers(b) - 1])
            pieces.append((b, slopes, width + np.arange(cuts[b], cuts[b + 1])))
        small = projection.small(pieces, sigma, width + len(x))
        W, y, slope = small[:, linear_columns], small[:, projection.fixed], small[:, width:]
        base = directions(W[:, free])[0]
        return y - W @ theta, -(slope - base @ (base.T @ slope))

    return Remembered(evaluate)


def _bounded(W: Floats, y: Floats, bounds: tuple[Floats, Floats], tolerance: float) -> tuple[Floats, Mask]:
    """Return theta within its bounds and which of its entries are free of them."""
    length = np.linalg.norm(W, axis=0)
    unit = 1.0 / np.where(length > 0, length, 1.0)
    # gelsy: pivoted QR, several times faster than singular values where tables make p large
    how = {"cond": tolerance, "lapack_driver": "gelsy", "check_finite": False}
    theta = unit * scipy.linalg.lstsq(W * unit, y, **how)[0]
    if not ((theta < bounds[0]) | (theta > bounds[1])).any():
        return theta, np.ones(len(theta), bool)
    theta, active = bounded(W, y, *bounds, np.zeros_like(theta), analyse(r_factor(W), tolerance))
    return theta, ~active


def polish(
    problem: Remembered, bounds: tuple[Floats, Floats], start: Floats, most: int = MAX_EVALUATIONS
) -> End:
    """Return the optimum of all shapes near ``start``, within bounds, in search coordinates; most evaluations.

    By `scipy.optimize.least_squares`, whose curvature is wrong by what the residual bends: where the model leaves much
    (a ripple's pitch beside a flexible frame), its steps overshoot to and fro, and the gradient, which is exact, leads
    a quasi-Newton search (L-BFGS-B) to the optimum.
    """
    few, tolerances = min(most, GAUSS_NEWTON), {"ftol": CLOSE, "xtol": 1e-9}
    end = trust_region(problem, start, bounds, 1e-9, x_scale="jac", max_nfev=few, **tolerances)
    left = most - end.evaluations
    return end if end.converged or left <= 0 else _finished(problem, end, bounds, left)


def _finished(problem: Remembered, begun: End, bounds: tuple[Floats, Floats], most: int) -> End:
    """Return the end of a quasi-Newton search, its coordinates scaled by the lengths of the Jacobian's columns."""
    length = np.linalg.norm(problem(begun.x)[1], axis=0)
    scale = np.where(length > 0.0, length, 1.0)

    def cost(z: Floats) -> tuple[float, Floats]:
        residual, jacobian = problem(z / scale)
        return 0.5 * float(residual @ residual), jacobian.T @ residual / scale

    found = scipy.optimize.minimize(
        cost,
        begun.x * scale,
        jac=True,
        method="L-BFGS-B",
        bounds=np.transpose(np.array(bounds) * scale),
        options={"ftol": 1e-3 * CLOSE, "gtol": 1e-9, "maxcor": 20, "maxfun": most},
    )
    x = np.clip(found.x / scale, *bounds)
    return End(x, float(found.fun), begun.evaluations + int(found.nfev), bool(found.success))
