"""What a linear and a separable fit found, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.solve.problem import Problem


@dataclass(frozen=True)
class LinearFit:
    """The result of :func:`pinotwin.solve.linear`; it keeps its problem.

    Attributes:
        problem: the rows that were fitted.
        theta: coefficients, shape (p,).
        covariance: of theta, shape (p, p). In directions that the data leave open it is zero (theta
            stays at the prior there), so it holds for every combination that the data determine;
            :attr:`standard_errors` says infinity for each parameter that is not determined.
        dof: degrees of freedom of the covariance, for Student's t.
        sigma: noise level per axis, in the order of ``problem.slices`` [unit of the effort].
        rank: number of directions that the data determine.
        condition: condition number of the seen, scaled columns.
        determined: whether the data determine each parameter, shape (p,).
        unexcited: parameters whose column is empty in these data.
        groups: parameters that these data cannot tell apart.
        active: parameters that sit on a bound, shape (p,).
        lower: bounds, shape (p,), -inf for none.
        upper: bounds, shape (p,), inf for none.
        factor: R of the rows divided by sigma, those of a ridge below, shape (k, p).
        right: z with || R theta - z || the weighted residual up to a constant, shape (k,).
        lags: bandwidth of the covariance, in slots of the time axis.
    """

    problem: Problem
    theta: Floats
    covariance: Floats
    dof: float
    sigma: Floats
    rank: int
    condition: float
    determined: Mask
    unexcited: tuple[int, ...]
    groups: tuple[tuple[int, ...], ...]
    active: Mask
    lower: Floats
    upper: Floats
    factor: Floats
    right: Floats
    lags: int

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every parameter."""
        return self.problem.names

    @cached_property
    def residual(self) -> Floats:
        """Measured minus fitted effort, shape (rows,)."""
        return self.problem.y - self.problem.W @ self.theta

    @cached_property
    def standard_errors(self) -> Floats:
        """Standard error of every parameter, infinite where it is not determined, shape (p,)."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return np.where(self.determined, deviation, np.inf)

    def interval(self, level: float = 0.95) -> Floats:
        """Return the confidence interval of every parameter, cut at its bounds, shape (p, 2)."""
        reach = float(scipy.special.stdtrit(self.dof, 0.5 + level / 2)) * self.standard_errors
        low = np.maximum(self.theta - reach, self.lower)
        high = np.minimum(self.theta + reach, self.upper)
        return np.stack([low, high], axis=1)

    def group_names(self) -> tuple[tuple[str, ...], ...]:
        """Return the groups by name."""
        return tuple(tuple(self.names[i] for i in group) for group in self.groups)


@dataclass(frozen=True)
class Basin:
    """A local optimum of one block's shapes.

    Attributes:
        x: search coordinates, shape (s,).
        gain: drop of the weighted sum of squares that the block brings there.
    """

    x: Floats
    gain: float


@dataclass(frozen=True)
class ShapeFit:
    """One shape parameter as found.

    Attributes:
        block: the moving block it belongs to.
        name: its name there.
        x: search coordinate (the logarithm if ``log``).
        error: standard error of x, infinite if the data do not determine it.
        dof: degrees of freedom, for Student's t.
        lower: lower bound of x.
        upper: upper bound of x.
        log: searched on a logarithmic scale.
    """

    block: str
    name: str
    x: float
    error: float
    dof: float
    lower: float
    upper: float
    log: bool

    @property
    def value(self) -> float:
        """The shape's value, SI."""
        return self._value(self.x)

    @property
    def standard_error(self) -> float:
        """Standard error of the value, to first order."""
        return self.value * self.error if self.log else self.error

    @property
    def determined(self) -> bool:
        """Whether the data determine it."""
        return bool(np.isfinite(self.error)) and self.bound is None

    @property
    def bound(self) -> Literal["lower", "upper"] | None:
        """The bound at which the search ended, if any."""
        near = 1e-6 * (self.upper - self.lower)
        if self.x <= self.lower + near:
            return "lower"
        return "upper" if self.x >= self.upper - near else None

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of the value, cut at the bounds."""
        reach = float(scipy.special.stdtrit(self.dof, 0.5 + level / 2)) * self.error
        low, high = max(self.x - reach, self.lower), min(self.x + reach, self.upper)
        return self._value(low), self._value(high)

    def _value(self, x: float) -> float:
        return float(np.exp(x)) if self.log else x


@dataclass(frozen=True)
class SeparableFit:
    """The result of :func:`pinotwin.solve.separable.separable`.

    Attributes:
        fit: linear fit with all columns at the shapes found (fixed first, then block by block); its
            covariance and intervals include the uncertainty of the shapes.
        shapes: every shape, block by block.
        x: search coordinates of all shapes, shape (s,).
        covariance: of (theta, x) together, shape (p + s, p + s).
        basins: per block the local optima of its own scan, best first; ``x`` holds shape values.
        evaluations: number of candidates tried.
        converged: whether the final search ended by itself.
    """

    fit: LinearFit
    shapes: tuple[ShapeFit, ...]
    x: Floats
    covariance: Floats
    basins: tuple[tuple[Basin, ...], ...]
    evaluations: int
    converged: bool

    def shape_values(self, block: str) -> Floats:
        """Return the shape values of one block."""
        return np.array([s.value for s in self.shapes if s.block == block])
