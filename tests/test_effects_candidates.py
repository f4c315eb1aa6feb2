"""Which effects are looked for in a log: what it cannot show is not asked of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lsim

from pinotwin.dynamics.batch import inverse
from pinotwin.effects import EFFECTS, LISTED, Tree
from pinotwin.effects.transmission import LOAD
from pinotwin.errors import DataError, MachineError
from pinotwin.machine import Machine
from pinotwin.machine.effect_list import make_effects
from pinotwin.motion import Motion
from tests.motions import multisine
from tests.test_effects_battery import told, tree


@pytest.fixture(scope="module")
def motion() -> Motion:
    return told(multisine(n=8000))


def found(name: str, axis: str, motion: Motion):
    return EFFECTS[name].candidates(tree(), axis, motion)


@pytest.mark.parametrize("name", [n for n in LISTED if n not in ("wrist_coupling", "ripple_modulated")])
def test_a_rich_log_is_searched_for_every_effect(name, motion):
    assert found(name, "Y", motion)
    assert found(name, "A", motion)


@pytest.mark.parametrize("name", [n for n in EFFECTS if n != "rigid_body"])
def test_an_axis_that_stands_is_searched_for_nothing(name, motion):
    rest = dataclasses.replace(motion, q=0 * motion.q, v=0 * motion.v, a=0 * motion.a)
    assert found(name, "Y", rest) == ()


def test_presliding_and_play_need_rate_and_resolution(motion):
    slow = motion.every(100)  # 10 Hz
    assert found("presliding", "Y", slow) == ()
    assert found("backlash", "Y", slow) == ()
    assert found("drive_flexibility", "Y", slow) == ()
    noisy = motion.q + 1e-3 * np.random.default_rng(1).standard_normal(motion.q.shape)
    assert found("presliding", "Y", dataclasses.replace(motion, q=noisy)) == ()


def test_a_wrist_couples_axes_that_a_gear_can_reach():
    """On an arm of seven axes one cause was a gear between the first and the last but one."""
    arm = Tree.of(Machine.load("tx40"))
    assert arm.apart("J5", "J6") == arm.apart("J6", "J5") == 1
    w, t, use = np.arange(1.0, 7.0), 0.01 * np.arange(800)[:, None], np.ones((800, 6), dtype=bool)
    q, v, a = np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)
    swings = Motion(arm.names, arm.rotary, t[:, 0], q, v, a, v, (slice(0, 800),), 0.01, use)
    partners = {e.partner for e in EFFECTS["wrist_coupling"].candidates(arm, "J6", swings)}
    assert partners == {"J4", "J5"}


def test_a_stribeck_curve_needs_slow_rows(motion):
    fast = dataclasses.replace(motion, v=motion.v + 0.5 * np.sign(motion.v))
    assert found("stribeck", "Y", fast) == ()


def test_one_direction_alone_shows_no_dry_friction(motion):
    forward = dataclasses.replace(motion, v=np.abs(motion.v) + 0.01)
    for name in ("coulomb", "coulomb_asymmetric", "stribeck", "backlash"):
        assert found(name, "Y", forward) == ()


def test_warming_needs_time_and_saturation_a_flat_top(motion):
    assert found("viscous_thermal", "Y", motion.cut(0, 2000)) == ()
    assert found("saturation", "Y", motion) == ()
    u = np.clip(20.0 * np.sin(motion.t), -8.0, 8.0)
    (limited,) = found("saturation", "Y", dataclasses.replace(motion, u=np.stack([u, u], axis=1)))
    assert limited.limit == pytest.approx(8.0)


def test_a_constant_load_is_dry_friction(motion):
    flat = dataclasses.replace(motion, rigid=np.ones_like(motion.q))
    assert found("load_friction", "Y", flat) == ()


def test_the_controller_needs_a_command(motion):
    deaf = dataclasses.replace(motion, qr=None, vr=None, ar=None)
    assert found("feedforward", "Y", deaf) == ()
    assert found("loop_gain", "Y", deaf) == ()


def test_a_log_without_a_model_says_what_it_needs(motion):
    with pytest.raises(DataError, match="with_model_effort"):
        found("effort_scale", "Y", multisine())[0].columns(multisine())


def test_an_effect_without_its_machine_says_so(motion):
    with pytest.raises(MachineError, match="bound"):
        EFFECTS["payload"](axis="Y").columns(motion)


def test_a_found_ripple_is_written_with_its_pitch(motion):
    ripple = found("ripple", "A", motion)[5]
    assert ripple.shapes()
    assert not ripple.settled().shapes()


def turning(q: np.ndarray) -> Motion:
    base = multisine(n=len(q))
    return dataclasses.replace(base, q=np.stack([base.q[:, 0], q], axis=1))


def test_a_table_on_an_axis_without_stops_repeats_with_the_turn():
    q = np.linspace(-1.0, 20.0, 4000)
    table = EFFECTS["position_table"].on(tree(), "A").fitted_to(turning(q))
    once, again = (table.columns(turning(x)).values for x in (q, q + 2 * np.pi))
    np.testing.assert_allclose(once, again, atol=1e-9)
    np.testing.assert_allclose(once.sum(axis=2), 1.0)
    assert len(table.knots) == 100
    part = np.linspace(0.2, 1.0, 4000)
    table = EFFECTS["position_table"].on(tree(), "A").fitted_to(turning(part))
    once, again = (table.columns(turning(x)).values for x in (part, part - 6 * np.pi))
    np.testing.assert_allclose(once, again, atol=1e-9)


def test_ripples_of_an_axis_without_stops_are_parts_of_a_turn():
    motion = turning(np.linspace(0.0, 40.0, 4000))
    turns = 2 * np.pi / np.array([e.period for e in found("ripple", "A", motion)])
    np.testing.assert_allclose(turns, np.round(turns))


def test_a_rotation_with_stops_is_not_wrapped():
    bounded = tree().model.copy()
    bounded.lowerPositionLimit, bounded.upperPositionLimit = np.full(2, -20.0), np.full(2, 20.0)
    table = EFFECTS["position_table"].on(Tree(bounded, ("Y", "A"), (False, True)), "A")
    knots = table.fitted_to(turning(np.linspace(0.0, 12.0, 4000))).knots
    assert knots[-1] - knots[0] > 12.0


def test_payload_is_the_effort_of_a_body_on_the_link(motion):
    body = pin.Inertia(0.7, np.array([0.02, -0.03, 0.1]), np.diag([1e-3, 2e-3, 3e-3]))
    loaded = tree().model.copy()
    loaded.inertias[2] = loaded.inertias[2] + body
    path = (motion.q, motion.v, motion.a)
    (payload,) = found("payload", "A", motion)
    effort = payload.columns(motion).effort(body.toDynamicParameters(), 2)
    np.testing.assert_allclose(effort, inverse(loaded, *path) - inverse(tree().model, *path), atol=1e-9)


def test_a_flexible_drive_passes_on_what_its_transfer_function_does(motion):
    drive = EFFECTS["drive_flexibility"].on(tree(), "Y").shaped((25.0, 0.1))
    column = drive.columns(motion).values[:, 0, 0]
    w = 2 * np.pi * 25.0
    itself = motion.mass[:, 0, 0] * motion.a[:, 0]
    load = itself + (motion.rigid[:, 0] - itself) / LOAD  # of the inertia a share, of all else the whole
    _, passed, _ = lsim(([2 * 0.1 * w, w * w], [1.0, 2 * 0.1 * w, w * w]), load, motion.t)
    later = motion.t > 2.0
    assert np.abs(column - (passed - load))[later].max() < 1e-3 * np.abs(column[later]).max()


def test_a_spring_whose_swing_at_the_start_is_not_known_is_at_rest_where_its_load_is(motion):
    """Foreign 807: a load that dropped on its spring when the log began rang on for two seconds in the column."""
    still, moves = motion.t < 0.8, motion.t >= 0.8
    a = np.where(moves, motion.a[:, 0], 50.0 * np.exp(-motion.t / 0.02))[:, None]
    dropped = dataclasses.replace(motion, a=np.hstack([a, motion.a[:, 1:]]), rigid=60.0 * a * [1.0, 0.0])
    drive = EFFECTS["drive_flexibility"].on(tree(), "Y").shaped((15.0, 0.01))
    column = np.abs(drive.columns(dropped).values[:, 0, 0])
    late = still & (motion.t > 0.5)
    assert column[late].max() < 1e-3 * column[moves].max()


def test_a_delay_is_the_shifted_effort_where_the_span_is_the_delay(motion):
    late = EFFECTS["delay"].on(tree(), "A").shaped((3e-3,))
    m = motion.model[:, 1]
    shifted = np.interp(motion.t - 3e-3, motion.t, m)
    np.testing.assert_allclose(3e-3 * late.columns(motion).values[:, 0, 0], shifted - m, atol=1e-12)
    first = EFFECTS["delay"].on(tree(), "A").shaped((0.0,)).columns(motion).values[:, 0, 0]
    np.testing.assert_allclose(first, -np.gradient(m, motion.step), atol=1e-9)


def test_an_encoder_error_is_an_acceleration_that_the_log_does_not_hold(motion):
    error = EFFECTS["encoder_error"].on(tree(), "A").shaped((1.5,))
    column = error.columns(motion).values[:, 0, 0]
    e = np.cos(2 * np.pi * motion.q[:, 1] / 1.5)
    bend = np.gradient(np.gradient(e, motion.step), motion.step)
    inner = slice(10, -10)
    expected = -motion.mass[inner, 1, 1] * bend[inner]
    assert np.abs(column[inner] - expected).max() < 1e-3 * np.abs(expected).max()


def test_no_period_of_a_linear_encoder_is_missed(motion):
    """Foreign 805: 20 mm on 0.6 m lay between 30 waves and 27, and a tenth beside it nothing is left of it."""
    q = motion.axis("Y").q
    travel = float(np.ptp(q))
    tried = np.array([travel / e.period for e in found("encoder_error", "Y", motion)])
    for waves in np.linspace(3.0, 0.9 * tried.max(), 50):
        assert np.min(np.abs(tried - waves)) < 0.13


def test_several_encoder_errors_and_ripples_but_one_friction():
    make_effects([{"encoder_error": {"period": 1.0}}, {"encoder_error": {"period": 0.5}}], "A", True, "x")
    with pytest.raises(MachineError, match="listed twice"):
        make_effects(["backlash", "backlash"], "A", True, "x")
