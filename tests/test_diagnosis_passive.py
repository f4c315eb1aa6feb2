"""A machine on a flexure, diagnosed without a twin: the mode belongs to its base, measured or not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.effects import Coulomb, Viscous
from pinotwin.identification import Settings, identify
from pinotwin.identification.bending import bend_all, find_bending
from pinotwin.machine import Machine
from pinotwin.signals import rms
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from tests.test_examples import example

rig_moves = example("rig_moves")


@cache
def run(path):
    virtual = VirtualMachine.load("urdf/flexure_rig")
    return virtual.record(random_trajectory(virtual, 6.0, path, rig_moves.limits_c1(virtual)), seed=path)


@cache
def bending():
    return find_bending(Machine.load("flexure_rig"), [run(12).to_log()])


@pytest.fixture(scope="module")
def rig():
    return Machine.load("flexure_rig")


def test_the_gap_of_the_carriage_is_that_beside_the_mode(rig):
    log = run(12).to_log()
    c = compare(rig, [log], [])
    rigid = identify(rig.with_rigid_joints(), log, loop=False)
    assert "delta" not in rigid.machine.names
    motion = rigid.motion(log)
    y = rigid.machine.axis("Y").index
    joint = c.machine.axis("Y").index
    assert "delta" in c.machine.names
    rows = c.new.samples(joint)  # the same for both: where the carriage rests, friction holds any effort
    stiff = rms((motion.u - rigid.effort(motion))[rows, y])
    assert c.new.level(joint) < 0.6 * stiff


def test_identify_lets_a_joint_that_nothing_measured_move_as_its_spring(rig):
    for name in rig.axes:
        rig = rig.with_effects(name, (Viscous(axis=name), Coulomb(axis=name)))
    log = run(13).to_log()
    bent, rigid = (identify(m, log, loop=False) for m in (rig, rig.with_rigid_joints()))
    assert bent.quality["axes"]["Y"]["rms"] < 0.5 * rigid.quality["axes"]["Y"]["rms"]
    truth = VirtualMachine.load("urdf/flexure_rig").tables().springs[0, 0]
    k = bent.parameter("delta.spring.k")
    assert abs(k.value - truth) < k.error
    assert "`pinotwin vibration` measures it" in bent.quality["warnings"][0]


def test_a_spring_that_nothing_measured_is_as_doubtful_as_the_caller_says_of_the_cad(rig):
    twin = identify(rig, run(13).to_log(), loop=False, settings=Settings(cad_doubt=0.2))
    k = twin.parameter("delta.spring.k")
    assert k.error == pytest.approx(0.2 * k.value)


def test_the_deflection_is_near_the_true_one_though_nothing_measured_it():
    recorded = run(12)
    (bent,) = bend_all(bending(), [recorded.to_log()])
    truth = recorded.truth.joint("delta")[1]
    inner = slice(400, -400)
    assert rms((bent["delta.v"] - truth)[inner]) < 0.15 * rms(truth[inner])


def test_a_healthy_rig_has_no_flexible_drive(rig):
    """Asked in full: `quick` takes what slip elements leave of C on path 12 (1.5 %) for a ripple, confidence 70 %."""
    for path in (12, 13):
        found = diagnose(rig, run(path).to_log())
        assert not found.effects
        assert "Y" not in found.unexplained


def test_a_log_that_holds_the_vibration_is_left_as_it_is(rig):
    recorded = run(12)
    log = recorded.to_log()
    measured = log.with_channels({**log.channels, "delta.v": recorded.truth.joint("delta")[1]})
    np.testing.assert_array_equal(bend_all(bending(), [measured])[0]["delta.v"], measured["delta.v"])
    assert np.isfinite(bend_all(bending(), [log])[0]["delta.v"]).all()
    assert find_bending(rig, [measured]) is None
    assert find_bending(Machine.load("trunnion"), [log]) is None
    assert bend_all(None, [log])[0] is log
