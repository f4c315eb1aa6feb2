"""What a machine's model lacks, by the one score: machines on which each answer is known."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from pinotwin.diagnosis import Diagnosis, diagnose
from pinotwin.diagnosis.candidates.patterns import LOUDEST, loudest
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.days.account import Account
from pinotwin.diagnosis.days.structure import Lacking, lacking
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.slide_logs import OTHER, Extra, bristle, listing, log

Ask = Callable[..., Lacking]
TURNING = {"presliding", "hysteresis"}


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return listing(tmp_path_factory.mktemp("machine") / "slide")


@pytest.fixture(scope="module")
def ask(machine: Machine) -> Ask:
    """Return what is said of a slide whose machine lists friction and a ripple, with something put on top."""

    def asked(extra: Extra, logs: int = 2, seed: int = 0, late: float = 0.0) -> Lacking:
        every = [log(seed + k, extra, late=late) for k in range(1, 1 + logs)]
        return lacking(compare(machine, every[:2], every[2:]))

    return asked


@pytest.fixture(scope="module")
def diagnosed(machine: Machine) -> Callable[[Extra], Diagnosis]:
    return lambda extra: diagnose(machine, [log(1, extra), log(2, extra)], closed_loop=False)


def said(found: Lacking) -> list[str]:
    return [x.name for x in found.causes]


def sure(found: Lacking) -> list[str]:
    return [x.one.name for x in Account(found).causes if x.sure]


@pytest.mark.parametrize("seed", [0, 10])
def test_nothing_is_missing_in_a_machine_that_lists_what_it_has(ask: Ask, seed: int) -> None:
    found = ask(lambda t, q, v: np.zeros_like(t), logs=3, seed=seed)
    assert said(found) == []
    searched = {x.name for x in found.first} & {"ripple", "hum", "backlash", "speed_ripple"}
    assert searched == set()  # for an axis that leaves nothing


def test_drag_is_missing_and_takes_its_numbers_from_no_friction_that_went_to_its_bound(ask: Ask) -> None:
    """Fitted without it, dry friction falls below what there is: its columns must be free beside a candidate."""
    found = ask(lambda t, q, v: 120.0 * v * np.abs(v), logs=3)
    assert said(found) == ["quadratic_drag"]
    assert found.causes[0].theta[0] == pytest.approx(120.0, rel=0.05)


def test_a_cause_that_listed_friction_takes_up_is_as_large_as_it_is(ask: Ask) -> None:
    """It closes half a per cent of the effort, and is two."""
    found = ask(lambda t, q, v: 20.0 * v * np.abs(v))
    assert said(found) == ["quadratic_drag"]
    one = found.causes[0]
    assert one.worth < one.ground.c.worth < one.size
    assert one.theta[0] == pytest.approx(20.0, rel=0.2)


def test_of_two_causes_each_is_found_beside_the_other(ask: Ask) -> None:
    found = ask(lambda t, q, v: 120.0 * v * np.abs(v) + 5.0 * np.cos(2.0 * np.pi * q / OTHER))
    assert sorted(said(found)) == ["quadratic_drag", "ripple"]


def test_a_small_cause_beside_a_large_one_is_named_where_it_closes_most_of_the_rest(ask: Ask) -> None:
    """A quarter of what the ripple does, RMS."""
    found = ask(lambda t, q, v: 40.0 * np.cos(2.0 * np.pi * q / OTHER) + 80.0 * v * np.abs(v))
    assert said(found) == ["ripple", "quadratic_drag"]


def test_two_causes_of_one_axis_are_both_named_as_what_they_are(ask: Ask) -> None:
    found = ask(
        lambda t, q, v: 9.0 * np.cos(2.0 * np.pi * q / 0.11) + 25.0 * np.sign(v) * np.exp(-np.abs(v) / 0.03),
    )
    assert set(said(found)) == {"ripple", "stribeck"}


def test_friction_that_warms_away_is_no_drag(ask: Ask) -> None:
    found = ask(lambda t, q, v: 30.0 * v * np.exp(-t / 5.0) - 30.0 * v)
    assert said(found) == ["viscous_thermal"]


def test_a_row_says_what_a_decision_reads(ask: Ask) -> None:
    found = ask(lambda t, q, v: 120.0 * v * np.abs(v))
    row = found.first[0].row()
    assert (row.name, row.axis, row.group) == ("quadratic_drag", "X", "form")
    assert sum(row.by.values()) - row.price == pytest.approx(row.score)
    assert row.closed["plant"] > 0.9
    assert len(row.logs) == 2


@pytest.mark.parametrize("missing", [0.0, 9.0])
def test_one_log_alone_is_judged_without_repeats(ask: Ask, missing: float) -> None:
    found = ask(lambda t, q, v: missing * np.cos(2.0 * np.pi * q / OTHER), logs=1)
    assert said(found) == (["ripple"] if missing else [])


def test_a_second_ripple_is_missing(ask: Ask) -> None:
    """The next test must not pass because no ripple is ever named beside a listed one."""
    assert said(ask(lambda t, q, v: 12.0 * np.cos(2.0 * np.pi * q / OTHER))) == ["ripple"]


def test_a_listed_ripple_that_something_larger_led_astray_is_not_missing(
    diagnosed: Callable[[Extra], Diagnosis],
) -> None:
    """Its pitch was that of a ripple which grows with speed; the ripple itself was named, with 96 %."""
    found = diagnosed(lambda t, q, v: 150.0 * np.abs(v) * np.cos(2.0 * np.pi * q / OTHER))
    assert found.effects == []
    assert found.verdict == "unexplained"
    assert "ripple of pitch 0.031 m that grows with speed" in found.remains["X"]


def test_two_ripples_are_not_a_table(ask: Ask) -> None:
    """A listed ripple whose pitch was found for want of another one."""
    found = ask(lambda t, q, v: 12.0 * np.cos(2.0 * np.pi * q / 0.05) + 3.6 * np.cos(2.0 * np.pi * q / OTHER))
    assert sure(found)[0] == "ripple"
    assert "position_table" not in sure(found)


def test_what_swings_fast_in_time_is_said_to_do_so(diagnosed: Callable[[Extra], Diagnosis]) -> None:
    """What swings faster than 25 Hz is found where the spectrum of what is left peaks."""
    found = diagnosed(lambda t, q, v: 8.0 * np.sin(2.0 * np.pi * 37.3 * t))
    assert found.effects == []
    assert "swings in time at 37.3 Hz" in found.remains["X"]


def test_what_pushes_all_the_time_is_a_vibration(ask: Ask) -> None:
    found = ask(lambda t, q, v: 6.0 * np.sign(np.sin(2.0 * np.pi * 12.5 * t)))
    assert "external_force" not in said(found)


def test_a_bump_at_a_place_is_no_push(ask: Ask) -> None:
    found = ask(lambda t, q, v: -40.0 * np.exp(-(((q - 0.03) / 0.008) ** 2)))
    assert sure(found) == ["position_table"]


def test_a_force_that_goes_to_and_fro_is_no_push(ask: Ask) -> None:
    """Play on another axis shook one for a seventh of a second, and was a push with 96 %."""
    found = ask(
        lambda t, q, v: 120.0 * np.sin(2.0 * np.pi * (t - 4.4) / 0.08) * ((t > 4.4) & (t < 4.72)),
    )
    assert "external_force" not in said(found)


def test_how_friction_turns_round_is_missing_in_a_machine_that_lists_dry_friction(ask: Ask) -> None:
    named = set(said(ask(bristle)))
    assert named
    assert named <= TURNING


@pytest.mark.parametrize(("late", "named"), [(0.6e-3, False), (2e-3, True)])
def test_an_effort_that_is_late_by_less_than_half_a_cycle_is_held_over_it(
    ask: Ask, late: float, named: bool
) -> None:
    found = ask(lambda t, q, v: np.zeros_like(t), late=late)
    assert said(found) == ["delay"] * named


@pytest.mark.parametrize("share", [0.012, 0.03])
def test_what_is_all_that_repeats_share_is_named_however_small(ask: Ask, share: float) -> None:
    """From one per cent of the effort on."""
    wave = np.sqrt(2.0) * share * 91.0
    assert said(ask(lambda t, q, v: wave * np.cos(2.0 * np.pi * q / 0.11))) == ["ripple"]


def test_play_is_named_though_a_delay_looks_like_it() -> None:
    virtual = VirtualMachine.load(machines()["emps"], inject=["backlash:X=1.0"])
    log = virtual.record(random_trajectory(virtual, 8.0, 4), seed=4).to_log()
    found = lacking(compare(dataclasses.replace(Machine.load("emps"), columns={}), [log], []))
    assert said(found)[:1] == ["backlash"]
    assert "delay" not in said(found)


def test_the_loudest_frequencies_are_those_that_were_put_in() -> None:
    t = np.concatenate(
        [np.arange(0.0, 8.0, 0.005), np.arange(0.0, 5.0, 0.005), np.arange(1e9, 1e9 + 2.0, 0.005)]
    )
    left = np.sin(2.0 * np.pi * 41.27 * t) + 0.5 * np.cos(2.0 * np.pi * 63.0 * t)
    found = loudest(t, left)
    assert len(found) == LOUDEST
    assert found[0] == pytest.approx(41.27, abs=0.03)
    assert min(abs(f - 63.0) for f in found) < 0.1
    assert min(found) >= 25.0
