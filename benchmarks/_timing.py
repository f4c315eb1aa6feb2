"""Time of a piece of work."""

from __future__ import annotations

import time
from collections.abc import Callable


def best(
    work: Callable[[], object], repeats: int = 3, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the least time of some runs on a clock, the wall's by default [s]."""
    spans = []
    for _ in range(repeats):
        start = clock()
        work()
        spans.append(clock() - start)
    return min(spans)
