"""The joint refinement of all shapes by variable projection, || P(x) y ||^2, P(x) = projector off the columns W(x).

With Kaufman's Jacobian -P dW/dx theta (Kaufman 1975, doi:10.1007/BF01932995; Golub & Pereyra 2003,
doi:10.1088/0266-5611/19/2/201) by `scipy.optimize.least_squares`, whose curvature is wrong by what the residual bends:
where the model leaves much (a ripple's pitch beside a flexible frame), its steps overshoot to and fro, and the
gradient, which is exact, leads a quasi-Newton search (L-BFGS-B) to the optimum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.solve.bounds import bounded
from pinotwin.solve.descent import End, Remembered, trust_region
from pinotwin.solve.projection import Projection, Span
from pinotwin.solve.rank import analyse
from pinotwin.solve.tsqr import r_factor

GAUSS_NEWTON, MAX_EVALUATIONS = 8, 40  # Most evaluations of the first and of both searches
CLOSE = 1e-9  # Relative fall of the cost that ends the search: far below one unit of deviance in 1e6 rows


@dataclass(frozen=True)
class Limits:
    """Bounds on the linear coefficients; see :class:`pinotwin.solve.linear.Options`."""

    lower: Floats  # shape (p,)
    upper: Floats  # shape (p,)
    tolerance: float  # smallest relative pivot that counts as seen


class VariableProjection:
    """Residual and Jacobian of the variable projection as functions of the search coordinates."""

    def __init__(self, projection: Projection, sigma: Floats, limits: Limits) -> None:
        """Prepare for given noise levels of the axes; limits are those of fixed coefficients first."""
        self._projection = projection
        self._sigma = sigma
        self._limits = limits
        self._linear = np.delete(np.arange(projection.width), projection.fixed)
        self._cuts = np.cumsum([0, *(len(m.shapes) for m in projection.moving)])
        self.evaluate = Remembered(self._evaluate)

    def _evaluate(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the residual in small coordinates, and Kaufman's Jacobian of it."""
        P = self._projection
        parts = P.split(x)
        columns = [m.at(part) for m, part in zip(P.moving, parts, strict=True)]
        pieces = [(b, C, P.numbers(b)) for b, C in enumerate(columns)]
        theta, free = self._solve(P.small(pieces, self._sigma, P.width))
        for b, (m, part) in enumerate(zip(P.moving, parts, strict=True)):
            slopes = m.slopes(part, theta[P.numbers(b) - 1])
            pieces.append((b, slopes, P.width + np.arange(self._cuts[b], self._cuts[b + 1])))
        small = P.small(pieces, self._sigma, P.width + len(x))
        W, y = small[:, self._linear], small[:, P.fixed]
        base = Span.of(W[:, free], np.arange(int(free.sum()))).basis
        slope = small[:, P.width :]
        jacobian = -(slope - base @ (base.T @ slope))
        return y - W @ theta, jacobian

    def _solve(self, small: Floats) -> tuple[Floats, Mask]:
        """Return theta and which of its entries are free of bounds."""
        W, y = small[:, self._linear], small[:, self._projection.fixed]
        length = np.linalg.norm(W, axis=0)
        unit = 1.0 / np.where(length > 0, length, 1.0)
        # gelsy: pivoted QR, several times faster than singular values where tables make p large
        options = {"cond": self._limits.tolerance, "lapack_driver": "gelsy", "check_finite": False}
        theta = unit * scipy.linalg.lstsq(W * unit, y, **options)[0]
        free = np.ones(len(theta), bool)
        outside = (theta < self._limits.lower) | (theta > self._limits.upper)
        if outside.any():
            rank = analyse(r_factor(W), self._limits.tolerance)
            theta, active = bounded(W, y, self._limits.lower, self._limits.upper, np.zeros_like(theta), rank)
            free = ~active
        return theta, free


def polish(
    problem: VariableProjection, bounds: tuple[Floats, Floats], start: Floats, most: int = MAX_EVALUATIONS
) -> End:
    """Return the optimum of all shapes near ``start``, within bounds, in search coordinates; most evaluations."""
    few, tolerances = min(most, GAUSS_NEWTON), {"ftol": CLOSE, "xtol": 1e-9}
    end = trust_region(problem.evaluate, start, bounds, 1e-9, x_scale="jac", max_nfev=few, **tolerances)
    left = most - end.evaluations
    return end if end.converged or left <= 0 else _finished(problem, end, bounds, left)


def _finished(problem: VariableProjection, begun: End, bounds: tuple[Floats, Floats], most: int) -> End:
    """Return the end of a quasi-Newton search, its coordinates scaled by the lengths of the Jacobian's columns."""
    length = np.linalg.norm(problem.evaluate(begun.x)[1], axis=0)
    scale = np.where(length > 0.0, length, 1.0)

    def cost(z: Floats) -> tuple[float, Floats]:
        residual, jacobian = problem.evaluate(z / scale)
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
