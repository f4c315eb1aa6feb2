"""The regressor of whole logs against Pinocchio, sample by sample."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from pinotwin.dynamics import parameters, regressor, regressor_blocks, regressor_loop
from pinotwin.dynamics.plan import plan_columns
from pinotwin.dynamics.tree import tree
from pinotwin.errors import DataError, MachineError
from tests.dynamics_models import PANDA, UR10, driller, motion, random_tree, robot


def oracle(model, q, v, a):
    """W by Pinocchio alone, rotor inertia appended."""
    data = model.createData()
    rows = [pin.computeJointTorqueRegressor(model, data, *x) for x in zip(q, v, a, strict=True)]
    rotor = [np.diag(x) for x in a]
    flat = np.array(rows).reshape(len(q), model.nv, -1)  # Pinocchio drops the axis if nv is 1
    return np.concatenate([flat, np.array(rotor)], axis=2)


def rnea(model, q, v, a):
    data = model.createData()
    return np.array([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])


@pytest.mark.parametrize("seed", range(25))
def test_random_trees(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, joints=int(rng.integers(1, 9)))
    q, v, a = motion(rng, model)
    W = regressor(model, q, v, a)
    expected = oracle(model, q, v, a)
    np.testing.assert_allclose(W, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    tau = rnea(model, q, v, a)
    np.testing.assert_allclose(W @ parameters(model), tau, atol=1e-12 * np.abs(tau).max())


@pytest.mark.parametrize("make", [driller, lambda: robot(UR10), lambda: robot(PANDA)])
def test_machines(make):
    model = make()
    q, v, a = motion(np.random.default_rng(3), model)
    expected = oracle(model, q, v, a)
    W = regressor(model, q, v, a)
    np.testing.assert_allclose(W, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("n", [0, 1, 7, 8, 127, 128, 129, 300])
def test_any_length(n):
    model = driller()
    q, v, a = motion(np.random.default_rng(n), model, n)
    W = regressor(model, q, v, a)
    assert W.shape == (n, 5, 55)
    np.testing.assert_allclose(W, regressor_loop(model, q, v, a), rtol=0, atol=1e-12)


def test_gravity_in_any_direction():
    rng = np.random.default_rng(8)
    model = random_tree(rng)
    model.gravity.linear = np.array([1.0, -2.0, 3.0])
    q, v, a = motion(rng, model)
    np.testing.assert_allclose(regressor(model, q, v, a), oracle(model, q, v, a), rtol=0, atol=1e-12)


@pytest.mark.parametrize("columns", [[], [54], [3, 50, 3], [49, 0, 54, 20]])
def test_columns_are_those_of_the_full_matrix(columns):
    model = driller()
    q, v, a = motion(np.random.default_rng(1), model)
    columns = np.array(columns, dtype=np.intp)
    full = regressor(model, q, v, a)
    np.testing.assert_array_equal(regressor(model, q, v, a, columns), full[:, :, columns])


def test_blocks_are_the_whole():
    model = random_tree(np.random.default_rng(2))
    q, v, a = motion(np.random.default_rng(2), model, 50)
    whole = regressor(model, q, v, a)
    parts = list(regressor_blocks(model, q, v, a, block=16))
    assert [rows for rows, _ in parts] == [
        slice(0, 16),
        slice(16, 32),
        slice(32, 48),
        slice(48, 50),
    ]
    np.testing.assert_allclose(np.concatenate([W for _, W in parts]), whole, rtol=0, atol=1e-13)


def odd_model():
    """A screw joint and a three-axis slide between ordinary joints: left to Pinocchio."""
    model = random_tree(np.random.default_rng(5), joints=3)
    for joint in (pin.JointModelHX(0.1), pin.JointModelTranslation()):
        i = model.addJoint(model.njoints - 1, joint, pin.SE3.Random(), f"odd{model.njoints}")
        model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature = np.linspace(0.1, 0.7, model.nv)
    return model


def test_unusual_joints_fall_back():
    model = odd_model()
    assert tree(model) is None
    q, v, a = motion(np.random.default_rng(5), model)
    tau = rnea(model, q, v, a)
    np.testing.assert_allclose(regressor(model, q, v, a) @ parameters(model), tau, atol=1e-11)
    parts = [W for _, W in regressor_blocks(model, q, v, a, np.array([0, 52]), block=8)]
    full = oracle(model, q, v, a)
    np.testing.assert_array_equal(np.concatenate(parts), full[:, :, [0, 52]])


def test_only_entries_that_can_differ_from_zero_are_computed():
    # 31 of the 250 entries of the five-axis machine: a slide knows no centre of mass.
    plan = plan_columns(tree(driller()), np.arange(50))
    assert len(plan.entries) == 31


def test_continuous_joints_are_refused_with_a_remedy():
    model = pin.Model()
    model.name = "lathe"
    model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "C")
    zero = np.zeros((3, 1))
    with pytest.raises(MachineError) as error:
        regressor(model, zero, zero, zero)
    assert str(error.value) == (
        "machine 'lathe': joints ['C'] have nq != nv; rewrite 'continuous' as 'revolute' with wide "
        "limits, and lock or remove floating, planar and spherical joints"
    )


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        ((4,), "v has shape (4,), expected (n, 5)"),
        ((4, 3), "v has shape (4, 3), expected (n, 5)"),
        ((3, 5), "v has 3 rows but q has 4"),
    ],
)
def test_bad_shapes(shape, text):
    q = np.zeros((4, 5))
    with pytest.raises(DataError) as error:
        regressor(driller(), q, np.zeros(shape), q)
    assert str(error.value).startswith(text)


@pytest.mark.parametrize("columns", [[55], [-1], [[1, 2]]])
def test_bad_columns(columns):
    q = np.zeros((4, 5))
    with pytest.raises(DataError, match="columns must be indices from 0 to 54"):
        regressor(driller(), q, q, q, np.array(columns))


def test_numba_is_imported_only_when_needed():
    code = "import sys, pinotwin.dynamics; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
