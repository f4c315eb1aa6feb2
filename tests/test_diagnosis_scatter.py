"""What differs from run to run, and where a log begins: no cause is named for either."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.diagnosis.data.comparison import _explained, _foretold, _without_lost, compare
from pinotwin.diagnosis.data.samples import sliding
from pinotwin.diagnosis.data.scatter import scatter, scattered
from pinotwin.diagnosis.evidence.repeatable import habit
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.search.forward import search
from pinotwin.effects import EFFECTS
from pinotwin.effects.sight import Sight
from pinotwin.identification import identify
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.test_diagnosis_evidence import lacking, motion
from tests.test_diagnosis_named import record, with_residual


@pytest.fixture(scope="module")
def twin() -> Twin:
    return identify(replace(Machine.load("emps"), columns={}), [record(3), record(5)])


def test_dry_and_viscous_friction_scatter_each_by_itself(twin: Twin) -> None:
    """Foreign 875: an axis that was warmer dragged less and held as ever, as constant forces do."""
    c = compare(twin, [record(4)], [])
    parts = c.rubs[0]
    assert parts.sum(axis=1) == pytest.approx(c.rubbing[0])
    for part in parts.T:
        course = 0.03 * part * c.friction[0] / np.sqrt(np.mean(part**2))
        more = with_residual(c, course)
        assert scatter(more, 0, RULES.scatter) == pytest.approx(0.03 * c.friction[0], rel=1e-6)
        assert scattered(more, 0, RULES.scatter) == pytest.approx(float(course @ course) / c.floor[0] ** 2)
        assert scattered(more, 0, RULES.scatter, np.zeros_like(course)) == 0.0


def test_friction_of_another_form_is_no_scatter_of_it_however_little(twin: Twin) -> None:
    """Own bench 24: friction that goes with the load closed 0.88 of a gap of four misfits, and was called scatter."""
    c = compare(twin, [record(4)], [])
    c = replace(c, floor={0: 0.1 * c.floor[0]})
    noise = c.floor[0] * np.random.default_rng(0).normal(size=len(c.rubbing[0]))
    own = c.floor[0] * np.random.default_rng(1).normal(size=len(c.own.residual[0]))
    c = replace(c, own=replace(c.own, residual={0: own}))
    v = c.new.motion.v[c.new.samples(0), 0]
    turn = np.abs(v) / np.abs(v).max()
    falls = np.sign(v) * (np.exp(-turn / 0.05) - 0.2 * np.exp(-turn))
    stribeck = EFFECTS["stribeck"].on(c.machine, "X")
    candidates = [
        *stribeck.trials(c.new.motion, Sight.of(c.new.motion, "X")),
        EFFECTS["coulomb"].on(c.machine, "X"),
    ]
    for course, named in ((falls, ["stribeck"]), (c.rubbing[0], [])):
        small = 0.03 * c.friction[0] * course / np.sqrt(np.mean(course**2))
        assert [s.chosen.key[0] for s in search(with_residual(c, small + noise), candidates).steps] == named


def test_of_a_habit_most_rows_tell_whether_it_is_in_the_logs_in_question() -> None:
    """EMPS: one push more than outweighed a habit that is a quarter of the misfit, by which it stands out."""
    own = lacking(3, 0.25)
    pushed = (motion().t >= 12.0) & (motion().t < 14.0)
    away = -3.0 * np.sign(np.mean(lacking(0, 0.25).residual[0])) * pushed
    assert habit(lacking(0, 0.25, away), own, 0) is not None


def test_what_moves_before_the_first_command_as_a_log_begins_is_not_asked_about(twin: Twin) -> None:
    """Foreign driller: the weight fell into its spring as the log began, by ten times what a move made of it."""
    m = twin.motion(record(3))
    assert m.vr is not None
    (whole,) = m.segments
    n, first = whole.stop - whole.start, whole.start + round(RULES.starting / m.step)
    middle = whole.start + n // 2
    halves = (slice(whole.start, middle), slice(middle, whole.stop))
    stands = m.vr.copy()
    for s in halves:
        stands[s.start : s.start + n // 8] = 0.0
    swing = np.full_like(m.v, m.v.max())
    one = replace(m, v=swing, vr=stands, segments=halves)
    assert not sliding(one, 0)[whole.start : first].any()
    assert sliding(one, 0)[first:].all()  # nor is the other half a beginning: a gap in a log lies before it
    two = replace(one, t=np.where(np.arange(len(m)) < middle, m.t, m.t - m.t[middle]))
    assert not sliding(two, 0)[middle : middle + first - whole.start].any()
    asked = replace(one, vr=np.where(stands == 0.0, m.vr.max(), stands))
    assert sliding(asked, 0).all()


def test_an_axis_whose_effort_is_measured_too_small_is_judged_where_its_twin_expects_more() -> None:
    """LWR4: a quarter of an axis' effort varies less than its twin's misfit; it was left out as one that rests."""
    virtual = VirtualMachine.load(machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, 6.0, 1), seed=1).to_log()
    twin = identify(Machine.load("trunnion"), log, loop=False)
    weak = replace(log, channels={**log.channels, "A.u": 0.2 * log["A.u"]})
    c = compare(twin, [weak], [])
    j = twin.machine.axes["A"].index
    assert c.new.size(j) < 0.3 * c.new.foretold(j)
    coarse = replace(c, floor={**c.floor, j: 0.5 * c.new.foretold(j)})
    assert j in _without_lost(coarse, []).new.joints
    unsure = replace(c, floor={**c.floor, j: 2.0 * c.new.foretold(j)})
    assert j not in _without_lost(unsure, []).new.joints


def test_play_is_named_where_a_delay_that_it_looks_like_is_certain_and_closes_less() -> None:
    """Foreign 904: play closed a hair less than is asked of it, and the delay that it looks like was named."""
    machine = replace(Machine.load("emps"), columns={})
    c = compare(machine, [record(3, "backlash:X=1.0")], [])
    sight = Sight.of(c.new.motion, "X")
    play, delay = (
        EFFECTS[name].on(machine, "X").trials(c.new.motion, sight) for name in ("backlash", "delay")
    )
    strict = replace(RULES, share_played=1.0)
    for candidates, named in ((play, []), (delay, ["delay"]), ([*play, *delay], ["backlash"])):
        assert [s.chosen.key[0] for s in search(c, candidates, rules=strict).steps] == named


def test_of_an_axis_that_its_twin_hardly_explains_nothing_is_said(twin: Twin) -> None:
    """A mill at 10 Hz: 0.97 of Y's effort was left of its own log, and another log was "viscous"."""
    c = compare(twin, [record(4)], [])
    assert c.own is not None
    assert _explained(c, 0)
    effort = c.own.effort[0] - np.mean(c.own.effort[0])
    assert not _explained(replace(c, own=replace(c.own, residual={0: effort})), 0)


def test_rows_are_judged_where_the_twin_is_about_as_sure_as_on_its_own_logs(twin: Twin) -> None:
    """A motor identified on slow turns: the first jerk of another log was a push."""
    motion = twin.motion(record(4))
    error = twin.effort_error(motion)[:, 0]
    inside = np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])
    typical = float(np.median(error[inside]))
    known = _foretold(twin, motion, {0: 0.0}, {0: typical / RULES.guessed})[inside, 0]
    assert known.mean() == pytest.approx(0.5, abs=0.01)
    assert _foretold(twin, motion, {0: error.max() / RULES.guessed_size}, {0: 0.0})[inside, 0].all()
    assert _foretold(twin, motion, {0: 0.0}, {0: error.max()})[inside, 0].all()
