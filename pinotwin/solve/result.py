"""What a linear and a separable fit found, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.solve.problem import Problem


@dataclass(frozen=True)
class LinearFit:
    """The result of :func:`pinotwin.solve.linear`; it keeps its problem.

    In open directions theta stays at the prior with zero covariance, so that it holds for every combination that the
    data determine; :attr:`standard_errors` says infinity for each parameter that is not determined.
    """

    problem: Problem  # the rows that were fitted
    theta: Floats  # coefficients, shape (p,)
    covariance: Floats  # of theta, shape (p, p)
    dof: Floats  # degrees of freedom of each standard error, for Student's t, shape (p,)
    sigma: Floats  # noise level per axis, in the order of ``problem.slices`` [unit of the effort]
    rank: int  # number of directions that the data determine
    condition: float  # condition number of the seen, scaled columns
    determined: Mask  # whether the data determine each parameter, shape (p,)
    unexcited: tuple[int, ...]  # parameters whose column is empty in these data
    groups: tuple[tuple[int, ...], ...]  # parameters that these data cannot distinguish
    active: Mask  # parameters that sit on a bound, shape (p,)
    lower: Floats  # bounds, shape (p,), -inf for none
    upper: Floats  # bounds, shape (p,), inf for none
    factor: Floats  # R of the rows divided by sigma, those of a ridge below, shape (k, p)
    right: Floats  # z with || R theta - z || the weighted residual up to a constant, shape (k,)

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

    def group_names(self) -> tuple[tuple[str, ...], ...]:
        """Return the groups by name."""
        return tuple(tuple(self.names[i] for i in group) for group in self.groups)


@dataclass(frozen=True)
class ShapeFit:
    """One shape parameter as found."""

    block: str  # the moving block it belongs to
    name: str  # its name there
    x: float  # search coordinate (the logarithm if ``log``)
    error: float  # standard error of x, infinite if the data do not determine it
    lower: float  # lower bound of x
    upper: float  # upper bound of x
    log: bool  # searched on a logarithmic scale

    @property
    def value(self) -> float:
        """The shape's value, SI."""
        return float(np.exp(self.x)) if self.log else self.x

    @property
    def standard_error(self) -> float:
        """Standard error of the value, to first order."""
        return self.value * self.error if self.log else self.error

    @property
    def at_bound(self) -> bool:
        """Whether the search ended at a bound."""
        near = 1e-6 * (self.upper - self.lower)
        return not self.lower + near < self.x < self.upper - near
