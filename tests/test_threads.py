"""Work side by side: in order, in the caller's context, an error in its turn."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from pinotwin.system import threads
from pinotwin.system.threads import side_by_side


@pytest.fixture(params=[1, 3])
def cores(request, monkeypatch):
    monkeypatch.setattr(threads, "_cores", lambda: request.param)
    return request.param


def test_results_come_in_the_order_of_the_items(cores):
    first = threading.Event()

    def work(x):
        if x == 0 and cores > 1:
            assert first.wait(5.0)  # the others are done before
        first.set()
        return x * x

    assert list(side_by_side(work, range(5))) == [0, 1, 4, 9, 16]


def test_the_first_error_is_raised_in_its_turn(cores):
    del cores
    results = side_by_side(lambda x: 1 / x, [1, 2, 0, 4])
    assert [next(results), next(results)] == [1.0, 0.5]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_what_numpy_does_about_division_by_zero_is_the_callers_choice(cores):
    del cores
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        list(side_by_side(lambda x: np.ones(1) / x, [np.zeros(1), np.ones(1)]))
