"""The servo's law: silent where it does not hold on the twin's own logs, and whatever the plant does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.days.limit import bounded
from pinotwin.diagnosis.days.stretch import stretches
from pinotwin.diagnosis.signals.servo import _drives, limits
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.virtual import VirtualMachine, random_trajectory

LAW = {
    "feedforward",
    "acceleration_feedforward",
    "velocity_feedforward",
    "position_gain",
    "loop_gain",
    "integral",
}


def record(urdf_dir, path, seed, *inject, **gains):
    """Return the log of a drive with faults, and with other gains of its controller."""
    virtual = VirtualMachine.load(urdf_dir / "emps", inject=inject)
    axis = virtual.truth.axes["X"]
    axis = dataclasses.replace(axis, controller=dataclasses.replace(axis.controller, **gains))
    virtual = dataclasses.replace(virtual, truth=dataclasses.replace(virtual.truth, axes={"X": axis}))
    return virtual.record(random_trajectory(virtual, 8.0, path), seed=seed).to_log()


@pytest.fixture(scope="module")
def machine():
    return dataclasses.replace(Machine.load("emps"), columns={})


@pytest.fixture(scope="module")
def twin(machine, urdf_dir):
    return identify(machine, [record(urdf_dir, 7, 1), record(urdf_dir, 9, 2)], loop=False)


@pytest.mark.parametrize("dose", [0.2, 0.6, 1.5])
@pytest.mark.parametrize("kind", ["viscous", "coulomb"])
def test_no_dose_of_friction_is_a_fault_of_the_controller(twin, urdf_dir, kind, dose):
    log = record(urdf_dir, 8, 11, f"{kind}:X={dose}")
    assert not {e.effect for e in diagnose(twin, log).effects} & LAW


def foreign_effort(log):
    """Return a log whose effort was commanded by a law that is none of e, its integral and the command."""
    v = np.gradient(log["X.q"], log.t)
    odd = 40.0 * np.sign(v) * np.abs(np.sin(200.0 * log["X.q"])) + 5.0 * np.cos(37.0 * log.t) ** 3
    return Log({**log.channels, "X.u": odd}, source="odd.csv")


def test_a_law_that_does_not_hold_on_the_own_logs_says_nothing(machine, urdf_dir):
    own = identify(machine, foreign_effort(record(urdf_dir, 7, 1)), loop=False)
    log = record(urdf_dir, 8, 11)
    changed = Log({**log.channels, "X.u": 3.0 * log["X.u"]}, source="loud.csv")
    assert not {e.effect for e in diagnose(own, changed).effects} & LAW


def test_a_weak_drive_has_met_its_limit_and_a_command_in_another_unit_has_not(twin, urdf_dir):
    found = diagnose(twin, record(urdf_dir, 8, 11, "saturation:X=0.8"))
    assert [e.effect for e in found.effects] == ["saturation"]
    log = record(urdf_dir, 8, 11)
    millimetres = Log({**log.channels, "X.qr": 1000.0 * log["X.qr"]})
    assert set(compare(twin, [millimetres], []).gate.strays) == {"X"}
    assert list(diagnose(twin, millimetres).effects) == []


def test_an_axis_that_fell_far_off_its_command_has_met_a_limit_and_is_in_no_other_unit(twin, urdf_dir):
    """Foreign 807: a drive too weak for its weight fell by 150 m, "looks like mm", and nothing was said of it."""
    log = record(urdf_dir, 8, 11)
    weak = 0.3 * np.abs(log["X.u"]).max() * (1.0 + 0.01 * np.random.default_rng(0).normal(size=len(log.t)))
    fallen = Log({**log.channels, "X.q": log["X.q"] - 3.0 * log.t**2, "X.u": weak}, source="fallen.csv")
    c = compare(twin, [fallen], [])
    assert not c.gate.nameless
    assert not any("looks like" in text for text in c.gate.warnings)
    assert [e.effect for e in diagnose(twin, fallen).effects] == ["saturation"]
    millimetres = compare(twin, [Log({**log.channels, "X.q": 1000.0 * log["X.q"]})], [])
    assert set(millimetres.gate.nameless) == {"X"}


def test_a_drive_that_is_at_its_limit_whenever_it_moves_has_met_it(twin, urdf_dir):
    """Foreign 895, 902: an axis ran to its stop and stayed there; its effort was "noise" and nothing was named."""
    log = record(urdf_dir, 8, 11)
    rng = np.random.default_rng(0)
    stuck = 0.1 * log["X.q"] + 1e-6 * rng.normal(size=len(log.t))
    pinned = 20.0 * (1.0 + 0.01 * rng.normal(size=len(log.t)))
    said = diagnose(twin, Log({**log.channels, "X.q": stuck, "X.u": pinned}, source="pinned.csv"))
    assert any("stands at 20" in text for text in said.warnings)
    (found,) = said.effects
    assert found.effect == "saturation"
    assert found.size[0].after == pytest.approx(20.0, rel=0.02)


def test_an_effort_that_wanders_while_it_rests_is_at_a_limit_where_the_command_asks_for_others(
    twin, urdf_dir
):
    """An EMPS at its limit for 41 % of a log was passed over: its reading wandered there by more than its noise."""
    m = twin.motion(record(urdf_dir, 8, 11))
    asked = twin.effort(m)[:, 0]
    level = 0.5 * np.abs(asked).max()
    at = np.abs(asked) > level
    rng = np.random.default_rng(0)
    wander = 1.0 + 0.004 * at * np.sin(2.0 * np.pi * 6.0 * m.t) + 5e-4 * rng.normal(size=len(asked))
    behind = 1e-3 * (1.0 + 2.0 * at) * rng.normal(size=len(asked))
    u, qr = m.u.copy(), m.q.copy()
    u[:, 0], qr[:, 0] = np.clip(asked, -level, level) * wander, m.q[:, 0] + behind
    clipped = dataclasses.replace(m, u=u, qr=qr)
    (s,) = stretches(twin, clipped, clipped.u - twin.effort(clipped), 0, ["X"], {})

    def found(asked):
        left = s.taken(clipped.u - asked)[:, 0]
        limits = [x for each in _drives([s], "X", [left]) if (x := bounded(each))]
        return max(limits, key=lambda x: x.gain - x.price, default=None)

    limit = found(twin.effort(clipped))
    assert limit is not None
    assert limit.level == pytest.approx(level, rel=0.01)
    assert found(clipped.u + 0.03 * rng.normal(size=clipped.u.shape)) is None


def test_a_healthy_gain_is_not_accused(data_dir):
    case = data_dir.parent / "cases" / "public" / "healthy_gain_accused"
    if not case.exists():
        pytest.skip("the cases beside the data are not here")
    own = [pt.read(case / f"healthy{k}.parquet") for k in (1, 2)]
    twin = pt.identify(pt.Machine.load(case / "machine"), own)
    found = pt.diagnose(twin, pt.read(case / "log.parquet"))
    assert found.verdict == "none"
    assert list(found.effects) == []


@pytest.mark.parametrize("times", [1.0, 1.1])
def test_a_feed_forward_is_told_by_what_it_closes_beyond_what_the_law_leaves_anyway(twin, urdf_dir, times):
    """What the law leaves of the own logs, no feed-forward closes: of a small change it is a tenth."""
    log = record(urdf_dir, 8, 11)
    a = np.gradient(np.gradient(log["X.qr"], log.t), log.t)
    fed = log["X.u"] + (times - 1.0) * 95.0 * a
    found = diagnose(twin, Log({**log.channels, "X.u": fed}, source="fed.csv"))
    assert bool(found.effects) is (times > 1.0)


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("inject", [(), ("ripple:X=0.3",)], ids=["whole", "ripple"])
def test_what_a_twin_lacks_from_the_start_is_no_change_of_the_machine(machine, urdf_dir, inject, runs):
    own = identify(machine, [record(urdf_dir, 7 + k, 1 + k, *inject) for k in range(runs)], loop=False)
    found = diagnose(own, record(urdf_dir, 12, 11, *inject))
    assert (found.verdict, list(found.effects)) == ("none", [])
    missing = found.to_dict()["missing_since_identification"]
    assert [(x["effect"], x["axis"]) for x in missing] == [("position_table", "X")] * len(inject)
    assert all(0.3 < x["share"] < 1.0 for x in missing)
    assert any("residual of X in the twin's logs repeats with position" in x for x in found.advice) is bool(
        inject
    )


@pytest.mark.parametrize("runs", [1, 2])
def test_a_drive_at_its_limit_is_found_in_one_run_and_in_repeats(machine, urdf_dir, runs):
    """From the end of one log to the beginning of the next a position jumps: no axis is at rest beside that."""
    weak = [record(urdf_dir, 8, 20 + k, "saturation:X=0.5") for k in range(runs)]
    found = limits(compare(machine, weak, []))
    assert [x.axis for x in found] == ["X"]
    assert found[0].confidence > 0.9
    top = np.quantile(np.abs(weak[0]["X.u"]), 0.98)
    assert found[0].size[0].after == pytest.approx(top, rel=0.02)
    assert limits(compare(machine, [record(urdf_dir, 8, 20 + k) for k in range(runs)], [])) == []


def test_an_integrator_that_stops_is_named(twin, urdf_dir):
    """An integrator that stops leaves the plant and the effort as they were, and the tracking error drifts away."""
    log = record(urdf_dir, 8, 11)
    lost = np.where(log.t > 3.0, 1e-4 * (log.t - 3.0), 0.0)
    said = diagnose(twin, Log({**log.channels, "X.qr": log["X.qr"] + lost}, source="lost.csv"))
    assert [(e.effect, e.axis) for e in said.effects] == [("integral", "X")]
    size = said.effects[0].size[0]
    assert size.after / size.before == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("share", [1.0, 0.9])
def test_a_tenth_of_a_feed_forward_is_told_with_its_size(machine, urdf_dir, share):
    own = [record(urdf_dir, path, path, acceleration_feedforward=1.0) for path in (7, 9)]
    log = record(urdf_dir, 8, 11, acceleration_feedforward=share)
    found = diagnose(identify(machine, own, loop=False), log)
    assert [e.effect for e in found.effects] == ["acceleration_feedforward"] * (share < 1.0)
    assert all(e.size[0].after / e.size[0].before == pytest.approx(share, abs=0.01) for e in found.effects)
