"""Base parameters: ranks and names of METHODS B2, published counts, identities on random trees."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from pinotwin.dynamics import (
    base_parameters,
    inverse,
    parameter_names,
    parameters,
    regressor,
)
from tests.dynamics_models import PANDA, UR10, driller, motion, random_tree, robot

DRILLER = {
    "m_X*": "m_X + m_Y + Ja_X",
    "m_Y*": "m_Y + Ja_Y",
    "Ja_Z": "Ja_Z",
    "m_Z*": "m_Z + m_B + m_C",
    "Iyy_B*": "Iyy_B + Ixx_C + 0.16 mz_C + 0.0064 m_C + Ja_B",
    "mx_B": "mx_B",
    "mz_B*": "mz_B + mz_C + 0.08 m_C",
    "Izz_C*": "Izz_C + Ja_C",
    "mx_C": "mx_C",
    "my_C": "my_C",
    "Iyy_C*": "-Ixx_C + Iyy_C",
    "Ixy_C": "Ixy_C",
    "Ixz_C": "Ixz_C",
    "Iyz_C": "Iyz_C",
}


def without(model, *joints):
    """The model with some joints locked."""
    ids = [model.getJointId(j) for j in joints]
    armature = [model.armature[model.joints[i].idx_v] for i in range(1, model.njoints) if i not in ids]
    reduced = pin.buildReducedModel(model, ids, pin.neutral(model))
    reduced.armature = np.array(armature)
    return reduced


def svd_rank(model):
    q, v, a = motion(np.random.default_rng(9), model, 150)
    W = regressor(model, q, v, a).reshape(-1, len(parameters(model)))
    size = np.linalg.norm(W, axis=0)
    s = np.linalg.svd(W[:, size > 1e-9] / size[size > 1e-9], compute_uv=False)
    return int(np.sum(s > 1e-6 * s[0]))


def test_driller_names():
    base = base_parameters(driller())
    assert dict(zip(base.labels, base.names, strict=True)) == DRILLER
    assert base.units[:5] == ("kg", "kg", "kg", "kg", "kg·m²")
    assert {"mz_X", "mx_Z", "my_B", "Izz_B"} <= set(base.without_effect)
    assert "m_C" not in base.without_effect


def test_driller_with_the_table_off_the_tilting_axis():
    base = base_parameters(driller(a=0.03))
    assert len(base) == 14
    assert "mx_B + 0.03 m_C" in base.names
    assert "Iyy_B + Ixx_C + 0.16 mz_C + 0.0073 m_C + Ja_B" in base.names


def test_total_mass_of_the_vertical_axis_is_a_sum_of_base_parameters():
    model = driller()
    base, names = base_parameters(model), list(parameter_names(model))
    total = np.zeros(55)
    total[[names.index(k) for k in ("m_Z", "m_B", "m_C", "Ja_Z")]] = 1.0
    rows = base.P[[base.labels.index(k) for k in ("m_Z*", "Ja_Z")]]
    np.testing.assert_array_equal(rows.sum(axis=0), total)


def test_ranks_of_the_driller():
    table = without(driller(), "X", "Y")
    assert len(base_parameters(table)) == 12
    nutating = driller()
    nutating.jointPlacements[4].rotation = pin.rpy.rpyToMatrix(np.pi / 4, 0.0, 0.0)
    nutating.jointPlacements[5].rotation = pin.rpy.rpyToMatrix(-np.pi / 4, 0.0, 0.0)
    base = base_parameters(nutating)
    assert len(base) == 15
    assert {"Ja_C", "Ja_B"} <= {w for name in base.names for w in name.split()}
    assert not any("Izz_C" in n and "Ja_C" in n for n in base.names)


@pytest.mark.parametrize(("path", "rigid"), [(UR10, 36), (PANDA, 43)])
def test_robots(path, rigid):
    # 36: any six-axis arm on a vertical axis; 43: Gaz et al. 2019, doi:10.1109/LRA.2019.2931248
    model = robot(path)
    base = base_parameters(model)
    separate = [k for k in base.labels if k.startswith("Ja")]
    assert len(base) - len(separate) == rigid
    assert len(base) == svd_rank(model)
    check_identities(model, base, np.random.default_rng(0))


def check_identities(model, base, rng):
    q, v, a = motion(rng, model)
    tau = inverse(model, q, v, a)
    W = base.regressor(model, q, v, a)
    assert W.shape == (len(q), model.nv, len(base))
    scale = np.abs(tau).max()
    np.testing.assert_allclose(W @ base.from_standard(parameters(model)), tau, atol=1e-10 * scale)
    full = regressor(model, q, v, a)
    np.testing.assert_allclose(W @ base.P, full, atol=1e-10 * np.abs(full).max())
    np.testing.assert_array_equal(base.P[:, base.independent], np.eye(len(base)))
    # clean: what is not zero is a number of the geometry, not rounding
    assert np.abs(base.P[base.P != 0]).min() > 1e-9
    assert len(set(base.labels)) == len(set(base.names)) == len(base)


@pytest.mark.parametrize("seed", range(20))
def test_random_trees(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, joints=int(rng.integers(1, 8)))
    base = base_parameters(model)
    assert len(base) == svd_rank(model)
    check_identities(model, base, rng)
    other = base_parameters(model, seed=seed + 1)
    np.testing.assert_array_equal(other.independent, base.independent)
    np.testing.assert_allclose(other.P, base.P, atol=1e-9 * np.abs(base.P).max())


def test_distal_parameters_regroup_into_proximal_ones():
    base = base_parameters(robot(UR10))
    kept = np.array(parameter_names(robot(UR10)))[base.independent]
    assert not any(name.startswith(("m_", "mz_wrist_2")) for name in kept)


def test_angles_written_with_four_decimals_do_not_add_parameters():
    def arm(angle):
        model = pin.Model()
        for i, x in enumerate((0.0, angle, angle)):
            place = pin.SE3(pin.rpy.rpyToMatrix(x, 0.0, 0.0), np.array([0.0, 0.0, 0.4]))
            model.addJoint(i, pin.JointModelRZ(), place, f"j{i + 1}")
        return base_parameters(model)

    exact, rounded = arm(np.pi / 2), arm(1.5708)
    assert len(rounded) == len(exact)
    assert rounded.labels == exact.labels
    assert rounded.names == exact.names
