"""One function over many items in many processes (Dask distributed): a dead worker costs a retry, no answer.

By default the processes are of this computer and end with it; with a scheduler's address the work goes there.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from pinotwin.errors import InputError

PATIENCE = "10s"
"""How long a scheduler may take to answer."""

Each = Callable[[Callable[[Any], Any], Sequence[Any], float | None], Iterator[tuple[Any, Any]]]
"""Takes a function, items and a time after which none is begun; yields items with result or exception."""


@contextmanager
def engine(workers: int, scheduler: str | None = None, *, apart: bool = False) -> Iterator[Each]:
    """Yield what works on items, as they come, each with its result or the exception that it ended in.

    Args:
        workers: processes of this computer; with 1 and no scheduler the work is done in this process.
        scheduler: address of a running Dask scheduler, such as ``tcp://10.0.0.5:8786``.
        apart: a single worker is a process of its own, too: it may die without this one.

    Raises:
        InputError: nothing answers at that address.
    """
    if workers <= 1 and scheduler is None and not apart:
        yield _here
        return
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                # no page, and any free port for it: the usual one may be another cluster's
                scheduler_kwargs={
                    "dashboard": False,
                    "dashboard_address": "127.0.0.1:0",
                    "allowed_failures": 1,  # and again alone, see _there
                },
                silence_logs=logging.CRITICAL,
            )
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        else:
            try:
                client = stack.enter_context(Client(scheduler, timeout=PATIENCE))
            except (OSError, ValueError) as error:
                raise InputError(
                    f"--scheduler: {scheduler}: no Dask scheduler answers ({error}); start one with "
                    "`dask scheduler`, and `dask worker ADDRESS`"
                ) from None

        def there(
            function: Callable[[Any], Any], items: Sequence[Any], end: float | None
        ) -> Iterator[tuple[Any, Any]]:
            return _there(client, function, items, end)

        yield there


def _here(
    function: Callable[[Any], Any], items: Sequence[Any], end: float | None
) -> Iterator[tuple[Any, Any]]:
    with ThreadPoolExecutor(1) as pool:  # holds what an item ends in, as a worker's future does
        for item in items:
            if end is not None and time.monotonic() > end:
                return
            job = pool.submit(function, item)
            yield item, job.exception() or job.result()


def _there(
    client: Any, function: Callable[[Any], Any], items: Sequence[Any], end: float | None
) -> Iterator[tuple[Any, Any]]:
    """Yield items with what they end in; those whose workers died are done once more, one by one."""
    from distributed import KilledWorker, wait

    room = 1 + max(1, sum(client.nthreads().values()))
    running: dict[Any, Any] = {}
    waiting = list(items)[::-1]
    accused: list[Any] = []
    alone = False
    while running or waiting or accused:
        if not running and not waiting:
            waiting, accused, alone = accused[::-1], [], True
        late = end is not None and time.monotonic() > end
        while waiting and not late and len(running) < (1 if alone else room):
            item = waiting.pop()
            running[client.submit(function, item, pure=False)] = item
        if not running:
            return
        for job in wait(list(running), return_when="FIRST_COMPLETED").done:
            item = running.pop(job)
            error = job.exception()
            if isinstance(error, KilledWorker) and not alone:
                accused.append(item)  # or it waited on a worker that another item killed: it is asked alone
            else:
                yield item, job.result() if error is None else error.with_traceback(job.traceback())
