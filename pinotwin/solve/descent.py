"""The one bounded search for a least sum of squares whose residuals and slopes come out of one evaluation.

The trust-region reflective method (Branch, Coleman and Li 1999, doi:10.1137/S1064827595289108), as scipy has it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np
import scipy

from pinotwin.arrays import Floats

T = TypeVar("T")


class Remembered(Generic[T]):
    """A function at the last point: residual and slopes are asked for one after the other; ``count`` evaluations."""

    def __init__(self, evaluate: Callable[[Floats], T]) -> None:
        self._evaluate = evaluate
        self._last: tuple[Floats, T] | None = None
        self.count = 0

    def __call__(self, x: Floats) -> T:
        if self._last is None or not np.array_equal(x, self._last[0]):
            self._last = x.copy(), self._evaluate(x)
            self.count += 1
        return self._last[1]


def trust_region(
    evaluate: Callable[[Floats], tuple[Floats, Floats]],
    start: Floats,
    bounds: tuple[Floats, Floats],
    margin: float,
    **options: Any,
) -> Any:
    """Return scipy's answer of a search within bounds.

    Args:
        evaluate: residual (m,) and Jacobian (m, k) at a point (k,).
        start: where the search begins.
        bounds: lower and upper, shapes (k,).
        margin: share of the bounds' width that the start keeps from them.
        options: of `scipy.optimize.least_squares`.
    """
    low, high = bounds
    inside = np.clip(start, low + margin * (high - low), high - margin * (high - low))
    return scipy.optimize.least_squares(
        lambda x: evaluate(x)[0],
        inside,
        lambda x: evaluate(x)[1],
        bounds=bounds,
        method="trf",
        gtol=1e-12,
        **options,
    )
