"""Windows of a log in which a controller is searched: what they remember of one another, and friction about rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.effects import Presliding
from pinotwin.identification.coupled import own_friction
from pinotwin.identification.servo.output_error import polish
from pinotwin.identification.servo.problem import AS_FOUND, AxisProblem
from pinotwin.simulation.tables import tabulate
from tests.simulated import plain_machine, smooth_command
from tests.test_servo import cascade, single, with_measurement


def soft(x_s: float = 4e-5, c: float = 120.0, s: float = 40.0) -> AxisProblem:
    """Return an axis of M, B and friction that gives before it slips."""
    machine = plain_machine("trunnion")
    law = Presliding("Y", x_s=x_s, v_s=0.01, exponent=2.0, bristle=0)
    top = np.array([1.0, 1.0, 1.0])
    lookup = tabulate(machine, [(law, np.array([c, s]))], np.array([-top, top]), top).lookup
    plain = single(smooth_command(machine, 9.0, 500.0), cascade())
    return replace(plain, tables=own_friction(lookup, 0))


def whole_of(p: AxisProblem) -> np.ndarray:
    rows = slice(0, len(p.qr))
    y = replace(p, windows=(rows,), stretches=(rows,)).response(cascade())
    assert y is not None
    return y


def test_windows_that_meet_are_one_run_and_those_across_a_gap_are_not() -> None:
    """Begun afresh, the spring of the friction is unbent where it was not (driller B: 11 instead of 3 % held out)."""
    p = soft()
    n = len(p.qr) // 3
    t = np.arange(len(p.qr)) * p.step
    qr = sum(0.05 * np.clip((t - 3.0 * k - 0.5) / 2.0, 0.0, 1.0) for k in range(3))
    p = replace(p, qr=qr, q=qr, vr=np.gradient(qr, p.step))  # it stands where the windows meet
    one, true = slice(0, 3 * n), whole_of(p)
    q = p.qr.copy()
    q[p.skip :] -= true[:, 0]
    v, u = np.gradient(q, p.step), np.concatenate([np.zeros(p.skip), true[:, 1]])
    v[: p.skip] = 0.0
    p = replace(p, q=q, v=v, u=u)
    rows = np.concatenate([np.arange(s.start + p.skip, s.stop) for s in p.windows]) - p.skip
    together = replace(p, stretches=(one,)).response(cascade())
    apart = replace(p, stretches=(slice(0, n), slice(n, 2 * n), slice(2 * n, 3 * n))).response(cascade())
    assert together is not None
    assert apart is not None
    last = slice(0, -1)  # of a run has no step of its own
    assert (together - true[rows])[last] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(apart - true[rows])[n:, 0].max() > 1e-7


def test_held_out_windows_are_led_to_by_those_that_were_fitted() -> None:
    p = replace(soft(), stretches=(slice(0, len(soft().qr)),))
    train, judge = p.split()
    assert judge.lead == train.windows
    y = judge.response(cascade())
    assert y is not None
    assert len(y) == len(judge.measured)
    assert y == pytest.approx(p.response(cascade())[-len(y) :])
    alone = judge.within(judge.windows)
    assert alone.lead == ()


def test_what_friction_gives_about_rest_is_told_by_the_closed_loop() -> None:
    """Its distance and the part that fades with speed, begun a fifth off; level and viscosity are left alone."""
    p = with_measurement(soft(), cascade(), np.random.default_rng(1), 0.01)
    off = p.with_plant((1.0, 1.0, 1.0, 0.8, 1.25))
    found = polish(off, cascade(), ("fading", "distance"), 8)
    assert found is not None
    assert found.extra[:3] == AS_FOUND[:3]
    assert 0.8 * found.extra[3] == pytest.approx(1.0, abs=0.05)
    assert 1.25 * found.extra[4] == pytest.approx(1.0, abs=0.05)
