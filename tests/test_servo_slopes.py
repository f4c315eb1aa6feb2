"""Slopes of the simulated axis over what is searched of its controller: difference quotients say the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pinotwin.identification.servo.output_error import misfit, polish
from pinotwin.identification.servo.problem import PLANT, AxisProblem
from pinotwin.loop import Servo
from pinotwin.simulation.law import LONGEST
from tests.simulated import plain_machine, smooth_command
from tests.test_servo import cascade, single, with_measurement

NOTCH = (95.0, 0.08, 0.6)
LAWS: dict[str, Callable[[], Servo]] = {
    "six gains": lambda: cascade(velocity_lag=3e-4, output_lag=1.5e-4, dead=1e-4),
    "notch, late by many steps": lambda: cascade(
        velocity_lag=5e-4, output_lag=2e-4, dead=1.7e-3, notch=NOTCH
    ),
    "cascade": lambda: Servo.of_cascade(60.0, 5000.0, 40.0, 0.93, 30.0, velocity_lag=3e-4, output_lag=1e-4),
    "no integral": lambda: Servo((3e5, 0.0, 5e3, 4.6e3, 0.0, 30.0), 3e-4, form="proportional", offset=4.0),
}


def logged(servo: Servo, rate: float = 500.0, fading: float = 0.0) -> AxisProblem:
    """An axis as its controller is searched; dry friction falls with speed by a share."""
    problem = replace(single(smooth_command(plain_machine("trunnion"), 9.0, rate), servo), fine=LONGEST)
    t = problem.tables
    speed = np.linspace(0.0, 1.0, t.dry.shape[-1]) ** 2
    tables = t._replace(dry=t.dry * (1.0 + fading * np.exp(-speed / 0.05)))
    return with_measurement(replace(problem, tables=tables), servo, np.random.default_rng(5), 0.01)


@pytest.mark.parametrize("law", LAWS)
def test_slopes_are_difference_quotients(law: str) -> None:
    agree(logged(LAWS[law](), fading=0.4), LAWS[law]())


def test_slopes_of_an_effort_at_its_limit_are_difference_quotients() -> None:
    p = logged(cascade(velocity_lag=3e-4))
    agree(p, cascade(velocity_lag=3e-4, limit=0.95 * float(np.abs(p.u).max())))


def agree(p: AxisProblem, law: Servo) -> None:
    """Hold the Jacobian of a search that has not moved against central difference quotients."""
    found = polish(p, law, PLANT[:4], steps=0)
    assert found is not None
    search, x = found.search, found.x

    def at(x: np.ndarray) -> Any:
        return misfit(p, search.servo(x), search.extra(x))

    rows = len(found.residual)
    for name, slope, d in zip(search.names, found.jacobian[:rows].T, 1e-6 * np.eye(len(x)), strict=True):
        quotient = (at(x + d) - at(x - d)) / 2e-6
        assert np.linalg.norm(slope - quotient) <= 2e-4 * np.linalg.norm(quotient), name


def test_friction_with_a_memory_is_searched_by_differences() -> None:
    p = logged(cascade(velocity_lag=3e-4))
    t = p.tables
    slips = t._replace(
        slips=np.zeros(1, dtype=np.intp),
        give=np.full((1, t.give.shape[1]), 1e5),
        slip=np.full((1, 1, t.dry.shape[-1]), 5.0),
        memory=np.zeros((1, 4)),
    )
    q = replace(p, tables=slips)
    assert p.step_of_slopes < q.step_of_slopes
    found = polish(q, cascade(kp=55.0, velocity_lag=3e-4), steps=2)
    assert found is not None
    assert np.isfinite(found.jacobian).all()
