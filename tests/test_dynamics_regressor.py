"""The regressor of whole logs: Pinocchio's own efforts for any parameters; shapes, columns, refusals."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from pinotwin.dynamics import regressor, with_parameters
from pinotwin.errors import DataError, MachineError
from tests.dynamics_models import PANDA, UR10, driller, motion, random_body, random_tree, robot


def rnea(model, q, v, a):
    data = model.createData()
    return np.array([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])


def assert_gives_the_efforts(model, seed, n=20):
    """W @ pi is Pinocchio's RNEA, also of other bodies on the same joints: every column is right."""
    rng = np.random.default_rng(seed)
    q, v, a = motion(rng, model, n)
    W = regressor(model, q, v, a)
    for _ in range(3):
        pi = np.concatenate(
            [*(random_body(rng).toDynamicParameters() for _ in model.names[1:]), rng.uniform(size=model.nv)]
        )
        tau = rnea(with_parameters(model, pi), q, v, a)
        np.testing.assert_allclose(W @ pi, tau, rtol=0, atol=1e-12 * np.abs(tau).max())


@pytest.mark.parametrize("seed", range(25))
def test_random_trees(seed):
    joints = int(np.random.default_rng(seed).integers(1, 9))
    assert_gives_the_efforts(random_tree(np.random.default_rng(seed), joints=joints), seed)


@pytest.mark.parametrize("make", [driller, lambda: robot(UR10), lambda: robot(PANDA)])
def test_machines(make):
    assert_gives_the_efforts(make(), 3)


def test_logs_longer_than_a_block():
    assert_gives_the_efforts(driller(), 0, n=2 * 1024 + 1)


def test_gravity_in_any_direction():
    model = random_tree(np.random.default_rng(8))
    model.gravity.linear = np.array([1.0, -2.0, 3.0])
    assert_gives_the_efforts(model, 8)


@pytest.mark.parametrize("columns", [[], [54], [3, 50, 3], [49, 0, 54, 20]])
def test_columns_are_those_of_the_full_matrix(columns):
    model = driller()
    q, v, a = motion(np.random.default_rng(1), model)
    columns = np.array(columns, dtype=np.intp)
    full = regressor(model, q, v, a)
    np.testing.assert_array_equal(regressor(model, q, v, a, columns), full[:, :, columns])


def odd_model():
    """A screw joint and a three-axis slide between ordinary joints."""
    model = random_tree(np.random.default_rng(5), joints=3)
    for joint in (pin.JointModelHX(0.1), pin.JointModelTranslation()):
        i = model.addJoint(model.njoints - 1, joint, pin.SE3.Random(), f"odd{model.njoints}")
        model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature = np.linspace(0.1, 0.7, model.nv)
    return model


def test_unusual_joints():
    assert_gives_the_efforts(odd_model(), 5)


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
