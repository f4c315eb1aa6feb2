"""One function over many items in many processes: a dead worker costs a retry, no answer.

Each process is an executor of its own, so that a dead one accuses its item alone; all end when this one's pipe closes.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from typing import Any

Each = Callable[[Callable[[Any], Any], Sequence[Any], float | None], Iterator[tuple[Any, Any]]]
"""Takes a function, items and a time after which none is begun; yields items with result or exception."""


class KilledWorker(Exception):
    """The process that worked on an item died, the second time while it worked alone."""


@contextmanager
def engine(workers: int, *, apart: bool = False) -> Iterator[Each]:
    """Yield what works on items, each with result or exception, in so many processes; one is this, unless ``apart``."""
    if workers <= 1 and not apart:
        with futures.ThreadPoolExecutor(1) as pool:  # holds what an item ends in, as a process's future does
            yield lambda function, items, end: _work([_Worker(lambda: pool)], function, items, end)
        return
    here, there = Pipe(duplex=False)
    make = partial(futures.ProcessPoolExecutor, 1, get_context("spawn"), _end_with, (here,))
    team = [_Worker(make) for _ in range(workers)]

    def each(
        function: Callable[[Any], Any], items: Sequence[Any], end: float | None
    ) -> Iterator[tuple[Any, Any]]:
        died = []
        for item, result in _work(team, function, items, end):
            if isinstance(result, KilledWorker):
                died.append(item)  # perhaps for want of memory: it is done again, alone
            else:
                yield item, result
        yield from _work(team[:1], function, died, end)

    try:
        yield each
    finally:
        there.close()
        for worker in team:
            worker.pool.shutdown()
        here.close()


class _Worker:
    """An executor of one worker, replaced when that dies."""

    def __init__(self, make: Callable[[], futures.Executor]) -> None:
        self.make, self.pool = make, make()

    def begin(self, function: Callable[[Any], Any], item: Any) -> futures.Future[Any]:
        try:
            return self.pool.submit(function, item)
        except BrokenProcessPool:
            self.pool.shutdown()
            self.pool = self.make()
            return self.pool.submit(function, item)


def _end_with(parent: Connection) -> None:
    """Let this process end when its parent closes the pipe or dies, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        parent.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _work(
    team: Sequence[_Worker], function: Callable[[Any], Any], items: Sequence[Any], end: float | None
) -> Iterator[tuple[Any, Any]]:
    waiting, free = list(items)[::-1], list(team)
    running: dict[futures.Future[Any], tuple[_Worker, Any]] = {}
    while True:
        while waiting and free and not (end is not None and time.monotonic() > end):
            worker, item = free.pop(), waiting.pop()
            running[worker.begin(function, item)] = worker, item
        if not running:
            return
        for job in futures.wait(running, return_when=futures.FIRST_COMPLETED).done:
            worker, item = running.pop(job)
            free.append(worker)
            error = job.exception()
            if isinstance(error, BrokenProcessPool):
                error = KilledWorker(str(error))
            yield item, error or job.result()
