"""The compiled mass matrix and bias effort of the 4 kHz simulation are Pinocchio's."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.dynamics import parameters
from pinotwin.dynamics.stepping import gather, replay
from pinotwin.dynamics.tape import record
from pinotwin.errors import MachineError
from tests.dynamics_models import PANDA, UR10, driller, motion, random_tree, robot


def assert_equals_pinocchio(model, seed):
    tape = record(model, parameters(model))
    data, t = model.createData(), np.zeros(tape.size)
    t[: len(tape.start)] = tape.start
    M, h = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    for q, v, a in zip(*motion(np.random.default_rng(seed), model, 30), strict=True):
        replay(tape.revolute, tape.ops, tape.sign, q, v, t)
        gather(tape.mass, tape.bias, t, M, h)
        mass, bias = pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)
        np.testing.assert_allclose(M, mass, rtol=0, atol=1e-12 * np.abs(mass).max())
        np.testing.assert_allclose(h, bias, rtol=0, atol=1e-12 * np.abs(bias).max())
        again = pin.aba(model, data, q, v, M @ a + h)
        np.testing.assert_allclose(again, a, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("seed", range(15))
def test_random_trees(seed):
    joints = int(np.random.default_rng(seed).integers(1, 8))
    assert_equals_pinocchio(random_tree(np.random.default_rng(seed), joints=joints), seed)


@pytest.mark.parametrize("name", ["laser_driller", "trunnion", "flexure_rig", "tx40", "emps"])
def test_bundled_machines(name):
    assert_equals_pinocchio(pt.Machine.load(name).model, 1)


@pytest.mark.parametrize("make", [driller, lambda: robot(UR10), lambda: robot(PANDA)])
def test_other_machines(make):
    assert_equals_pinocchio(make(), 2)


def test_a_joint_that_it_does_not_know_is_named():
    model = random_tree(np.random.default_rng(5), joints=2)
    i = model.addJoint(2, pin.JointModelHX(0.1), pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(MachineError, match="joint 'screw' is neither revolute nor prismatic"):
        record(model, parameters(model))
