"""Threads: one of BLAS', whose own make the many small problems here 10 to 200 times slower; several of axes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
Item = TypeVar("Item")


def one_blas_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return ``function`` running with one BLAS thread, whatever the process uses elsewhere."""

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, "blas"):
            return function(*args, **kwargs)

    return run


def side_by_side(work: Callable[[Item], T], items: Sequence[Item]) -> Iterator[T]:
    """Yield ``work`` of every item, in their order, on a thread for each core: for compiled loops without the GIL."""
    threads = min(len(items), _cores())
    if threads < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        # Each in a copy of the caller's context: numpy's error state is part of it.
        yield from pool.map(lambda pair: pair[0].run(work, pair[1]), [(copy_context(), x) for x in items])


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        return os.cpu_count() or 1
