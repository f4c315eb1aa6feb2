"""The servo's law: silent where it does not hold on the twin's own logs, and whatever the plant does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.signals.limits import reached
from pinotwin.diagnosis.signals.retuned import retuned
from pinotwin.diagnosis.signals.servo import Law, ServoChange, broken_laws, servo_changes, turned
from pinotwin.diagnosis.signals.tracking import track, with_gains
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.signals import rms
from pinotwin.virtual import VirtualMachine, random_trajectory


def record(urdf_dir, path, seed, *inject):
    virtual = VirtualMachine.load(urdf_dir / "emps", inject=inject)
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
    assert servo_changes(compare(twin, [log], []), ()) == []


def foreign_effort(log):
    """Return a log whose effort was commanded by a law that is none of e, its integral and the command."""
    v = np.gradient(log["X.q"], log.t)
    odd = 40.0 * np.sign(v) * np.abs(np.sin(200.0 * log["X.q"])) + 5.0 * np.cos(37.0 * log.t) ** 3
    return Log({**log.channels, "X.u": odd}, source="odd.csv")


def test_a_law_that_does_not_hold_on_the_own_logs_says_nothing(machine, urdf_dir):
    own = identify(machine, foreign_effort(record(urdf_dir, 7, 1)), loop=False)
    log = record(urdf_dir, 8, 11)
    changed = Log({**log.channels, "X.u": 3.0 * log["X.u"]}, source="loud.csv")
    assert servo_changes(compare(own, [changed], []), ()) == []


def test_the_same_change_is_found_where_the_law_holds(twin, urdf_dir):
    """The two tests above must not pass because nothing is ever found."""
    log = record(urdf_dir, 8, 11)
    a = np.gradient(np.gradient(log["X.qr"], log.t), log.t)
    more = Log({**log.channels, "X.u": log["X.u"] + 60.0 * a}, source="fed.csv")
    found = servo_changes(compare(twin, [more], []), ())
    assert [x.effect for x in found] == ["feedforward"]


def test_what_a_named_cause_puts_into_the_reading_is_no_change_of_the_law(twin, urdf_dir):
    log = record(urdf_dir, 8, 11)
    a = np.gradient(np.gradient(log["X.qr"], log.t), log.t)
    c = compare(twin, [Log({**log.channels, "X.u": log["X.u"] + 60.0 * a}, source="fed.csv")], [])
    assert c.new.motion.ar is not None
    assert servo_changes(c, (), courses={0: 60.0 * c.new.motion.ar[:, 0]}) == []
    assert servo_changes(c, (), courses={0: -60.0 * c.new.motion.ar[:, 0]}) != []


def test_an_axis_that_cannot_follow_has_met_a_limit_and_a_command_in_another_unit_has_not(twin, urdf_dir):
    log = record(urdf_dir, 8, 11)
    weak = 0.4 * np.abs(log["X.u"]).max()
    left_behind = Log({**log.channels, "X.qr": 3.0 * log["X.qr"], "X.u": np.clip(log["X.u"], -weak, weak)})
    c = compare(twin, [left_behind], [])
    assert set(c.gate.strays) == {"X"}
    assert [x.effect for x in servo_changes(c, ())] == ["saturation"]
    millimetres = compare(twin, [Log({**log.channels, "X.qr": 1000.0 * log["X.qr"]})], [])
    assert set(millimetres.gate.strays) == {"X"}
    assert servo_changes(millimetres, ()) == []


def test_an_axis_that_fell_far_off_its_command_has_met_a_limit_and_is_in_no_other_unit(twin, urdf_dir):
    """Foreign 807: a drive too weak for its weight fell by 150 m, "looks like mm", and nothing was said of it."""
    log = record(urdf_dir, 8, 11)
    weak = 0.3 * np.abs(log["X.u"]).max() * (1.0 + 0.01 * np.random.default_rng(0).normal(size=len(log.t)))
    fallen = Log({**log.channels, "X.q": log["X.q"] - 3.0 * log.t**2, "X.u": weak}, source="fallen.csv")
    c = compare(twin, [fallen], [])
    assert not c.gate.nameless
    assert not any("looks like" in text for text in c.gate.warnings)
    assert [x.effect for x in servo_changes(c, ())] == ["saturation"]
    millimetres = compare(twin, [Log({**log.channels, "X.q": 1000.0 * log["X.q"]})], [])
    assert set(millimetres.gate.nameless) == {"X"}


def test_a_drive_that_is_at_its_limit_whenever_it_moves_has_met_it(twin, urdf_dir):
    """Foreign 895, 902: an axis ran to its stop and stayed there; its effort was "noise" and nothing was named."""
    log = record(urdf_dir, 8, 11)
    rng = np.random.default_rng(0)
    stuck = 0.1 * log["X.q"] + 1e-6 * rng.normal(size=len(log.t))
    pinned = 20.0 * (1.0 + 0.01 * rng.normal(size=len(log.t)))
    c = compare(twin, [Log({**log.channels, "X.q": stuck, "X.u": pinned}, source="pinned.csv")], [])
    assert "X" not in c.gate.silent
    assert any("stands at 20" in text for text in c.gate.warnings)
    (found,) = servo_changes(c, ())
    assert found.effect == "saturation"
    assert found.after == pytest.approx(20.0, rel=0.02)
    assert found.confidence > RULES.named


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
    found = reached([clipped], 0, asked=lambda part: twin.effort(part)[:, 0])
    assert found is not None
    assert found.level == pytest.approx(level, rel=0.01)
    assert reached([clipped], 0) is None
    assert reached([clipped], 0, asked=lambda part: part.u[:, 0]) is None


def test_a_gain_that_is_a_hundredth_off_was_not_turned(twin, urdf_dir):
    """Foreign 970: pushes left "feedback gains 1.011 of what they were", with 96 %."""
    log = record(urdf_dir, 8, 11)
    a = np.gradient(np.gradient(log["X.qr"], log.t), log.t)
    c = compare(twin, [Log({**log.channels, "X.u": log["X.u"] + 60.0 * a}, source="fed.csv")], [])
    (found,) = servo_changes(c, ())
    off = abs(found.after - 1.0)
    assert servo_changes(c, (), rules=dataclasses.replace(RULES, law_turned=1.1 * off)) == []
    assert servo_changes(c, (), rules=dataclasses.replace(RULES, law_turned=0.9 * off)) != []


@pytest.mark.parametrize(
    ("effect", "factor", "error", "known", "named"),
    [
        ("loop_gain", 1.007, 0.0003, 0.0, False),  # sure, and not worth a word
        ("loop_gain", 1.064, 0.054, 0.0, False),  # its interval holds 1
        ("loop_gain", 1.064, 0.001, 0.05, False),  # no better known before
        ("loop_gain", 1.064, 0.001, 0.001, True),
        ("loop_gain", 0.5, 0.1, 0.1, True),
        ("loop_gain", -0.4, 0.01, 0.0, False),  # no loop stands with it
        ("feedforward", -0.4, 0.01, 0.0, True),
        ("feedforward", 0.97, 0.001, 0.0, False),
        ("loop_gain", float("nan"), 0.01, 0.0, False),
    ],
)
def test_a_gain_is_named_by_one_rule(effect, factor, error, known, named):
    interval = turned(effect, factor, error, known, RULES)
    assert (interval is not None) == named
    if interval is not None:
        assert not interval[0] <= 1.0 <= interval[1]
        assert interval[0] < factor < interval[1]


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
    found = servo_changes(compare(twin, [Log({**log.channels, "X.u": fed}, source="fed.csv")], []), ())
    assert [x.effect for x in found] == ([] if times == 1.0 else ["feedforward"])


def noisy(log, seed, times=1.0, ahead=0.0):
    """Return a log with 15 % of noise in its effort, all of the effort `times` as large, and more feed-forward."""
    a = np.gradient(np.gradient(log["X.qr"], log.t), log.t)
    noise = 0.15 * np.std(log["X.u"]) * np.random.default_rng(seed).normal(size=len(a))
    return Log({**log.channels, "X.u": times * log["X.u"] + ahead * 95.0 * a + noise}, source="noisy.csv")


@pytest.mark.parametrize(
    ("times", "ahead", "named"), [(1.0, 0.0, []), (1.0, 0.1, ["feedforward"]), (1.06, 0.0, [])]
)
def test_gains_that_alone_close_what_noise_nearly_hides_have_changed(machine, urdf_dir, times, ahead, named):
    """The law leaves less than two and a half times the noise; a common factor on all gains goes along with a load."""
    own = [noisy(record(urdf_dir, 7, 1), 1), noisy(record(urdf_dir, 9, 2), 2)]
    twin = identify(machine, own, loop=False)
    c = compare(twin, [noisy(record(urdf_dir, 8, 11), 3, times, ahead)], [])
    old, new = (Law.of(x.motion, 0) for x in (c.own, c.new))
    gains, rest = old.fitted()
    assert rms(new.left(gains)) < RULES.law_worse * rms(rest)
    assert [x.effect for x in servo_changes(c, ())] == named


def test_the_tracking_error_is_simulated_with_the_gains_as_they_are_now(machine, urdf_dir):
    twin = identify(machine, [record(urdf_dir, 7, 1), record(urdf_dir, 9, 2)])
    softer = ServoChange(
        "loop_gain", "X", "feedback gains", 1.0, 0.7, (0.6, 0.8), "of what it was", 0.9, (9.0, 1.0)
    )
    other = twin.servos["X"].scaled(e=0.7, integral=0.7, v=0.7, vr=0.7, slip=0.7)
    log = record(urdf_dir, 8, 11)
    said = dataclasses.replace(twin, servos={"X": other}).simulate(log)
    follows = {"t": said.t, "X.qr": said["X.q"] + said["X.e"], "X.q": said["X.q"], "X.u": said["X.u"]}
    c = compare(twin, [Log(follows, source="softer.csv")], [])
    tracked = track(c, [], [softer])
    assert tracked.shrinks["X"].share > 0.99
    assert tracked.gaps["X"].after < 0.1 * tracked.gaps["X"].rms
    assert track(c, []).shrinks == {}
    by_transfer = dataclasses.replace(twin, quality={**twin.quality, "simulation": {"use": "black"}})
    assert with_gains(by_transfer, [softer]) == (by_transfer, set())


@pytest.mark.parametrize(
    ("effect", "gains"),
    [
        ("feedforward", {"ar": 0.5}),
        ("loop_gain", dict.fromkeys(("e", "integral", "v", "vr", "slip"), 0.7)),
        ("", {}),
    ],
)
def test_gains_that_noise_hides_in_the_effort_are_told_from_the_tracking_error(
    machine, urdf_dir, effect, gains
):
    twin = identify(machine, [noisy(record(urdf_dir, 7, 1), 1), noisy(record(urdf_dir, 9, 2), 2)])
    other = dataclasses.replace(twin, servos={"X": twin.servos["X"].scaled(**gains)})
    said = other.simulate(record(urdf_dir, 8, 11))
    effort = said["X.u"] + 0.15 * np.std(said["X.u"]) * np.random.default_rng(4).normal(size=len(said.t))
    log = Log(
        {"t": said.t, "X.qr": said["X.q"] + said["X.e"], "X.q": said["X.q"], "X.u": effort},
        source="later.csv",
    )
    found = retuned(compare(twin, [log], []), ["X"])
    assert [x.effect for x in found] == [effect] * bool(effect)
    if found:
        factor = next(iter(gains.values()))
        assert found[0].after == pytest.approx(factor, abs=0.02)
        assert found[0].interval[0] <= factor + 0.005
        assert found[0].interval[1] >= factor - 0.005
        assert found[0].confidence > 0.9


@pytest.mark.parametrize("runs", [1, 2])
def test_a_drive_at_its_limit_is_found_in_one_run_and_in_repeats(machine, urdf_dir, runs):
    """From the end of one log to the beginning of the next a position jumps: no axis is at rest beside that."""
    weak = [record(urdf_dir, 8, 20 + k, "saturation:X=0.5") for k in range(runs)]
    found = servo_changes(compare(machine, weak, []), ())
    assert [x.effect for x in found] == ["saturation"]
    assert found[0].confidence > 0.9
    top = np.quantile(np.abs(weak[0]["X.u"]), 0.98)
    assert found[0].after == pytest.approx(top, rel=0.02)
    assert servo_changes(compare(machine, [record(urdf_dir, 8, 20 + k) for k in range(runs)], []), ()) == []


def test_a_controller_whose_law_is_gone_is_spoken_of_and_named_nothing(twin, urdf_dir):
    """An integrator that stops leaves the plant and the effort as they were, and the tracking error drifts away."""
    log = record(urdf_dir, 8, 11)
    lost = np.where(log.t > 3.0, 1e-4 * (log.t - 3.0), 0.0)
    c = compare(twin, [Log({**log.channels, "X.qr": log["X.qr"] + lost}, source="lost.csv")], [])
    assert servo_changes(c, ()) == []
    assert set(broken_laws(c, ())) == {"X"}
    assert broken_laws(c, {"X"}) == {}
    assert broken_laws(compare(twin, [log], []), ()) == {}
    said = diagnose(twin, Log({**log.channels, "X.qr": log["X.qr"] + lost}, source="lost.csv"))
    assert (said.verdict, said.effects) == ("unexplained", [])
    assert "X has another control law" in said.sentence
    assert said.unexplained["X"] == {"e": 1.0}
