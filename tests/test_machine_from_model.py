"""A machine of a ``pin.Model`` in hand, and by the name of a robot of example-robot-data."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.dynamics import inverse
from pinotwin.effects import Coulomb, Viscous
from pinotwin.errors import MachineError
from pinotwin.machine import Machine
from pinotwin.machine.bundled import robots
from tests.dynamics_models import motion, random_tree

needs_robots = pytest.mark.skipif(not robots(), reason="example-robot-data is not installed")


def assert_same_efforts(machine: Machine, model: pin.Model, atol: float = 1e-9) -> None:
    """RNEA of the machine is RNEA of the model, joint by joint by name."""
    q, v, a = motion(np.random.default_rng(0), machine.model, 10)
    data = model.createData()
    at = [model.getJointId(n) for n in list(machine.model.names)[1:]]
    columns = [model.idx_vs[i] for i in at]
    expected = np.empty_like(q)
    for k in range(len(q)):
        step, rate, acc = np.zeros((3, model.nv))
        step[columns], rate[columns], acc[columns] = q[k], v[k], a[k]
        full = pin.integrate(model, pin.neutral(model), step)
        expected[k] = pin.rnea(model, data, full, rate, acc)[columns]
    np.testing.assert_allclose(inverse(machine.model, q, v, a), expected, atol=atol * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(8))
def test_random_trees_keep_their_efforts_names_and_rotors(seed):
    model = random_tree(np.random.default_rng(seed), joints=6)
    machine = Machine.from_model(model)
    assert set(machine.names) == set(list(model.names)[1:])
    assert {a.name: a.rotor_inertia for a in machine.axes.values()} == dict(
        zip(list(model.names)[1:], model.armature.tolist(), strict=True)
    )
    assert_same_efforts(machine, model)


@pytest.mark.parametrize("name", ["laser_driller", "trunnion", "tx40", "emps"])
def test_bundled_machines_survive(name):
    model = Machine.load(name).model
    assert_same_efforts(Machine.from_model(model), model)


@needs_robots
@pytest.mark.parametrize(
    "name", ["panda", "ur5", "kinova", "iris", "talos_reduced", "double_pendulum_continuous"]
)
def test_robots_as_pinocchio_reads_them(name):
    """Continuous joints as (cos, sin), a free-flying base that is locked."""
    model = pin.buildModelFromUrdf(str(robots()[name]), pin.JointModelFreeFlyer())
    assert_same_efforts(Machine.from_model(model), model)


def test_axes_and_effects_are_those_asked_for(tmp_path):
    model = random_tree(np.random.default_rng(1), joints=4)
    machine = Machine.from_model(
        model,
        {
            "j2": ["viscous", {"ripple": {"period": 0.01}}],
            "j1": [Viscous(axis="j1"), Coulomb(axis="j1", width=0.1)],
            "table": {"joint": "j4", "effort_limit": 80.0},
        },
        name="bench",
    )
    assert machine.name == "bench"
    assert list(machine.axes) == ["j2", "j1", "table"]
    assert [e.name for e in machine.axes["j2"].effects] == ["viscous", "ripple"]
    assert machine.axes["j1"].effects[1].width == 0.1
    assert machine.axes["table"].effort_limit == 80.0
    assert machine.axes["table"].rotor_inertia == model.armature[3]
    again = Machine.load(machine.save(tmp_path / "saved"))
    assert again.axes == machine.axes
    rng = np.random.default_rng(3)
    q, v, a = motion(rng, machine.model, 5)
    np.testing.assert_allclose(
        inverse(again.model, q, v, a), inverse(machine.model, q, v, a), rtol=0, atol=1e-12
    )


def test_frames_become_links_that_may_carry_an_imu(tmp_path):
    model = random_tree(np.random.default_rng(1), joints=2)
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 1.0), np.array([0.1, 0.2, 0.3]))
    model.addFrame(pin.Frame("tool", 2, place, pin.FrameType.OP_FRAME))
    machine = Machine.from_model(model)
    data, other = model.createData(), machine.model.createData()
    q = np.array([0.2, -0.4])
    order = [machine.model.getJointId(n) - 1 for n in list(model.names)[1:]]
    pin.framesForwardKinematics(model, data, q)
    pin.framesForwardKinematics(machine.model, other, q[np.argsort(order)])
    here, there = data.oMf[model.getFrameId("tool")], other.oMf[machine.model.getFrameId("tool")]
    np.testing.assert_allclose(there.homogeneous, here.homogeneous, atol=1e-12)


def test_what_cannot_be_a_machine_is_said_with_the_remedy():
    model = random_tree(np.random.default_rng(1), joints=3)
    with pytest.raises(MachineError, match=r"no moving joint 'j9' of one axis; did you mean 'j\d'"):
        Machine.from_model(model, ["j9"])
    with pytest.raises(MachineError, match="expected names of joints"):
        Machine.from_model(model, "j1")
    with pytest.raises(MachineError, match="unknown effect 'viscus'; did you mean 'viscous'"):
        Machine.from_model(model, {"j1": ["viscus"]})
    turning = model.copy()
    turning.gravity.angular = np.array([0.0, -9.81, 0.0])
    with pytest.raises(MachineError, match=r"gravity\.angular is not zero"):
        Machine.from_model(turning)
    with pytest.raises(MachineError, match="no joint of it can be an axis"):
        Machine.from_model(pin.Model())


@needs_robots
def test_robots_go_by_name():
    machine = pt.Machine.load("ur5")
    assert machine.urdf == robots()["ur5"]
    assert machine.names[0] == "shoulder_pan_joint"
    with pytest.raises(MachineError, match="ur55: no such machine; did you mean 'ur5'"):
        pt.Machine.load("ur55")
    with pytest.raises(MachineError, match="trunion: no such machine; did you mean 'trunnion'"):
        pt.Machine.load("trunion")
