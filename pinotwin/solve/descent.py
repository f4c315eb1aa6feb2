"""The bounded least-squares search: trust-region reflective (Branch, Coleman, Li 1999, 10.1137/S1064827595289108)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from pinotwin.arrays import Floats

Evaluate = Callable[[Floats], tuple[Floats, Floats]]  # From a point (k,) to residual (m,) and Jacobian (m, k)


@dataclass(frozen=True)
class End:
    """Where a search ended, (k,), half its sum of squares, its evaluations, and whether it ended by itself."""

    x: Floats
    cost: float
    evaluations: int
    converged: bool


class Remembered:
    """A function at the last point: residual and slopes are asked for one after the other."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self._last: tuple[Floats, tuple[Floats, Floats]] | None = None

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        if self._last is None or not np.array_equal(x, self._last[0]):
            self._last = x.copy(), self._evaluate(x)
        return self._last[1]


def trust_region(
    evaluate: Remembered, start: Floats, bounds: tuple[Floats, Floats], margin: float, **options: Any
) -> End:
    """Return the end of a search within bounds, shape (k,), begun a share of their width inside."""
    low, high = bounds
    inside = np.clip(start, low + margin * (high - low), high - margin * (high - low))
    found = scipy.optimize.least_squares(
        lambda x: evaluate(x)[0], inside, lambda x: evaluate(x)[1], bounds=bounds, gtol=1e-12, **options
    )
    return End(np.asarray(found.x), float(found.cost), int(found.nfev), found.status > 0)


def rival(
    polish: Callable[..., End], start: Floats, best: End, near: float, evaluations: int = 4
) -> list[End]:
    """Return the ends of a search from another start, shape (k,): after a glance, if that is near its own."""
    glance = polish(start, most=evaluations)
    return [glance] if glance.cost > near * best.cost else [glance, polish(glance.x)]
