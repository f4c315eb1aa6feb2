"""What a separable fit found: a linear fit and its shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.solve.result import LinearFit
from pinotwin.solve.scan import Basin


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
