"""What is named and what is not: scatter of friction, axes at rest, causes that are not sure, sizes that fit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.candidates.catalogue import candidates, same_cause
from pinotwin.diagnosis.conclusion.residuals import noise_levels
from pinotwin.diagnosis.conclusion.verdict import judge
from pinotwin.diagnosis.conclusion.where import localise
from pinotwin.diagnosis.data.comparison import Comparison, compare, scatter
from pinotwin.diagnosis.grade import stays
from pinotwin.diagnosis.result import Found as Named
from pinotwin.diagnosis.result import Gap, shrunk
from pinotwin.diagnosis.rules import RULES
from pinotwin.effects import Effect, InertialCoupling, Offset, Presliding, Viscous
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.signals import rms
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory


def record(path: int, *inject: str) -> Log:
    virtual = VirtualMachine.load(machines()["emps"], inject=inject)
    return virtual.record(random_trajectory(virtual, 8.0, path), seed=path).to_log()


@pytest.fixture(scope="module")
def machine() -> Machine:
    return dataclasses.replace(Machine.load("emps"), columns={})


@pytest.fixture(scope="module")
def twin(machine: Machine) -> Twin:
    return identify(machine, [record(3), record(5)])


@pytest.fixture(scope="module")
def worn(twin: Twin) -> Log:
    return record(4, "viscous:X=0.5")


@pytest.mark.parametrize(("times", "counts"), [(0.02, 0.02), (0.12, 0.12), (0.3, 0.075), (0.9, 0.05)])
def test_what_friction_scatters_is_noise_up_to_a_share_of_it(twin: Twin, times: float, counts: float) -> None:
    c = compare(twin, [record(4)], [])
    friction = c.rubs[0].sum(axis=1)
    c, size = with_residual(c, times * friction), rms(friction)
    assert scatter(c, 0, RULES.scatter) == pytest.approx(counts * size)
    noise, kind = noise_levels(c)
    assert kind == "assumed"
    assert counts * size <= noise[0] < counts * size + 0.2 * times * size
    gap = Gap(rms=times * size, nrmse=0.1, noise=noise[0], after=times * size, misfit=c.floor[0])
    assert (stays(gap.after, gap.noise, gap.misfit, None) > RULES.open_change) == (times > 0.2)


def test_of_a_machine_noise_is_no_open_gap(machine: Machine) -> None:
    c = compare(machine, [record(4)], [])
    size = c.new.size(0)
    noisy = Gap(rms=0.3 * size, nrmse=0.3, noise=0.29 * size, after=0.3 * size)
    assert stays(noisy.after, noisy.noise, noisy.misfit, size) == pytest.approx(np.sqrt(0.3**2 - 0.29**2))


def with_residual(c: Comparison, r: np.ndarray) -> Comparison:
    return dataclasses.replace(c, new=dataclasses.replace(c.new, residual={0: r}))


def test_friction_that_changed_against_a_twin_of_one_run_may_be_warmth(twin: Twin, worn: Log) -> None:
    """LWR4: friction of two healthy runs differs by half of it."""
    several = diagnose(twin, worn, quick=True)
    alone = diagnose(dataclasses.replace(twin, data=twin.data[:1]), worn, quick=True)
    assert [e.effect for e in alone.effects] == [e.effect for e in several.effects] == ["viscous"]
    assert any("from several healthy runs" in text for text in alone.advice)
    assert not any("from several healthy runs" in text for text in several.advice)


@pytest.mark.parametrize(
    ("laws", "gone"),
    [
        ((Presliding("X"),), {"presliding", "stribeck", "coulomb"}),
        ((Presliding("X", stribeck=0),), {"presliding", "coulomb"}),
        ((Presliding("X", stribeck=0), Offset("X")), {"presliding", "coulomb", "coulomb_asymmetric"}),
    ],
)
def test_friction_that_a_machine_lists_is_not_missing_in_it(
    machine: Machine, laws: tuple[Effect, ...], gone: set[str]
) -> None:
    with_laws = [
        dataclasses.replace(machine, axes={"X": dataclasses.replace(machine.axes["X"], effects=effects)})
        for effects in ((Viscous("X"),), (Viscous("X"), *laws))
    ]
    before, after = ({e.name for e in candidates(compare(m, [record(4)], []))} for m in with_laws)
    assert gone <= before
    assert not gone & after
    assert ("stribeck" in after) != ("stribeck" in gone)


def test_the_gap_is_found_where_it_lies(twin: Twin) -> None:
    c = compare(twin, [record(4)], [])
    q = c.new.motion.q[c.new.samples(0), 0]
    rng = np.random.default_rng(0)
    low, high = np.quantile(q, [0.6, 0.8])
    r = rng.normal(size=len(q)) * np.where((q > low) & (q < high), 6.0, 1.0)
    found = [x for x in localise(c.new, r, 0, rng) if x.kind == "position"]
    assert found
    best = max(found, key=lambda x: x.share)
    assert best.range[1] > low
    assert best.range[0] < high
    assert [x for x in localise(c.new, rng.normal(size=len(q)), 0, rng) if x.p_value is not None] == []


def test_a_coefficient_that_rests_at_zero_was_none_before(twin: Twin, worn: Log) -> None:
    """LWR4: "viscous b 2.134e-14 -> 1.881, x 8.8e+13"."""
    where = next(w for e, w in zip(twin.effects, twin.slices, strict=True) if e.name == "viscous")
    theta = twin.theta.copy()
    theta[where] = 2e-14
    found = diagnose(dataclasses.replace(twin, theta=theta), worn, quick=True)
    assert [e.effect for e in found.effects] == ["viscous"]
    assert found.effects[0].size[0].before == pytest.approx(0.0, abs=1e-9)
    assert found.effects[0].size[0].after == pytest.approx(
        560.0, rel=0.1
    )  # 1.5 times 199, and what was taken out
    assert "e-" not in found.sentence


@pytest.mark.parametrize(("rms", "opened"), [(1.4, []), (4.0, ["X"])])
def test_what_is_not_sure_opens_no_gap_that_is_no_larger_than_what_is_left_anyway(
    twin: Twin, worn: Log, rms: float, opened: list[str]
) -> None:
    c = compare(twin, [worn], [])
    faint = Named("viscous", "X", 0.17, {}, {}, {}, [])
    gap = {"X": {"u": Gap(rms=rms, nrmse=0.1, noise=0.8, after=0.9, misfit=0.6)}}
    sentence, unexplained, _ = judge(c, {}, gap, [], [faint])
    assert list(unexplained) == opened
    assert "Possible, not sure: X viscous" in sentence


def test_a_validation_log_of_before_the_change_is_asked_about(twin: Twin, worn: Log) -> None:
    found = diagnose(twin, worn, validate=record(4), quick=True)
    assert list(found.effects) == []
    assert any("X: the validation log shows" in text for text in found.advice)


def test_the_tracking_error_shrinks_by_what_was_named(twin: Twin, worn: Log) -> None:
    found = diagnose(twin, worn)
    assert [(e.effect, e.axis) for e in found.effects] == [("viscous", "X")]
    shrink = found.effects[0].shrink["e"]
    assert shrink.share > 0.3  # of the squared error, simulated from the command alone
    assert shrink.after < shrink.before
    assert found.gap["X"]["e"].rms == pytest.approx(shrink.before)


def test_a_push_at_the_end_of_a_log_is_named_and_the_servo_is_not(twin: Twin) -> None:
    log = record(4)
    late = (log.t > log.t[-1] - 1.5) & (log.t < log.t[-1] - 1.0)
    found = diagnose(twin, Log({**log.channels, "X.u": log["X.u"] + 40.0 * late}, source="pushed.csv"))
    assert [(e.effect, e.axis) for e in found.effects] == [("external_force", "X")]


@pytest.mark.parametrize("inject", ["viscous:X=0.5", "effort_scale:X=0.3"])
def test_a_validation_log_of_before_the_change_is_spoken_of(twin: Twin, inject: str) -> None:
    """A scaled effort beside a healthy validation log was pushes, without a word."""
    found = diagnose(twin, record(4, inject), validate=record(6))
    assert {e.effect for e in found.effects} <= {"external_force"}
    assert any("if it was recorded before the change, leave it out" in text for text in found.advice)


def test_a_cause_that_is_not_sure_opens_the_axis_that_it_moves_most(twin: Twin) -> None:
    """A load of 12 kg on the last link, not sure, left "no change" on the axis that lifts it."""
    c = compare(twin, [record(4)], [])
    acts = {"X": shrunk(4.0, 0.9, (0.8, 0.95), 0.9, "held-out blocks", "X")}
    unsure = Named("payload", "A", 0.3, {}, {}, {}, [], acts=acts)
    gap = {"X": {"u": Gap(rms=4.0, nrmse=0.1, noise=0.8, after=0.9, misfit=0.6)}}
    _, unexplained, _ = judge(c, {}, gap, [], [unsure])
    assert list(unexplained) == ["X"]


def test_of_two_bodies_that_couple_axes_the_order_tells_nothing() -> None:
    one = InertialCoupling("Z", partner="Y")
    assert same_cause(one, InertialCoupling("Y", partner="Z"))
    assert not same_cause(one, InertialCoupling("X", partner="Y"))
