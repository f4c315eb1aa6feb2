"""The vibration of a passive joint in a diagnosis, on the virtual rig, whose integrator is not the twin's."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from pinotwin.analysis.deflection import PassiveSpring, load_of, springs
from pinotwin.diagnosis.apply import extended
from pinotwin.diagnosis.grade import is_open
from pinotwin.diagnosis.result import Diagnosis, Gap
from pinotwin.diagnosis.signals.vibration import look_at_vibration, unused
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.logs.prepared import Prepared
from pinotwin.machine import Machine
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine
from tests.simulated import known_twin
from tests.test_examples import example

rig_moves = example("rig_moves")

NOISE = 2e-4  # [rad/s] of the vibration's velocity
TRUE_DAMPING = 0.05


@cache
def rig() -> VirtualMachine:
    return VirtualMachine.load("urdf/flexure_rig")


@cache
def twin() -> Twin:
    """A twin of the rig: inertias of the CAD, and the spring that one log asks for with them."""
    found = known_twin(Machine.load("flexure_rig"))
    healthy = look(recorded(1, 11), subject=found).effects[0]
    theta = found.theta.copy()
    at = found.slices[found.keys.index("delta.spring")]
    theta[at] = healthy.theta["k"], healthy.theta["c"]
    return dataclasses.replace(found, theta=theta)


@cache
def recorded(seed: int, path: int = 12, **changes: float) -> Log:
    machine = rig()
    passive = {k: dataclasses.replace(p, **changes) for k, p in machine.truth.passive.items()}
    truth = dataclasses.replace(machine.truth, passive=passive)
    machine = dataclasses.replace(machine, truth=truth)
    run = machine.record(random_trajectory(machine, 5.0, path, rig_moves.limits_c1(machine)), seed=seed)
    v = run.truth.joint("delta")[1]
    log = run.to_log()
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(v))
    return log.with_channels({**log.channels, "delta.v": v + noise})


def look(*logs: Log, validation: tuple[bool, ...] | None = None, subject: object = None):
    flags = validation or (False,) * len(logs)
    rng = np.random.default_rng(1)
    subject = subject or twin()
    machine = subject.machine if isinstance(subject, Twin) else subject
    ready = [Prepared(machine, log) for log in logs]
    return look_at_vibration(subject, ready, flags, (0,) * len(logs), rng)


def stays_open(g: Gap) -> bool:
    """Whether a diagnosis leaves the gap of a vibration open."""
    return is_open(g.after, g.noise, None, g.rms / g.nrmse, signal="v")


def test_the_deflection_is_the_one_that_the_virtual_rig_makes() -> None:
    log = recorded(2)
    motion = prepare(twin().machine, log, decimate=1)
    (spring,) = springs(twin())
    load = load_of(twin().machine, twin().coefficients("rigid_body"), motion, spring.index)
    v = load.response(spring)[1]
    inner = slice(400, -200)
    assert np.std((v - log["delta.v"])[inner]) < 0.15 * np.std(log["delta.v"][inner])


def test_a_mode_follows_from_stiffness_damping_and_inertia() -> None:
    wn, zeta = PassiveSpring("delta", 0, 4.0e4, 80.0).mode(4.0)
    assert wn == pytest.approx(100.0)
    assert zeta == pytest.approx(80.0 / (2.0 * 4.0 * 100.0))


def test_a_healthy_joint_is_accused_of_nothing() -> None:
    said = look(recorded(2), recorded(3))
    assert said.effects == []
    assert not stays_open(said.gaps["delta"])
    assert said.gaps["delta"].noise == pytest.approx(NOISE * np.sqrt(2.0 * 60.0 / 400.0), rel=0.25)


@pytest.mark.parametrize(("frequency", "damping"), [(18.0, TRUE_DAMPING), (22.0, TRUE_DAMPING), (20.0, 0.1)])
def test_another_spring_is_named_and_shrinks_the_gap_on_a_log_that_was_not_fitted(
    frequency: float, damping: float
) -> None:
    changes = {"frequency": frequency, "damping_ratio": damping}
    logs = [recorded(2, **changes), recorded(3, **changes), recorded(4, 13, **changes)]
    said = look(*logs, validation=(False, False, True))
    (found,) = said.effects
    assert (found.effect, found.axis) == ("joint_flexibility", "delta")
    k, c = springs(twin())[0].stiffness, springs(twin())[0].damping
    assert found.theta["k"] / k == pytest.approx((frequency / 20.0) ** 2, rel=0.04)
    ratio = damping / TRUE_DAMPING * frequency / 20.0
    assert found.theta["c"] / c == pytest.approx(ratio, rel=0.12)
    assert found.shrink["v"].on == "validation"
    shrink = found.shrink["v"]
    assert shrink.share > 0.8
    assert shrink.interval[0] < shrink.share < shrink.interval[1]
    assert abs(shrink.promised - shrink.share) < 0.15
    assert shrink.promised != shrink.share  # of the logs that were fitted
    assert said.gaps["delta"].after < said.gaps["delta"].rms


def test_one_log_is_enough() -> None:
    said = look(recorded(2, frequency=18.0))
    assert [e.axis for e in said.effects] == ["delta"]
    assert said.effects[0].shrink["v"].on == "held-out blocks"


def test_what_no_spring_brings_about_stays_open() -> None:
    log = recorded(2)
    beat = 6e-3 * np.sin(2.0 * np.pi * 31.0 * log.t)  # a fan on the table
    logs = [x.with_channels({**x.channels, "delta.v": x["delta.v"] + beat}) for x in (log, recorded(3))]
    said = look(*logs)
    assert stays_open(said.gaps["delta"])
    assert said.gaps["delta"].after > 3e-3


def test_without_a_twin_or_without_the_channel_nothing_is_said() -> None:
    log = recorded(2)
    plain = Log({k: x for k, x in log.channels.items() if k != "delta.v"})
    assert look(plain).gaps == {}
    machine = Machine.load("flexure_rig")
    assert look(log, subject=machine).gaps == {}
    assert "identify a twin" in unused(machine, [Prepared(machine, log)])[0]
    assert unused(machine, [Prepared(machine, plain)]) == unused(twin(), [Prepared(machine, log)]) == []


def test_the_machine_gets_the_spring_that_was_found() -> None:
    found = look(recorded(2, frequency=18.0)).effects
    d = Diagnosis("", {}, (), found, (), {}, {}, "assumed", (), "change", {}, subject=twin())
    machine = extended(d)
    assert machine.passive["delta"].stiffness == found[0].theta["k"]
    assert machine.spec["passive"]["delta"]["damping"] == found[0].theta["c"]
