"""The evidence: held-out gains, differences of differences, pushes, the servo's law, bodies; closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.diagnosis.candidates.episodes import Episodes, episodes
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.data.noise import residual_noise
from pinotwin.diagnosis.data.samples import Sample, sample
from pinotwin.diagnosis.evidence.bodies import body_of, body_sizes
from pinotwin.diagnosis.evidence.bootstrap import share_interval
from pinotwin.diagnosis.evidence.held_out import FREE, HELD, Ground, Judged, judged
from pinotwin.diagnosis.evidence.moments import base_of, products
from pinotwin.diagnosis.evidence.repeatable import habit
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.search.forward import Found
from pinotwin.diagnosis.search.pushes import pushes
from pinotwin.diagnosis.search.scan import Searcher
from pinotwin.effects import EFFECTS
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.motion import Motion
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.one_slide import motion, rows


def ground(new: Sample, own: Sample | None = None, base: np.ndarray | None = None) -> Ground:
    floor = {0: 1.0}
    width = 0 if base is None else base.shape[1]
    table = {} if base is None else {0: base}
    own_base = None if own is None else base_of(own, {}, floor, 0)
    free = np.zeros(width, dtype=bool)
    return Ground(base_of(new, table, floor, width), own_base, None, 1e-9 * np.ones(width), free)


def test_noise_is_what_two_runs_of_one_command_do_not_leave_alike() -> None:
    m = motion()
    alike, slow = 3.0 * np.sin(2.0 * m.q), np.sqrt(2.0) * np.sin(5.0 * m.t)[:, None]
    both = Motion.join([m, m])
    left = np.concatenate([alike + slow, alike - slow])
    new = sample(both, left, RULES.block_time)
    assert residual_noise(new, left, [m, m])[0] == pytest.approx(np.sqrt(2.0), rel=0.02)
    assert residual_noise(new, left, [m, motion(3)]) == {}  # two other motions: what is noise is not known


def at_bounds(new: Sample, base: np.ndarray, bound: list[bool]) -> Ground:
    """Return the ground of a model some of whose coefficients rest on a lower bound, at which they are kept."""
    free = ground(new, base=base)
    size = np.einsum("kjbb->b", free.new.XX)
    return replace(free, precision=np.where(bound, HELD, FREE) * size, bound=np.array(bound))


def test_a_coefficient_and_what_it_leaves_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    m = motion()
    noise = 0.1 * rng.normal(size=len(m))
    new = rows(2.0 * m.v[:, 0] + noise)
    g = ground(new)
    found = judged(g, products(g.new, {0: new.picked(m.v[:, :1], 0)}), None, None)
    v = new.picked(m.v[:, :1], 0)[:, 0]
    expected = v @ new.residual[0] / (v @ v)
    assert found.theta[0] == pytest.approx(expected, rel=1e-5)
    assert found.left.sum() == pytest.approx(np.sum(noise**2), rel=0.05)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.1 / np.sqrt(np.sum(v**2)), rel=0.1)


def test_what_the_twin_always_lacked_is_no_change() -> None:
    m, other = motion(), motion(3)
    rng = np.random.default_rng(2)
    lacked = 5.0
    new = rows(lacked * m.v[:, 0] + 0.1 * rng.normal(size=len(m)))
    own = rows(lacked * other.v[:, 0] + 0.1 * rng.normal(size=len(m)), 3)
    g = ground(new, own)
    columns = [
        products(b, {0: s.picked(x.v[:, :1], 0)}) for b, s, x in ((g.new, new, m), (g.own, own, other))
    ]
    found = judged(g, columns[0], columns[1], None)
    assert abs(found.theta[0]) < 0.05
    assert found.strength < RULES.strength_change
    alone = judged(ground(new), columns[0], None, None)
    assert alone.theta[0] == pytest.approx(lacked, rel=0.01)


def test_a_candidate_that_the_model_holds_already_is_not_determined() -> None:
    m = motion()
    new = rows(m.v[:, 0])
    v = new.picked(m.v[:, :1], 0)
    g = ground(new, base=v)
    assert not judged(g, products(g.new, {0: v}), None, None).determined
    assert judged(g, products(g.new, {0: new.picked(m.a[:, :1], 0)}), None, None).determined


@pytest.mark.parametrize(("start", "length"), [(5.0, 0.3), (12.0, 4.0)])
def test_a_push_of_any_length_is_found_with_its_time_and_force(start: float, length: float) -> None:
    m = motion()
    rng = np.random.default_rng(4)
    inside = (m.t >= start) & (m.t < start + length)
    r = rng.normal(size=len(m)) + 4.0 * inside
    new, own = rows(r), rows(rng.normal(size=len(m)), 3)
    found = episodes(new, new.residual, own.residual, own, {0: 1.0}, 0)
    assert found is not None
    (push,) = found.episodes
    assert push.start == pytest.approx(start, abs=0.05)
    assert push.end == pytest.approx(start + length, abs=0.05)
    assert push.force == pytest.approx(-4.0, abs=4.0 * push.error + 0.3)


def test_a_strong_part_of_a_push_is_counted_once() -> None:
    """Foreign 809: the parts of a half sine, each with the mean of all that lies in it, came to twice the push."""
    m, rng = motion(), np.random.default_rng(4)
    pushed = 60.0 * np.clip(np.sin(np.pi * (m.t - 5.0) / 0.3), 0.0, None) * ((m.t > 5.0) & (m.t < 5.3))
    new, own = rows(pushed + rng.normal(size=len(m))), rows(rng.normal(size=len(m)), 3)
    found = episodes(new, new.residual, own.residual, own, {0: 1.0}, 0)
    assert found is not None
    assert len(found.episodes) > 1
    assert np.sum((new.residual[0] - found.course) ** 2) < 0.1 * np.sum(new.residual[0] ** 2)


def test_noise_alone_holds_no_push() -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        new, own = rows(rng.normal(size=3000)), rows(rng.normal(size=3000), 3)
        assert episodes(new, new.residual, own.residual, own, {0: 1.0}, 0) is None


def test_faint_pushes_count_beside_another_and_one_alone_does_not() -> None:
    m, rng = motion(), np.random.default_rng(4)
    noise = rng.normal(size=len(m))
    own = rows(rng.normal(size=len(m)), 3)
    faint, other = ((m.t >= a) & (m.t < a + 2.0) for a in (20.0, 5.0))
    for course, count in (
        (0.55 * faint, 0),
        (0.55 * faint + 2.0 * other, 2),
        (0.55 * faint - 0.7 * other, 2),
    ):
        new = rows(noise + course)
        found = episodes(new, new.residual, own.residual, own, {0: 1.0}, 0)
        assert (0 if found is None else len(found.episodes)) == count


def lacking(seed: int, size: float, course: np.ndarray | float = 0.0) -> Sample:
    """Rows of a twin that lacks a curve over the position."""
    m = motion(seed)
    return rows(
        size * np.sin(2.0 * m.q[:, 0]) + 0.2 * np.random.default_rng(seed).normal(size=len(m)) + course, seed
    )


def test_what_a_twin_leaves_whenever_it_moves_so_is_its_habit() -> None:
    new, own = lacking(0, 1.0), lacking(3, 1.0)
    known = habit(new, own, 0)
    assert known is not None
    assert known.left == pytest.approx(0.2 / own.level(0), rel=0.1)
    assert np.std(known.new) == pytest.approx(0.2, rel=0.1)
    assert habit(lacking(0, 0.0), lacking(3, 0.0), 0) is None  # noise is none
    assert habit(lacking(0, -1.0), own, 0) is None  # nor is what the logs in question do not show


def test_a_push_below_the_habit_is_found_without_it_and_a_habit_is_no_push() -> None:
    pushed = (motion().t >= 12.0) & (motion().t < 14.0)
    own = lacking(3, 1.0)
    for course, found in ((0.9 * pushed, True), (0.0, False)):
        new = lacking(0, 1.0, course)
        known = habit(new, own, 0)
        assert known is not None
        assert episodes(new, new.residual, own.residual, own, {0: 1.0}, 0) is None
        assert (episodes(new, {0: known.new}, {0: known.own}, own, {0: 1.0}, 0) is not None) == found


def test_intervals_of_a_share_cover_it() -> None:
    inside, true = 0, 0.5
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before = rng.exponential(size=40)
        after = true * before * rng.uniform(0.6, 1.4, size=40)
        low, high = share_interval(before, after, seed)
        inside += low <= 1.0 - true <= high
    assert 0.80 <= inside / 200 <= 0.98


def test_a_body_has_mass_and_centre_with_intervals() -> None:
    pi = np.array([2.0, 0.2, 0.0, -0.1, *np.zeros(6)])
    covariance = np.diag(np.array([0.01, 0.002, 0.002, 0.002, *np.ones(6)]) ** 2)
    body = body_of(pi, covariance)
    assert body.centre == pytest.approx([0.1, 0.0, -0.05])
    assert body.centre_error[0] == pytest.approx(np.hypot(0.002, 0.01 * 0.1) / 2.0)
    mass, *_ = body_sizes(body, pi, covariance)
    assert mass.interval == pytest.approx((2.0 - 0.01645, 2.0 + 0.01645))
    taken = body_of(-pi, covariance)
    assert taken.mass == -2.0
    assert taken.centre == pytest.approx([0.1, 0.0, -0.05])


def test_numbers_that_outnumber_the_blocks_are_not_certain_for_that() -> None:
    rng = np.random.default_rng(5)
    blocks, p = 8, 12
    theta = rng.normal(size=p)
    folds = theta + rng.normal(size=(blocks, p)) / np.sqrt(blocks)  # each moved by as much as it is large
    nothing = np.zeros(0)
    found = Judged(theta, folds, np.zeros((p, p)), nothing, nothing, True, nothing, nothing)
    assert found.strength < 2.0
    few = Judged(theta[:2], folds[:, :2], np.zeros((2, 2)), nothing, nothing, True, nothing, nothing)
    assert few.strength == pytest.approx(theta[:2] @ np.linalg.solve(few.covariance, theta[:2]) / 2.0)


def test_a_coefficient_leaves_its_lower_bound_beside_the_cause_for_want_of_which_it_fell_there() -> None:
    """An axis with drag and Coulomb friction, whose model has viscous friction in place of both."""
    m = motion()
    v = m.v[:, 0]
    drag, viscous, coulomb = v * np.abs(v), v, np.sign(v)
    new = rows(9.0 * drag + 0.5 * coulomb)
    base = new.picked(np.stack([viscous, coulomb], axis=-1), 0)
    g = at_bounds(new, base, [False, True])
    assert abs(g.alone.base[1]) < 1e-5
    found = judged(g, products(g.new, {0: new.picked(drag[:, None], 0)}), None, None)
    assert found.theta == pytest.approx([9.0], rel=1e-4)
    assert found.base == pytest.approx([0.0, 0.5], abs=1e-3)
    assert found.left.sum() < 1e-6 * g.alone.left.sum()


def test_a_coefficient_that_would_fall_below_its_bound_stays_there() -> None:
    m = motion()
    v = m.v[:, 0]
    drag, viscous, coulomb = v * np.abs(v), v, np.sign(v)
    new = rows(9.0 * drag - 0.5 * coulomb)
    base = new.picked(np.stack([viscous, coulomb], axis=-1), 0)
    g = at_bounds(new, base, [False, True])
    found = judged(g, products(g.new, {0: new.picked(drag[:, None], 0)}), None, None)
    assert abs(found.base[1]) < 1e-5
    freed = ground(new, base=base)
    below = judged(freed, products(freed.new, {0: new.picked(drag[:, None], 0)}), None, None)
    assert below.base[1] == pytest.approx(-0.5, abs=1e-3)


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


@pytest.fixture(scope="module")
def emps() -> Comparison:
    """A log of the virtual EMPS without its command, beside its twin of another; rows at rest count."""
    virtual = VirtualMachine.load(machines()["emps"])
    logs = [virtual.record(random_trajectory(virtual, 8.0, s), seed=s).to_log() for s in (3, 4)]
    logs = [log.with_channels({k: x for k, x in log.channels.items() if k != "X.qr"}) for log in logs]
    machine = Machine.load("emps")
    laws = tuple(EFFECTS[x].on(machine, "X") for x in ("viscous", "presliding"))
    machine = replace(machine, columns={}, axes={"X": replace(machine.axes["X"], effects=laws)})
    return compare(identify(machine, logs[0], loop=False), [logs[1]], [])


def pushes_in(c: Comparison, more: np.ndarray) -> list[Episodes]:
    left = replace(c, new=replace(c.new, residual={0: c.new.residual[0] + more}))
    ground = Searcher(left)
    return pushes(left, Found((), None, (), ground, ground), RULES)


@pytest.mark.parametrize("stands", [True, False])
def test_a_push_is_named_while_the_axis_moves_and_what_friction_may_hold_at_rest_is_none(
    emps, stands: bool
) -> None:
    at, v = emps.new.samples(0), np.abs(emps.new.motion.v[:, 0])
    still = v[at] < 0.01 * v.max()
    rows = np.flatnonzero(still if stands else ~still)
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    longest = max(runs, key=len)[:100]
    assert len(longest) > 20
    more = np.zeros(len(at))
    more[longest] = 15.0 * emps.floor[0]
    assert bool(pushes_in(emps, more)) is not stands


def as_two_runs(c: Comparison, by: float) -> Comparison:
    """The same log as two, of a twin that leaves less of these and of its own."""
    assert c.own is not None
    (whole,), half = c.new.motion.segments, len(c.new.motion) // 2
    halves = (slice(whole.start, half), slice(half, whole.stop))
    new = replace(c.new, motion=replace(c.new.motion, segments=halves))
    new, own = (replace(s, residual={0: by * s.residual[0]}) for s in (new, c.own))
    return replace(c, new=new, own=own, floor={0: by * c.floor[0]})


@pytest.mark.parametrize(("scale", "named"), [(0.048, False), (0.15, True)])
def test_friction_that_differs_from_run_to_run_is_no_push(emps, scale: float, named: bool) -> None:
    c = as_two_runs(emps, 0.3)
    second = c.new.samples(0) >= c.new.motion.segments[1].start
    course = scale * c.rubbing[0] * second
    assert np.std(course[second]) > 2.0 * c.floor[0]  # far beyond what the twin leaves
    assert bool(pushes_in(c, course)) is named
