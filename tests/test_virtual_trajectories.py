"""Jerk-limited commands: limits, closed forms, rest between the moves."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinotwin.diagnosis.conclusion.advice import MOVES, command
from pinotwin.errors import DataError
from pinotwin.trajectories.moves import (
    Limits,
    constant_speeds,
    multisine,
    random_trajectory,
    replay,
    slow_reversals,
)
from pinotwin.trajectories.profiles import chain, move_pieces, move_time

# Table 6-2 of the thesis, SI.
RIG = {
    "Y": Limits(0.277, 1.38, 106.0, (-0.2, 0.2)),
    "A": Limits(*np.radians([110.0, 1230.0, 76700.0]), (-1.4, 1.4)),
    "C": Limits(*np.radians([67.6, 270.0, 2700.0]), (-3.0, 3.0)),
}


@dataclass
class Rig:
    limits: dict = field(default_factory=lambda: dict(RIG))


def at(profile, t):
    """Position, velocity and acceleration of a command."""
    return tuple(profile(t, k) for k in range(3))


def within(trajectory, limits, rate=4000.0):
    t = np.arange(0.0, trajectory.seconds, 1.0 / rate)
    for name, lim in limits.items():
        q, v, a = at(trajectory.profiles[name], t)
        slack = 1.0 + 1e-6
        assert np.abs(v).max() <= lim.speed * slack
        assert np.abs(a).max() <= lim.acceleration * slack
        assert np.abs(np.diff(a)).max() * rate <= lim.jerk * slack
        assert q.min() >= lim.travel[0] - 1e-9
        assert q.max() <= lim.travel[1] + 1e-9
        np.testing.assert_allclose(np.gradient(q, t)[5:-5], v[5:-5], atol=2e-3 * lim.speed)


@settings(max_examples=80, deadline=None)
@given(
    st.floats(1e-6, 10.0),
    st.floats(0.01, 5.0),
    st.floats(0.05, 50.0),
    st.floats(0.5, 5000.0),
    st.floats(1.0, 6.0),
    st.sampled_from((-1.0, 1.0)),
)
def test_a_move_arrives_at_rest_and_keeps_its_limits(d, v, a, j, stretch, sign):
    pieces = move_pieces(0.5, sign * d, (v, a, j), stretch)
    end = 0.5 + stretch * move_time(d, (v, a, j))
    assert pieces[-1][0] == pytest.approx(end, rel=1e-9)
    profile = chain(0.2, [(pieces, 0.2 + sign * d)])
    t = np.linspace(0.0, end, 20001)
    q, dq, ddq = at(profile, t)
    before = at(profile, np.array([end - 1e-9 * end]))
    assert before[0][0] == pytest.approx(0.2 + sign * d, abs=1e-6 * max(d, 1e-3))
    # Times are absolute: rounding of a start time over a short ramp shows as a relative 1e-8.
    assert np.abs(dq).max() <= v / stretch * (1 + 1e-6)
    assert np.abs(ddq).max() <= a / stretch**2 * (1 + 1e-6)
    assert np.abs(profile(t, 3)).max() <= j / stretch**3 * (1 + 1e-6)
    assert np.all(np.diff(sign * q) >= -1e-12)


def test_a_long_move_reaches_the_textbook_time():
    # Speed and acceleration both reached: T = d/v + v/a + a/j.
    d, v, a, j = 1.0, 0.3, 2.0, 50.0
    assert move_time(d, (v, a, j)) == pytest.approx(d / v + v / a + a / j, rel=1e-12)


def test_a_short_move_is_all_jerk():
    # Neither reached: T = 4 (d / 2j)^(1/3).
    d, v, a, j = 1e-5, 0.3, 2.0, 50.0
    assert move_time(d, (v, a, j)) == pytest.approx(4.0 * (d / (2.0 * j)) ** (1 / 3), rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_random_moves_keep_the_limits_of_the_rig(seed):
    trajectory = random_trajectory(Rig(), 20.0, seed)
    within(trajectory, RIG)
    t = np.arange(0.0, 20.0, 1e-3)
    moving = [np.abs(at(trajectory.profiles[n], t)[1]) > 1e-9 for n in RIG]
    assert 0.3 < np.mean(np.any(moving, axis=0)) < 0.98  # it moves, and it dwells
    assert np.mean(np.sum(moving, axis=0) > 1) > 0.2  # several axes at once


def test_random_moves_reach_speed_and_acceleration():
    trajectory = random_trajectory(Rig(), 30.0, 1)
    t = np.arange(0.0, 30.0, 1e-3)
    for name, lim in RIG.items():
        _, v, a = at(trajectory.profiles[name], t)
        assert np.abs(v).max() > 0.99 * lim.speed
        assert np.abs(a).max() > 0.99 * lim.acceleration


def test_seeds_decide_and_other_limits_are_kept():
    first, again, other = (random_trajectory(Rig(), 8.0, s) for s in (1, 1, 2))
    t = np.linspace(0.0, 8.0, 500)
    np.testing.assert_array_equal(at(first.profiles["A"], t)[0], at(again.profiles["A"], t)[0])
    assert np.any(at(first.profiles["A"], t)[0] != at(other.profiles["A"], t)[0])
    slow = {"A": Limits(0.2, 1.0, 20.0, (-0.5, 0.5))}
    within(random_trajectory(Rig(), 8.0, 1, slow), {**RIG, **slow})


def test_multisine_keeps_the_limits_and_starts_at_rest():
    trajectory = multisine(Rig(), 12.0, 3)
    t = np.arange(0.0, 12.0, 1e-4)
    for name, lim in RIG.items():
        q, v, a = at(trajectory.profiles[name], t)
        assert abs(v[0]) < 1e-12
        assert abs(a[0]) < 1e-9
        assert np.abs(v).max() <= lim.speed
        assert np.abs(a).max() <= lim.acceleration
        np.testing.assert_allclose(np.gradient(q, t)[2:-2], v[2:-2], atol=1e-4 * lim.speed)
        np.testing.assert_allclose(np.gradient(v, t)[2:-2], a[2:-2], atol=1e-3 * lim.acceleration)


def test_slow_reversals_and_constant_speeds():
    slow = slow_reversals(Rig(), "Y")
    within(slow, {"Y": RIG["Y"]}, rate=500.0)
    steady = constant_speeds(Rig(), "A")
    within(steady, {"A": RIG["A"]})
    t = np.arange(0.0, steady.seconds, 1e-3)
    v, a = at(steady.profiles["A"], t)[1:]
    speeds = np.unique(np.round(np.abs(v[(a == 0) & (v != 0)]) / RIG["A"].speed, 4))
    assert {0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8} <= set(speeds)
    assert np.ptp(at(steady.profiles["Y"], t)[0]) == 0.0


def test_replay_follows_a_log_and_names_what_is_missing():
    t = np.linspace(0.0, 2.0, 801)
    log = {"t": t, "Y.qr": 0.1 * np.sin(t) ** 3}
    q, v, _ = replay(log, ["Y"]).at(t[::3] + 1e-4, ["Y"])
    late = t[::3] + 1e-4
    np.testing.assert_allclose(q[:-1, 0], 0.1 * np.sin(late[:-1]) ** 3, atol=1e-9)
    np.testing.assert_allclose(v[:-1, 0], 0.3 * np.sin(late[:-1]) ** 2 * np.cos(late[:-1]), atol=1e-5)
    with pytest.raises(DataError, match=r"A\.qr"):
        replay(log, ["Y", "A"])


@pytest.mark.parametrize("kind", list(MOVES))
@pytest.mark.parametrize(
    "rate", [1.0, 0.0]
)  # an axis that swings, and one at a constant speed: no acceleration
def test_an_advised_motion_stays_within_what_the_log_has_shown(kind: str, rate: float) -> None:
    t = np.linspace(0.0, 20.0, 4001)
    q = np.sin(t) if rate else t / 20.0
    v, a = (np.cos(t), -np.sin(t)) if rate else (np.full_like(t, 0.05), np.zeros_like(t))
    other = np.linspace(0.0, 1.0, len(t))
    machine: Any = SimpleNamespace(axes={"X": SimpleNamespace(index=0), "Y": SimpleNamespace(index=1)})
    motion: Any = SimpleNamespace(
        q=np.c_[q, other], v=np.c_[v, other], a=np.c_[a, other], step=t[1], index=["X", "Y"].index
    )
    moves = command(machine, motion, kind, "X")
    assert 5.0 < moves["t"][-1] < 600.0
    assert moves["X.qr"].min() >= q.min() - 1e-9
    assert moves["X.qr"].max() <= q.max() + 1e-9
    assert np.abs(np.gradient(moves["X.qr"], moves["t"])).max() <= 1.001 * np.abs(v).max()
    assert np.ptp(moves["Y.qr"]) == 0.0
