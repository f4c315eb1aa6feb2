"""Whole-log dynamics, parameters, frames and pseudo-inertia against Pinocchio and closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from pinotwin import dynamics as dyn
from pinotwin.dynamics.parameters import pseudo_inertia
from pinotwin.errors import DataError, MachineError
from tests.dynamics_models import driller, motion, random_tree

SEEDS = range(10)


def setup(seed, n=12):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, joints=int(rng.integers(2, 8)))
    body = pin.SE3(pin.SE3.Random().rotation, rng.normal(size=3))
    model.addFrame(pin.Frame("tool", model.njoints - 1, body, pin.FrameType.OP_FRAME))
    return (model, *motion(rng, model, n))


@pytest.mark.parametrize("seed", SEEDS)
def test_inverse_is_rnea(seed):
    model, q, v, a = setup(seed)
    data = model.createData()
    tau = dyn.inverse(model, q, v, a)
    expected = np.array([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(tau, expected, atol=1e-12 * np.abs(tau).max())
    assert tau.flags.c_contiguous


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_matrix_is_the_response_to_unit_accelerations(seed):
    model, q, v, a = setup(seed)
    M = dyn.mass_matrix(model, q)
    zero = np.zeros_like(q)
    g = dyn.inverse(model, q, zero, zero)
    for j in range(model.nv):
        unit = np.zeros_like(q)
        unit[:, j] = 1.0
        column = dyn.inverse(model, q, zero, unit) - g
        np.testing.assert_allclose(M[:, :, j], column, atol=1e-11)
    tau = np.einsum("nij,nj->ni", M, a) + dyn.inverse(model, q, v, zero)
    np.testing.assert_allclose(tau, dyn.inverse(model, q, v, a), atol=1e-10)


def test_pendulum_closed_form():
    # m = 2 kg at 0.5 m below a horizontal axis, rotor 0.1 kg m2: tau = (m l2 + Ja) a + m g l sin q
    model = pin.Model()
    i = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "A")
    model.appendBodyToJoint(
        i, pin.Inertia(2.0, np.array([0.0, 0.0, -0.5]), np.zeros((3, 3))), pin.SE3.Identity()
    )
    model.armature = np.array([0.1])
    q, v, a = (np.linspace(-3, 3, 11)[:, None] * s for s in (1.0, 2.0, -3.0))
    tau = (2.0 * 0.25 + 0.1) * a + 2.0 * 9.81 * 0.5 * np.sin(q)
    np.testing.assert_allclose(dyn.inverse(model, q, v, a), tau, atol=1e-13)
    np.testing.assert_allclose(dyn.mass_matrix(model, q), np.full((11, 1, 1), 0.6), atol=1e-14)


def test_empty_log():
    model, q, *_ = setup(0, n=0)
    assert dyn.inverse(model, q, q, q).shape == q.shape
    assert dyn.regressor(model, q, q, q).shape == (0, model.nv, len(dyn.parameters(model)))


@pytest.mark.parametrize("seed", SEEDS)
def test_parameters_round_trip(seed):
    model, q, v, a = setup(seed)
    other = random_tree(np.random.default_rng(seed + 100), joints=model.nv)
    pi = dyn.parameters(other)
    before = dyn.parameters(model)
    changed = dyn.with_parameters(model, pi)
    np.testing.assert_allclose(dyn.parameters(changed), pi, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(dyn.parameters(model), before)
    tau = dyn.inverse(changed, q, v, a)
    np.testing.assert_allclose(dyn.regressor(model, q, v, a) @ pi, tau, atol=1e-11)


def test_names_and_units():
    model = driller()
    names, units = dyn.parameter_names(model), dyn.parameter_units(model)
    assert names[:10] == tuple(
        f"{k}_X" for k in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    )
    assert names[-5:] == ("Ja_X", "Ja_Y", "Ja_Z", "Ja_B", "Ja_C")
    assert units[:5] == ("kg", "kg·m", "kg·m", "kg·m", "kg·m²")
    assert units[-5:] == ("kg", "kg", "kg", "kg·m²", "kg·m²")
    assert len(names) == len(units) == len(dyn.parameters(model)) == 55


def test_massless_body():
    model = driller()
    pi = dyn.parameters(model)
    pi[:10] = 0.0
    pi[4] = 0.3
    np.testing.assert_allclose(dyn.parameters(dyn.with_parameters(model, pi)), pi, atol=1e-14)
    pi[1] = 1.0
    with pytest.raises(MachineError, match=r"joint 'X': first moments .* without mass"):
        dyn.with_parameters(model, pi)
    with pytest.raises(MachineError, match=r"pi has shape \(54,\), expected \(55,\)"):
        dyn.with_parameters(model, pi[:-1])


@pytest.mark.parametrize("seed", SEEDS)
def test_jacobian_against_finite_differences(seed):
    model, q, *_ = setup(seed, n=3)
    data, index, h = model.createData(), model.getFrameId("tool"), 1e-6

    def place(x):
        pin.forwardKinematics(model, data, x)
        return pin.updateFramePlacement(model, data, index).copy()

    local = dyn.jacobian(model, "tool", q)
    world = dyn.jacobian(model, "tool", q, world=True)
    R = dyn.frame_rotation(model, "tool", q)
    for k, qk in enumerate(q):
        np.testing.assert_allclose(R[k], place(qk).rotation, atol=1e-15)
        for j, step in enumerate(np.eye(model.nv) * h):
            there = place(qk - step).actInv(place(qk + step))
            np.testing.assert_allclose(local[k, :, j], pin.log6(there).vector / (2 * h), atol=1e-8)
            p = (place(qk + step).translation - place(qk - step).translation) / (2 * h)
            np.testing.assert_allclose(world[k, :3, j], p, atol=1e-8)
        np.testing.assert_allclose(world[k, 3:], R[k] @ local[k, 3:], atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_frame_motion_against_finite_differences(seed):
    model, q, v, a = setup(seed, n=4)
    h = 1e-5
    velocity = dyn.frame_velocity(model, "tool", q, v)
    np.testing.assert_allclose(
        velocity, np.einsum("nij,nj->ni", dyn.jacobian(model, "tool", q), v), atol=1e-12
    )

    def in_world(s):
        x, w = q + s * v + 0.5 * s * s * a, v + s * a
        R = dyn.frame_rotation(model, "tool", x)
        both = dyn.frame_velocity(model, "tool", x, w).reshape(-1, 2, 3)
        return np.einsum("nij,nkj->nki", R, both)

    change = (in_world(h) - in_world(-h)) / (2 * h)  # classical: derivative of the origin's velocity
    R = dyn.frame_rotation(model, "tool", q)
    expected = np.einsum("nji,nkj->nki", R, change).reshape(-1, 6)
    np.testing.assert_allclose(dyn.frame_acceleration(model, "tool", q, v, a), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_external_load(seed):
    model, q, v, a = setup(seed)
    rng = np.random.default_rng(seed)
    f = rng.normal(size=(len(q), 6)) * 10
    effort = dyn.external_effort(model, "tool", q, f)
    R = dyn.frame_rotation(model, "tool", q)
    both = np.einsum("nji,nkj->nki", R, f.reshape(-1, 2, 3)).reshape(-1, 6)
    power = np.sum(both * dyn.frame_velocity(model, "tool", q, v), axis=1)
    np.testing.assert_allclose(np.sum(effort * v, axis=1), power, atol=1e-10)
    # Pinocchio: tau = M a + c + g - J^T f, with the load given at the last joint
    data, tool = model.createData(), model.frames[model.getFrameId("tool")]
    load = pin.StdVec_Force([pin.Force.Zero()] * model.njoints)
    load[tool.parentJoint] = tool.placement.act(pin.Force(both[0]))
    tau = pin.rnea(model, data, q[0], v[0], a[0], load)
    np.testing.assert_allclose(dyn.inverse(model, q, v, a)[0] - effort[0], tau, atol=1e-10)


def test_frame_errors():
    model, q, *_ = setup(0)
    with pytest.raises(MachineError, match=r"no frame 'tol'; did you mean 'tool'\?"):
        dyn.jacobian(model, "tol", q)
    with pytest.raises(DataError, match=r"load on 'tool' has shape \(2, 6\), expected \(12, 6\)"):
        dyn.external_effort(model, "tool", q, np.zeros((2, 6)))


def test_pseudo_inertia_is_the_second_moment_of_the_mass():
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(5, 3)), rng.uniform(0.5, 2.0, 5)
    total = pin.Inertia.Zero()
    for w, r in zip(weights, points, strict=True):
        total = total + pin.Inertia(w, r, np.zeros((3, 3)))
    x = np.column_stack([points, np.ones(5)])
    np.testing.assert_allclose(pseudo_inertia(total.toDynamicParameters()), (x.T * weights) @ x, atol=1e-13)


def test_joints_out_of_depth_first_order():
    model = pin.Model()
    model.name = "fork"
    for parent, name in ((0, "a"), (0, "b"), (1, "c")):
        model.addJoint(parent, pin.JointModelRX(), pin.SE3.Identity(), name)
    with pytest.raises(MachineError, match="'fork': joint 'c' is not in depth-first order"):
        dyn.mass_matrix(model, np.zeros((1, 3)))


def test_one_axis():
    model = random_tree(np.random.default_rng(4), joints=1)
    q, v, a = motion(np.random.default_rng(4), model)
    J = dyn.jacobian(model, "j1", q)
    np.testing.assert_allclose(J[:, :, 0] * v, dyn.frame_velocity(model, "j1", q, v), atol=1e-14)
    tau = dyn.mass_matrix(model, q)[:, :, 0] * a + dyn.inverse(model, q, v, np.zeros_like(a))
    np.testing.assert_allclose(tau, dyn.inverse(model, q, v, a), atol=1e-12)
