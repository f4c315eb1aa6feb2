"""What a cause is said to close, how large it is, when an axis was pushed, and what these logs do not tell apart."""

from __future__ import annotations

import numpy as np
import pytest

from pinotwin.diagnosis import Diagnosis, diagnose
from pinotwin.diagnosis.conclusion.explained import share_interval
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.days.account import Account, alike, sizes_of
from pinotwin.diagnosis.days.ground import Ground
from pinotwin.diagnosis.days.lack import judged
from pinotwin.diagnosis.days.structure import beside, lacking
from pinotwin.effects import EFFECTS
from pinotwin.machine import Machine
from pinotwin.signals import rms
from tests.slide_logs import OTHER, Extra, bristle, listing, log


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return listing(tmp_path_factory.mktemp("machine") / "slide")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return listing(tmp_path_factory.mktemp("machine") / "slide", "viscous", "coulomb")


def drag(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    del t, q
    return 120.0 * v * np.abs(v)


def wave(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    del t, v
    return 9.0 * np.cos(2.0 * np.pi * q / 0.11)


def none(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    del q, v
    return np.zeros_like(t)


def compared(machine: Machine, extra: Extra, noise: float) -> Comparison:
    """Return the logs of a slide without a ripple: two of one command, and a third of another for validation."""
    logs = [log(k, extra, noise=noise, ripple=0.0, path=p) for k, p in ((1, 7), (2, 7), (3, 8))]
    return compare(machine, logs[:2], logs[2:])


def unseen(c: Comparison) -> float:
    """Return the RMS of what the twin leaves of the validation log [N]."""
    assert c.unseen is not None
    return rms(c.unseen.residual[0])


@pytest.mark.parametrize("noise", [1.0, 4.0])
def test_the_share_that_a_cause_closes_is_that_of_the_validation_log(plain: Machine, noise: float) -> None:
    c = compared(plain, drag, noise)
    (told,) = Account(lacking(c)).causes
    (closed,) = told.closed.values()
    known = 1.0 - (unseen(compared(plain, none, noise)) / unseen(c)) ** 2
    assert 0.2 < known < 0.95
    assert closed.on == "validation"
    assert closed.share == pytest.approx(known, abs=0.05)
    assert closed.promised == pytest.approx(known, abs=0.1)


def test_the_shares_of_two_causes_add_up_to_the_whole(plain: Machine) -> None:
    c = compared(plain, lambda *x: drag(*x) + wave(*x), 1.0)
    account = Account(lacking(c))
    assert sorted(x.one.name for x in account.causes) == ["quadratic_drag", "ripple"]
    known = 1.0 - (unseen(compared(plain, none, 1.0)) / unseen(c)) ** 2
    assert sum(x.closed[0].share for x in account.causes) == pytest.approx(known, abs=0.05)
    assert account.together["X"].share == pytest.approx(sum(x.closed[0].share for x in account.causes))


def test_a_pattern_without_a_name_closes_nothing(plain: Machine) -> None:
    c = compared(plain, lambda t, q, v: drag(t, q, v) + 3.0 * np.sin(2.0 * np.pi * 11.0 * t), 0.5)
    account = Account(lacking(c))
    assert [x.one.name for x in account.causes] == ["quadratic_drag"]
    assert account.patterns == {"X": "swings in time at 11 Hz"}
    hum = compared(plain, lambda t, q, v: 3.0 * np.sin(2.0 * np.pi * 11.0 * t), 0.5)
    known = 1.0 - (unseen(hum) / unseen(c)) ** 2
    assert account.together["X"].share == pytest.approx(known, abs=0.05)


def test_a_cause_that_is_not_sure_closes_nothing(plain: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    found = lacking(compared(plain, drag, 1.0))
    assert Account(found).together["X"].share > 0.8
    monkeypatch.setattr(
        "pinotwin.diagnosis.days.structure.Turn.probabilities", lambda turn: [(turn.taken, 0.3)]
    )
    assert Account(found).together == {}


def test_intervals_of_a_share_cover_it() -> None:
    inside, true = 0, 0.5
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before = rng.exponential(size=40)
        after = true * before * rng.uniform(0.6, 1.4, size=40)
        low, high = share_interval(before, after, seed)
        inside += low <= 1.0 - true <= high
    assert 0.80 <= inside / 200 <= 0.98


def test_intervals_of_a_size_cover_it(plain: Machine) -> None:
    inside, true = 0, 40.0
    for seed in range(40):
        logs = [
            log(2 * seed + k, lambda t, q, v: true * v * np.abs(v), noise=3.0, ripple=0.0, seconds=6.0)
            for k in (1, 2)
        ]
        c = compare(plain, logs, [])
        g, effect = Ground.of(c), EFFECTS["quadratic_drag"].on(c.machine, "X")
        found = judged(g, effect, "X", g.table(effect))
        assert found is not None
        one = judged(g.as_noisy_as(beside(g, found)), effect, "X", found.tables)
        assert one is not None
        low, high = sizes_of(one)[0].interval
        inside += low <= true <= high
    assert 0.80 <= inside / 40 <= 0.98


def test_warming_friction_has_its_cold_number_from_that_of_the_machine(plain: Machine) -> None:
    c = compared(plain, lambda t, q, v: 30.0 * v * np.exp(-t / 5.0), 0.5)
    (told,) = Account(lacking(c)).causes
    warm, cold = sizes_of(told.one)
    assert (warm.name, cold.name) == ("viscous_thermal.b_warm", "viscous_thermal.b")
    assert 60.0 < cold.before < 90.0
    assert cold.interval[0] <= 90.0 <= cold.interval[1]
    assert warm.interval[0] <= -30.0 <= warm.interval[1]


def test_what_is_as_good_is_listed(machine: Machine) -> None:
    """Dry friction that takes 0.3 mm to turn round, of two laws that differ about rest alone."""

    found = lacking(compare(machine, [log(k, bristle, noise=2.0) for k in (1, 2)], []))
    assert [set(group) for x in found.named for group in alike(x)] == [{"X.presliding", "X.hysteresis"}]


def rectangle(start: float, length: float, force: float) -> Extra:
    return lambda t, q, v: force * ((t >= start) & (t < start + length))


def half_sine(start: float, length: float, force: float) -> Extra:
    return lambda t, q, v: force * np.sin(np.pi * np.clip((t - start) / length, 0.0, 1.0))


def asked(machine: Machine, extra: Extra) -> Diagnosis:
    """Return the diagnosis of two logs, the first of which was pushed."""
    return diagnose(machine, [log(1, extra), log(2, none, path=8)], closed_loop=False)


def times(found: Diagnosis) -> list[tuple[float, float]]:
    return [r.range for r in found.where if r.kind == "time" and r.p_value is None]


@pytest.mark.parametrize(
    ("start", "length", "force"), [(5.0, 0.3, 20.0), (8.0, 0.3, -60.0), (4.0, 4.0, 20.0)]
)
def test_a_push_of_any_length_is_found_with_its_time_and_force(
    machine: Machine, start: float, length: float, force: float
) -> None:
    """A load on the axis is negative: its effort is larger by as much."""
    found = asked(machine, rectangle(start, length, force))
    assert [(e.effect, e.axis) for e in found.effects] == [("external_force", "X")]
    (size,) = found.effects[0].size
    assert size.name == "largest disturbance"
    slack = 0.3 + 0.01 * abs(force)  # its edges are not those of the half waves and boxes
    assert size.interval[0] - slack <= -force <= size.interval[1] + slack
    assert found.effects[0].shrink["u"].on == "fitted logs"
    assert len(times(found)) == 1
    assert times(found)[0] == pytest.approx((start, start + length), abs=0.05)


@pytest.mark.parametrize(("length", "force"), [(0.3, 60.0), (2.0, -30.0)])
def test_a_push_that_swells_is_one_push(machine: Machine, length: float, force: float) -> None:
    """The parts of a half sine, each with the mean of all that lies in it, came to twice the push."""
    found = asked(machine, half_sine(5.0, length, force))
    assert [(e.effect, e.axis) for e in found.effects] == [("external_force", "X")]
    assert found.effects[0].shrink["u"].share > 0.9
    assert all(5.0 - 0.05 <= a <= b <= 5.05 + length for a, b in times(found))


def test_pushes_of_both_logs_are_told_with_the_time_and_share_of_each(machine: Machine) -> None:
    """Four pushes of 60 ms on an axis that closed 0.7 of its gap were not asked about without a twin."""
    at = (2.1, 4.4, 7.3, 10.2)

    def extra(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        del q, v
        return -40.0 * np.any([(t > x) & (t < x + 0.06) for x in at], axis=0)

    found = diagnose(machine, [log(1, extra), log(2, extra)], closed_loop=False)
    assert [(e.effect, e.axis) for e in found.effects] == [("external_force", "X")]
    told = [r for r in found.where if r.kind == "time" and r.p_value is None]
    assert all(min(abs(r.range[0] - x) for x in at) < 0.1 for r in told)
    assert sum(r.share for r in told) == pytest.approx(found.effects[0].shrink["u"].share, abs=0.02)
    assert len(told) == 4  # each once, though it is in both logs


def test_two_pushes_are_told_from_what_comes_with_the_motion(machine: Machine) -> None:
    found = asked(machine, lambda t, q, v: 60.0 * (np.abs(t - 4.0) < 0.15) - 50.0 * (np.abs(t - 8.2) < 0.1))
    assert [(e.effect, e.axis) for e in found.effects] == [("external_force", "X")]
    assert len(times(found)) == 2


def test_a_push_beside_a_ripple_is_found_with_it(machine: Machine) -> None:
    def waves(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 12.0 * np.cos(2.0 * np.pi * q / OTHER)

    logs = [log(1, lambda t, q, v: waves(t, q, v) + 40.0 * (np.abs(t - 5.0) < 0.2)), log(2, waves, path=8)]
    found = diagnose(machine, logs, closed_loop=False)
    assert {e.effect for e in found.effects} == {"ripple", "external_force"}


def test_a_push_beside_a_cause_is_judged_with_it_by_the_same_rows(plain: Machine) -> None:
    """With a validation log the shares of both were of different rows, and could not be added."""
    logs = [log(k, drag, noise=1.0, ripple=0.0, path=p) for k, p in ((1, 7), (2, 7), (3, 8))]
    pushed = log(
        1, lambda t, q, v: drag(t, q, v) + 30.0 * (np.abs(t - 5.0) < 0.2), noise=1.0, ripple=0.0, path=7
    )
    account = Account(lacking(compare(plain, [pushed, logs[1]], logs[2:])))
    assert {x.one.name for x in account.causes} == {"quadratic_drag", "external_force"}
    assert {x.closed[0].on for x in account.causes} == {"held-out blocks", "fitted logs"}
    assert account.together["X"].share == pytest.approx(sum(x.closed[0].share for x in account.causes))
