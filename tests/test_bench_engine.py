"""The bench's engine: dead workers, broken lines, errors and a killed parent change no answer."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from pinotwin.bench.engine import KilledWorker, engine


def each(function: Callable[[Any], Any], count: int, workers: int) -> dict[int, Any]:
    with engine(workers) as run:
        return dict(run(function, range(count), None))


def squared(item: int) -> int:
    return item * item


def dies_once(folder: str, item: int) -> int:
    """Kill this worker, as the system does when memory is short, the first time that item 3 is reached."""
    flag = Path(folder) / "died"
    if item == 3 and not flag.exists():
        flag.write_text("")
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item


def fails(item: int) -> int:
    if item == 2:
        raise ValueError("two")
    return item


@pytest.mark.parametrize("workers", [1, 2])
def test_every_item_has_its_result(workers: int) -> None:
    assert each(squared, 8, workers) == {k: k * k for k in range(8)}


def test_a_dead_worker_changes_no_answer(tmp_path: Path) -> None:
    found = each(functools.partial(dies_once, str(tmp_path)), 8, 2)
    assert (tmp_path / "died").exists()
    assert found == {k: k * k for k in range(8)}


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_belongs_to_its_item(workers: int) -> None:
    found = each(fails, 5, workers)
    assert isinstance(found.pop(2), ValueError)
    assert found == {k: k for k in (0, 1, 3, 4)}


PARENT = """
import time
from pinotwin.bench.engine import KilledWorker, engine
if __name__ == "__main__":
    with engine(2) as run:
        list(run(time.sleep, [60.0] * 4, None))
"""


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    parent = psutil.Popen([sys.executable, str(tmp_path / "parent.py")], stdout=subprocess.DEVNULL)
    end = time.monotonic() + 60.0
    while len(parent.children(recursive=True)) < 3 and time.monotonic() < end:
        time.sleep(0.2)
    children = parent.children(recursive=True)
    assert len(children) >= 2
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert psutil.wait_procs(children, timeout=30.0)[1] == []


@pytest.mark.filterwarnings("error")
def test_two_engines_at_once_do_not_meet() -> None:
    with engine(1, apart=True) as one, engine(1, apart=True) as other:
        assert dict(one(squared, [2], None)) == {2: 4}
        assert dict(other(squared, [3], None)) == {3: 9}


def kills(item: int) -> int:
    if item == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.2)
    return item


def test_an_item_that_always_kills_its_worker_costs_no_other_its_result() -> None:
    found = each(kills, 6, 2)
    assert isinstance(found.pop(1), KilledWorker)
    assert found == {k: k for k in (0, 2, 3, 4, 5)}
