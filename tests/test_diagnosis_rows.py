"""Which rows judge a cause and which do not: travel that a twin knows, the first command, axes that rest; and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.diagnosis.data.comparison import _foretold, _without_lost, compare, foretells, scatter, within
from pinotwin.diagnosis.data.noise import residual_noise
from pinotwin.diagnosis.data.samples import SKIMMED_ROWS, judged_rows, sample, sliding
from pinotwin.diagnosis.rules import RULES
from pinotwin.effects import EFFECTS, Presliding
from pinotwin.effects.ripple import Ripple
from pinotwin.effects.sensing import Delay
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.one_slide import RATE, SECONDS, motion, rows
from tests.test_diagnosis_named import record, with_residual


@pytest.fixture(scope="module")
def twin() -> Twin:
    return identify(replace(Machine.load("emps"), columns={}), [record(3), record(5)])


@pytest.mark.parametrize(("span", "seconds", "whole"), [(3e-3, 2.9e-3, True), (5e-3, 2.5e-3, False)])
def test_a_delay_moves_all_of_the_effort(span: float, seconds: float, whole: bool) -> None:
    assert Delay("X", span=span).possible(np.array([seconds])) == whole
    assert Delay("X", span=1e-3).possible(np.array([seconds]))


def test_the_rows_that_are_skimmed_are_rows_of_the_sample() -> None:
    """Of an effect without states, and of one that has to be followed on finer rows."""
    s = rows(np.zeros(int(RATE * SECONDS)))
    coarse = sample(replace(s.motion, decimation=3), np.zeros((len(s.motion), 1)))
    for effect in (Ripple("X", period=0.3), Presliding("X")):
        few, at = coarse.skimmed(effect, s)
        assert len(at[0]) <= SKIMMED_ROWS
        whole = effect.columns(s.motion).values[coarse.rows.sample, 0, :]
        assert few[0] == pytest.approx(whole[at[0]], abs=1e-12)


def test_validation_rows_beyond_the_travel_of_the_logs_judge_nothing() -> None:
    zero, wide = np.zeros(int(RATE * SECONDS)), motion(3)
    new, unseen = rows(zero), sample(replace(wide, q=1.5 * wide.q), zero[:, None])
    q = unseen.motion.q[unseen.samples(0), 0]
    low, high = (f(new.motion.q[new.samples(0), 0]) for f in (np.min, np.max))
    kept = within(unseen, new)
    left = kept.motion.q[kept.samples(0), 0]
    assert len(left) == len(kept.residual[0])
    assert np.count_nonzero((q >= low) & (q <= high)) <= len(left) < len(q)
    assert left.min() > low - 0.05
    assert left.max() < high + 0.05


def test_noise_is_what_two_runs_of_one_command_do_not_leave_alike() -> None:
    m = motion()
    alike, slow = 3.0 * np.sin(2.0 * m.q), np.sqrt(2.0) * np.sin(5.0 * m.t)[:, None]
    both = Motion.join([m, m])
    left = np.concatenate([alike + slow, alike - slow])
    new = sample(both, left)
    assert residual_noise(new, left, [m, m])[0] == pytest.approx(np.sqrt(2.0), rel=0.02)
    assert residual_noise(new, left, [m, motion(3)]) == {}  # two other motions: what is noise is not known


def test_dry_and_viscous_friction_scatter_each_by_itself(twin: Twin) -> None:
    """Foreign 875: an axis that was warmer dragged less and held as ever, as constant forces do."""
    c = compare(twin, [record(4)], [])
    size = 0.03 * rms(c.rubs[0].sum(axis=1))
    for part in c.rubs[0].T:
        course = part * size / np.sqrt(np.mean(part**2))
        more = with_residual(c, course)
        assert scatter(more, 0, RULES.scatter) == pytest.approx(size, rel=1e-6)


def test_an_axis_that_trembles_while_its_command_stands_has_no_rows(twin: Twin) -> None:
    m = compare(twin, [record(4)], []).new.motion
    assert m.vr is not None
    still = np.zeros(len(m.t), dtype=bool)
    still[len(still) // 2 : len(still) // 2 + 800] = True
    v, vr = m.v.copy(), m.vr.copy()
    v[still], vr[still] = 0.03 * np.abs(v).max(), 0.0
    use = m.use | still[:, None]
    shaken = replace(m, v=v, vr=vr, use=use)
    rows = sample(shaken, np.zeros_like(m.u)).samples(0)
    settled = still.copy()
    settled[: len(still) // 2 + round((RULES.settles + 0.01) / m.step)] = False
    assert settled.any()
    assert not settled[rows].any()
    moved = replace(shaken, vr=np.where(still[:, None], v, vr))
    assert settled[sample(moved, np.zeros_like(m.u)).samples(0)].any()


def test_before_the_first_move_of_a_log_an_axis_is_at_rest(twin: Twin) -> None:
    """Rows that begin a log count as long as its command stands: nothing settles that has not moved."""
    m = compare(twin, [record(4)], []).new.motion
    assert m.vr is not None
    first = int(np.flatnonzero(np.abs(m.vr[:, 0]) > 0.01 * np.abs(m.vr).max())[0])
    late = replace(m, use=np.ones_like(m.use))
    assert first * m.step > 0.1
    assert not sliding(late, 0)[: first - round(0.02 / m.step)].any()
    u = m.u.copy()
    u[: first // 2] += 50.0
    held, plain = (judged_rows(replace(late, u=x), 0) for x in (u, m.u))
    assert np.array_equal(held, plain)
    assert not held[: first // 2].any()


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


def test_of_an_axis_that_its_twin_hardly_explains_nothing_is_said(twin: Twin) -> None:
    """A mill at 10 Hz: 0.97 of Y's effort was left of its own log, and another log was "viscous"."""
    c = compare(twin, [record(4)], [])
    assert c.own is not None
    assert foretells(c, 0)
    effort = c.own.effort[0] - np.mean(c.own.effort[0])
    assert not foretells(replace(c, own=replace(c.own, residual={0: effort})), 0)


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


def with_effect(name: str) -> tuple[Twin, Log, Log]:
    """Return the twin of an EMPS that lists one effect more, its log of 5 s, and one that goes farther."""
    virtual = VirtualMachine.load(machines()["emps"])
    machine = Machine.load("emps")
    axis = machine.axes["X"]
    more = EFFECTS[name].on(machine, "X")
    machine = replace(machine, axes={"X": replace(axis, effects=(*axis.effects, more))})
    short, wide = (virtual.record(random_trajectory(virtual, 5.0, s), seed=s).to_log() for s in (3, 4))
    return identify(machine, short, loop=False), short, wide


def test_rows_are_left_out_for_a_table_alone_whatever_else_is_unsure() -> None:
    """A Stribeck term of which a log tells little makes the whole effort unsure, everywhere; its rows are judged."""
    twin, _, other = with_effect("stribeck")
    unsure = replace(twin, covariance=1e6 * twin.covariance)
    c = compare(unsure, [other], [])
    assert len(c.new.samples(0)) == len(compare(twin, [other], []).new.samples(0))
    assert not [d for d in c.gate.doubts if "outside the twin" in d]


def test_where_the_twin_has_never_been_its_table_is_a_guess_and_no_change() -> None:
    twin, short, wide = with_effect("position_table")
    low, high = short["X.q"].min(), short["X.q"].max()
    assert wide["X.q"].max() > high + 0.05  # goes where the twin has never been
    c = compare(twin, [wide], [])
    judged_at = c.new.motion.q[c.new.samples(0), 0]
    assert low - 2e-3 <= judged_at.min()
    assert judged_at.max() <= high + 2e-3
    assert [d for d in c.gate.doubts if "outside the twin" in d]
    again = compare(twin, [short], [])
    assert not [d for d in again.gate.doubts if "outside the twin" in d]
