"""Which gains of a controller the log determines, and what intervals kp and 1/ti have as nearly equal roots."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinotwin.loop import Servo
from pinotwin.loop.servo import DISTANCE, FOLLOWING, Roots

LAG = 4e-4


def cascade(kp: float = 60.0, rate: float = 50.0, **more: float) -> Servo:
    return Servo.of_cascade(kp, 5000.0, rate, 0.9, 30.0, velocity_lag=LAG, **more)


@pytest.mark.parametrize(("kp", "rate"), [(60.0, 50.0), (40.0, 70.0), (55.0, 55.0)])
def test_both_roots_have_the_feedback_of_the_cascade(kp: float, rate: float) -> None:
    servo = cascade(kp, rate)
    roots = Roots.of(servo.gains, LAG)
    half = roots.half()
    ends = [servo.with_rate(roots.rate + side * half) for side in (-1.0, 1.0)]
    assert any(end["kp"] == pytest.approx(kp, rel=1e-5) for end in ends)
    assert any(end["rate"] == pytest.approx(rate, rel=1e-5) for end in ends)
    for end in ends:
        other = Servo.of_cascade(**end, velocity_lag=LAG)
        assert other.gains == pytest.approx(servo.gains, rel=1e-9)


GAINS = st.fixed_dictionaries(
    {
        "kp": st.floats(1.0, 400.0),
        "kv": st.floats(0.1, 1e5),
        "rate": st.floats(1.0, 400.0),
        "ffv": st.just(0.0) | st.floats(0.01, 1.3),
        "ffa": st.floats(0.0, 100.0),
        "velocity_lag": st.floats(0.0, 1e-3),
    }
)


@given(GAINS)
def test_named_gains_of_a_cascade_are_those_that_made_the_law(gains: dict[str, float]) -> None:
    """Both ways round have one feedback; with set-point weight 1 imposed the right one is told by it."""
    found = Servo.of_cascade(**gains).cascades()
    near = {k: pytest.approx(gains[k], rel=1e-3, abs=1e-3) for k in ("kp", "rate")}
    assert any(f["kp"] == near["kp"] and f["rate"] == near["rate"] for f in found)
    for f in found:
        assert Servo.of_cascade(**f, velocity_lag=gains["velocity_lag"]).gains == pytest.approx(
            Servo.of_cascade(**gains).gains, rel=1e-6, abs=1e-6
        )


@given(GAINS)
def test_a_law_without_an_integral_has_none_when_it_is_named(gains: dict[str, float]) -> None:
    servo = Servo.of_cascade(**{**gains, "rate": 0.0})
    assert servo.form == "proportional"
    named = servo.named()
    assert named == pytest.approx({**gains, "rate": 0.0, "weight": 1.0, "output_lag": 0.0, "dead": 0.0})
    assert servo.cascades() == [servo.cascade()]
    assert servo.combined() == {}
    assert not servo.tied


@given(GAINS, st.floats(0.1, 0.9))
def test_no_name_of_a_cascade_has_a_negative_gain(gains: dict[str, float], weight: float) -> None:
    servo = Servo.of_cascade(**gains, weight=weight)
    assert servo.cascades()
    for f in servo.cascades():
        assert min(f["kp"], f["kv"], f["rate"]) >= 0.0


def drawn(servo: Servo, error: float, rng: np.random.Generator, count: int = 2000) -> list[Servo]:
    """Return laws whose k_e and k_i scatter by a share of themselves."""
    factors = 1.0 + error * rng.normal(size=(count, 2))
    g = servo.gains
    return [replace(servo, gains=(g[0] * a, g[1] * b, *g[2:])) for a, b in factors]


def with_errors(servo: Servo, error: float) -> Servo:
    """Return a law with the standard errors that such a scatter makes, kp and 1/ti in their middle."""
    A, B = servo.gains[0] / servo.gains[2], servo.gains[1] / servo.gains[2]
    apart = error * np.hypot(2.0 * A * (A - LAG * B), 4.0 * B)
    errors = {"kp": 0.5 * error * A, "rate": 0.5 * error * A, "kv": 50.0, "ffv": 0.005, "ffa": 1.0}
    return replace(servo, errors={**errors, "kp + rate": error * A, "kp * rate": error * B, DISTANCE: apart})


@pytest.mark.parametrize("error", [0.003, 0.02])
def test_intervals_of_nearly_equal_roots_hold_the_truth_as_often_as_they_say(error: float) -> None:
    """And are no wider than the roots scatter: the slopes of a square root would be, without bound."""
    true = cascade(60.0, 50.0)
    laws = drawn(true, error, np.random.default_rng(1))
    told = [with_errors(servo, error) for servo in laws]
    told = [replace(servo, other=servo.cascades()[1]) for servo in told]
    for name, value in (("kp", 60.0), ("rate", 50.0)):
        ends = np.array([servo.intervals()[name] for servo in told])
        assert np.mean((ends[:, 0] <= value) & (value <= ends[:, 1])) >= 0.87
        found = [c[name] for servo in laws for c in servo.cascades()]
        assert np.median(ends[:, 1] - ends[:, 0]) < 1.5 * np.ptp(np.quantile(found, [0.02, 0.98]))


def test_a_narrow_gain_is_determined_beside_two_that_are_tied() -> None:
    servo = with_errors(cascade(), 0.005)
    servo = replace(servo, other=servo.cascades()[1])
    assert servo.tied
    determined = servo.determined()
    assert not determined.pop("kp")
    assert not determined.pop("rate")
    assert set(determined) == {"kv", "ffv", "ffa", "kp + rate", "kp * rate"}
    assert all(determined.values())
    wide = replace(servo, errors={**servo.errors, "kv": 400.0})
    assert not wide.determined()["kv"]


def test_equal_roots_are_determined_though_they_are_tied() -> None:
    servo = with_errors(cascade(55.0, 55.0), 0.0005)
    servo = replace(servo, other=servo.cascades()[-1])
    assert servo.determined()["kp"]
    assert not with_errors(replace(servo, errors={}), 0.05).determined()["kp"]


def test_roots_that_are_told_apart_have_their_own_side() -> None:
    servo = with_errors(cascade(80.0, 30.0), 0.01)
    assert not servo.tied
    kp, rate = servo.intervals()["kp"], servo.intervals()["rate"]
    assert rate[1] < 0.5 * (kp[0] + kp[1])
    assert kp[0] < 80.0 < kp[1]
    assert rate[0] < 30.0 < rate[1]


def test_a_pid_says_the_sum_of_two_gains_where_one_is_small() -> None:
    gains = (3e5, 5e6, 5000.0, 5070.0, 0.0, 30.0)
    servo = Servo(gains, form="pid", errors={"kd": 50.0, "ffv": 40.0, "kd + ffv": 60.0})
    assert servo.determined() == {"kd": True, "ffv": False, "kd + ffv": True}


def test_a_law_without_feed_forward_is_written_too() -> None:
    servo = Servo.of_cascade(60.0, 5000.0, 50.0, 0.0, 0.0)
    servo = replace(with_errors(servo, 0.01), other={"kp": 50.0, "rate": 60.0, "weight": float("inf")})
    written = json.loads(json.dumps(servo.to_dict(), allow_nan=False))
    assert Servo.from_dict(written).gains == servo.gains


def test_what_is_said_is_written_and_read_again() -> None:
    servo = with_errors(cascade(), 0.005)
    written = json.loads(json.dumps(servo.to_dict()))
    assert written["determined"]["kv"]
    assert written["intervals"]["kv"] == pytest.approx(servo.intervals()["kv"])
    assert written["combined"]["kp + rate"] == pytest.approx(110.0)
    assert Servo.from_dict(written) == servo


def test_following_error_at_constant_velocity_and_its_interval() -> None:
    for rate, weight in ((50.0, 1.0), (50.0, 0.7), (0.0, 1.0)):
        servo = Servo.of_cascade(60.0, 5000.0, rate, 0.9, 30.0, weight=weight, velocity_lag=LAG)
        assert servo.service()["Kv"][0] == pytest.approx(600.0)
    servo = replace(with_errors(cascade(), 0.005), errors={FOLLOWING: 1e-4})
    assert servo.service()["Kv"][1:] == pytest.approx(
        (1.0 / (1 / 600 + 1.645e-4), 1.0 / (1 / 600 - 1.645e-4))
    )
    full = Servo.of_cascade(60.0, 5000.0, 50.0, 1.0, 30.0)
    assert full.service()["Kv"][0] == np.inf
    wide = replace(cascade(), errors={FOLLOWING: 2e-3}).service()["Kv"]
    assert wide[2] == np.inf
    assert json.loads(json.dumps(full.to_dict(), allow_nan=False))["service"]["Kv"]["value"] is None
