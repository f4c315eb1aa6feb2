"""What a linear fit found, how sure it is, and how well it judges itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
        factor: R of the rows divided by sigma, shape (p, p).
        right: z with || R theta - z || the weighted residual up to a constant, shape (p,).
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
