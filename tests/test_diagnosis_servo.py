"""Changes of the servo: known gains of a cascade in closed form, and a virtual machine at its limit."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from pinotwin.diagnosis.law import Law, _common, _scale, broken, changed, law_of, mean_gains
from pinotwin.diagnosis.limits import _plateau
from pinotwin.diagnosis.servo import look_at_servo
from pinotwin.errors import DataError
from pinotwin.logs.prepare import prepare
from pinotwin.loop.controller import Controller
from pinotwin.loop.data import LoopData
from pinotwin.loop.gains import at_limit, gains_in
from pinotwin.machine import Machine
from pinotwin.virtual import VirtualMachine, random_trajectory

LAW = Controller("pid", kp=2e4, integral=1e5, kd=300.0, ffv=20.0, ffa=8.0, step=0.001, rms=0.01)


def channels(ffa: float = 8.0, kp: float = 2e4, noise: float = 0.01):
    """Return command, error and the effort that the law gives, summed up here by hand."""
    rng = np.random.default_rng(4)
    t = np.arange(8000) * LAW.step
    qr = 0.05 * np.sin(2.1 * t) + 0.02 * np.sin(5.7 * t)
    e = 1e-5 * np.sin(9.0 * t) + 2e-6 * np.cumsum(rng.standard_normal(len(t))) / 50.0
    blank = LoopData(step=LAW.step, qr=qr, d=e, outputs=np.stack([e, e], axis=1), axis="X")
    vr, ar = blank.velocity, blank.acceleration
    de = np.diff(e, prepend=2 * e[0] - e[1]) / LAW.step
    u = kp * e + 1e5 * np.cumsum(e) * LAW.step + 300.0 * de + 20.0 * vr + ffa * ar
    u += noise * rng.standard_normal(len(t))
    return LoopData(step=LAW.step, qr=qr, d=e, outputs=np.stack([e, u], axis=1), axis="X")


def test_gains_that_did_not_change_are_found_again():
    found = gains_in(channels(), dataclasses.replace(LAW, velocity_delay=0.0005))
    sigmas = (found.after - found.before) / np.sqrt(np.diag(found.covariance))
    assert np.abs(sigmas).max() < 5.0
    assert found.unexplained[0] == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize(("change", "name"), [({"ffa": 6.0}, "ffa"), ({"kp": 2.4e4}, "kp")])
def test_a_changed_gain_is_found_in_size(change, name):
    found = gains_in(channels(**change), dataclasses.replace(LAW, velocity_delay=0.0005))
    k = found.names.index(name)
    assert found.after[k] == pytest.approx(change[name], rel=0.03)
    assert found.unexplained[0] > 2.0 * found.unexplained[1]


def test_an_effort_rests_at_its_limit_only_where_it_is_flat():
    t = np.arange(4000) * 1e-3
    u = 10.0 * np.sin(3.0 * t)
    assert not at_limit(u, 1e-3, 1e-3)[:300].any()
    clipped = np.clip(u, -7.0, 7.0)
    near = at_limit(clipped, 1e-3, 1e-3)
    assert near[np.abs(u) > 7.1].all()
    assert not near[np.abs(u) < 6.5].any()


def motion(urdf_dir, *inject, seed=3):
    virtual = VirtualMachine.load(urdf_dir / "emps", inject=inject)
    log = virtual.record(random_trajectory(virtual, 6.0, seed), seed=seed).to_log()
    machine = dataclasses.replace(Machine.load("emps"), columns={})
    limit = virtual.truth.axes["X"].controller.effort_limit
    return machine, prepare(machine, log), limit


def test_a_drive_at_its_limit_is_named_and_a_healthy_one_is_not(urdf_dir):
    machine, well, _ = motion(urdf_dir)
    assert look_at_servo(machine, [well], []) == ([], {})
    _, ill, limit = motion(urdf_dir, "saturation:X=0.7")
    ((found,), _) = look_at_servo(machine, [ill], [])
    assert (found.effect, found.axis) == ("saturation", "X")
    assert found.shape["limit"] == pytest.approx(limit, rel=0.05)


def scaled(share: float) -> LoopData:
    """Return channels whose effort is logged at another scale."""
    made = channels()
    e, u = made.outputs.T
    return LoopData(
        step=LAW.step, qr=made.qr, d=e, outputs=np.stack([e, (1.0 + share) * u], axis=1), axis="X"
    )


@pytest.mark.parametrize("share", [-0.012, 0.008])
def test_all_gains_alike_are_a_scale_of_the_effort(share):
    found = gains_in(scaled(share), dataclasses.replace(LAW, velocity_delay=0.0005))
    assert found.common[0] == pytest.approx(share, abs=1e-3)
    assert _common(mean_gains([found])) == pytest.approx(share, abs=1e-3)


def test_one_gain_alone_is_no_scale_and_a_large_scale_the_plant_would_show():
    law = dataclasses.replace(LAW, velocity_delay=0.0005)
    assert _common(mean_gains([gains_in(channels(ffa=6.0), law)])) is None
    assert _common(mean_gains([gains_in(scaled(0.1), law)])) is None


def test_sizes_crowd_at_a_limit_and_nowhere_else():
    rng = np.random.default_rng(0)
    size = np.abs(10.0 * np.sin(np.linspace(0.0, 60.0, 20000)))
    noise = 0.01 * rng.standard_normal(len(size))
    over, spike = _plateau(np.minimum(size, 7.0) + noise, 7.0, 0.01)
    assert over < 1e-3
    assert spike > 5.0
    over, spike = _plateau(size + noise, 7.0, 0.01)
    assert over > 0.3
    assert spike < 2.0


def late(seconds: float) -> LoopData:
    """Return channels whose law acts later by so much."""
    made = channels()
    e, u = made.outputs.T
    t = np.arange(len(u)) * LAW.step
    return LoopData(
        step=LAW.step, qr=made.qr, d=e, axis="X", outputs=np.stack([e, np.interp(t - seconds, t, u)], axis=1)
    )


@pytest.mark.parametrize("seconds", [0.0015, 0.004])
def test_a_law_that_holds_again_with_another_dead_time_is_late(monkeypatch, seconds):
    monkeypatch.setattr("pinotwin.diagnosis.law._channels", lambda data, _: data)
    known = dataclasses.replace(LAW, velocity_delay=0.0005)
    logs = [late(seconds)]
    object.__setattr__(logs[0], "names", ("X",))
    law = law_of(known, logs, logs, 0)
    assert law is not None
    (found,) = changed(law)
    assert (found.effect, found.axis) == ("delay", "X")
    assert found.theta["seconds"] == pytest.approx(seconds, abs=2e-5)
    assert found.shrink["e"].share > 0.95


def test_an_axis_that_rests_in_a_validation_log_is_left_out_not_fatal(monkeypatch):
    def gains(data, controller):
        if data == "still":
            raise DataError("X hardly moves")
        return gains_in(data, controller)

    monkeypatch.setattr("pinotwin.diagnosis.law._channels", lambda data, _: data)
    monkeypatch.setattr("pinotwin.diagnosis.law.gains_in", gains)
    assert law_of(LAW, [channels()], ["still"], 0) is None  # it was an error that ended the diagnosis


@pytest.mark.parametrize(
    ("left", "best", "broken_by"),
    [(1.1, 1.0, None), (2.6, 2.6, None), (2.0, 1.0, 2.0), (6.0, 4.0, 6.0)],
)
def test_a_law_is_broken_where_other_gains_bring_it_back_or_nothing_does(left, best, broken_by):
    """Two and a half times is as much as a law that never held quite leaves of a healthy drive."""
    now = SimpleNamespace(unexplained=(0.01 * left, 0.01 * best))
    law = Law("X", 0, LAW, (), (), now, ())
    assert broken(law) == (None if broken_by is None else pytest.approx(broken_by))


def test_a_speed_that_a_filter_passes_a_little_less_is_no_feed_forward():
    names, before = ("kp", "kd", "ffv"), np.array([1e5, 1e4, 20.0])
    assert _scale(SimpleNamespace(names=names, before=before)).tolist() == [1e5, 1e4, 1e4]
