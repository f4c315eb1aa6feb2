"""The gains of a controller from its own signals: neither the encoder's steps nor a wrong plant reach them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.identification.servo.law_alone import LawAlone
from pinotwin.identification.servo.moments import by_moments
from pinotwin.identification.servo.output_error import polish, search_of
from pinotwin.identification.servo.problem import AxisProblem
from pinotwin.loop import Servo, command_rates
from pinotwin.simulation.law import LONGEST
from tests.simulated import plain_machine, smooth_command
from tests.test_servo import cascade, drive, single, with_measurement

SHAPES = {"velocity_lag": 3e-4, "output_lag": 1.5e-4, "dead": 1e-4}


@pytest.fixture(scope="module")
def logged() -> AxisProblem:
    """An axis with coarse steps of its encoder and noise on its effort, at 500 Hz for 12 s."""
    problem = single(smooth_command(plain_machine("trunnion"), 12.0, 500.0), cascade())
    rng = np.random.default_rng(4)
    e, u = drive(problem.qr, problem.step, ffv=0.9).T
    q = np.round((problem.qr - e) / 1e-6) * 1e-6
    u = u + 0.01 * np.std(u) * rng.normal(size=len(u))
    vr = command_rates(problem.qr, problem.step)[0]
    problem = replace(problem, q=q, u=u, v=np.gradient(q, problem.step), vr=vr, fine=LONGEST)
    sizes = np.sqrt(np.mean(problem.measured**2, axis=0))
    return replace(problem, sizes=sizes, noise=np.array([0.01, 0.01]))


def test_gains_are_those_of_the_drive_though_the_plant_is_wrong(logged: AxisProblem) -> None:
    """A tenth more friction and 3 % more inertia than there is: the output error takes them up, the moments do not."""
    wrong = logged.with_plant((1.03, 1.1, 1.1, 1.0, 1.0))
    near = polish(wrong, Servo.of_cascade(45.0, 5500.0, 55.0, 0.92, 25.0, **SHAPES))
    assert near is not None
    best = by_moments(wrong, near.servo)[0].servo.named()
    true = {
        "kp": (60.0, 0.07),
        "rate": (40.0, 0.07),
        "kv": (5000.0, 0.02),
        "ffv": (0.9, 0.02),
        "ffa": (30.0, 0.02),
    }
    for name, (value, within) in true.items():
        assert best[name] == pytest.approx(value, rel=within), name
    assert abs(near.servo.named()["kp"] / 60.0 - 1.0) > 0.1, "the plant was not wrong enough to show anything"


@pytest.mark.parametrize("shapes", [SHAPES, {**SHAPES, "notch": (95.0, 0.08, 0.6)}])
def test_the_law_alone_makes_the_effort_of_the_simulated_axis(shapes: dict[str, float]) -> None:
    """Simulated and alone the law is one: what is left is the clock of the one and of the other."""
    servo = cascade(**shapes)
    log = smooth_command(plain_machine("trunnion"), 12.0, 500.0)
    plain = replace(single(log, servo), fine=LONGEST)
    problem = replace(plain, vr=command_rates(plain.qr, plain.step)[0])
    problem = with_measurement(problem, servo, np.random.default_rng(1), 0.0)
    law = LawAlone.of(problem, servo)
    assert law is not None
    for left, s in zip(law.residual(servo), law.stretches, strict=True):
        assert np.std(left) < 0.01 * np.std(s.u)


def test_slopes_are_those_of_the_effort(logged: AxisProblem) -> None:
    servo = Servo.of_cascade(60.0, 5000.0, 40.0, 0.9, 30.0, notch=(95.0, 0.1, 0.6), **SHAPES)
    law = LawAlone.of(logged, servo)
    assert law is not None
    search, x = search_of(servo)
    Z = law.instruments(search, x)
    simulated = replace(law, stretches=tuple(replace(s, measured=s.simulated) for s in law.stretches))
    for i, name in enumerate(search.names):
        step = 1e-4 * np.eye(len(x))[i]
        slope = (simulated.left(search.servo(x - step)) - simulated.left(search.servo(x + step))) / (2 * 1e-4)
        assert Z[:, i] == pytest.approx(slope, abs=1e-3 * np.abs(slope).max() + 1e-9), name
