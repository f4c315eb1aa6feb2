"""Every bundled machine loads in Pinocchio, MuJoCo and yourdfpy, which see the same machine."""

from __future__ import annotations

import csv
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml
import yourdfpy
from lxml import etree

# name -> joints in Pinocchio's order
MACHINES = {
    "laser_driller": ["X", "Y", "Z", "B", "C"],
    "trunnion": ["Y", "A", "C"],
    "flexure_rig": ["Y", "delta", "A", "C"],
    "emps": ["X"],
    "tx40": ["J1", "J2", "J3", "J4", "J5", "J6"],
}
TOP_KEYS = {"data", "name", "urdf", "axes", "passive", "imus", "loop", "columns", "transmission", "meshes"}
AXIS_KEYS = {"joint", "effects", "rotor_inertia", "effort_limit", "zero"}

every_machine = pytest.mark.parametrize("name", MACHINES)


def urdf_of(urdf_dir: Path, name: str) -> Path:
    return urdf_dir / name / f"{name}.urdf"


def settings(urdf_dir: Path, name: str) -> dict:
    return yaml.safe_load((urdf_dir / name / "machine.yaml").read_text(encoding="utf-8"))


@every_machine
def test_pinocchio_sees_the_axes_with_their_limits(urdf_dir: Path, name: str) -> None:
    model = pin.buildModelFromUrdf(str(urdf_of(urdf_dir, name)))
    assert list(model.names)[1:] == MACHINES[name]
    assert model.nq == model.nv == len(MACHINES[name])
    for limit in (model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit):
        assert np.all(np.isfinite(limit))
    assert np.all(model.lowerPositionLimit < 0)
    assert np.all(model.upperPositionLimit > 0)
    assert np.all(model.effortLimit > 0)
    links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
    assert {f"{axis}_link" for axis in MACHINES[name]} <= set(links)


@every_machine
def test_every_inertial_could_be_a_real_body(urdf_dir: Path, name: str) -> None:
    model = pin.buildModelFromUrdf(str(urdf_of(urdf_dir, name)))
    for joint, inertia in zip(list(model.names)[1:], list(model.inertias)[1:], strict=True):
        pseudo = pin.PseudoInertia.FromInertia(inertia).toMatrix()
        assert np.linalg.eigvalsh(pseudo)[0] > 0, joint


@every_machine
def test_mujoco_has_the_same_inverse_dynamics(urdf_dir: Path, name: str) -> None:
    path = urdf_of(urdf_dir, name)
    model = pin.buildModelFromUrdf(str(path))
    other = mujoco.MjModel.from_xml_path(str(path))
    names = [other.joint(i).name for i in range(other.njnt)]
    order = [names.index(joint) for joint in MACHINES[name]]
    other.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    other.dof_damping[:] = 0.0
    rng = np.random.default_rng(1)
    state = mujoco.MjData(other)
    for _ in range(5):
        q, v, a = (rng.uniform(-1.5, 1.5, size=model.nv) for _ in range(3))
        state.qpos[order], state.qvel[order], state.qacc[order] = q, v, a
        mujoco.mj_inverse(other, state)
        expected = state.qfrc_inverse[order]
        tau = pin.rnea(model, model.createData(), q, v, a)
        np.testing.assert_allclose(tau, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


@every_machine
def test_yourdfpy_sees_the_same_kinematics(urdf_dir: Path, name: str) -> None:
    path = urdf_of(urdf_dir, name)
    robot = yourdfpy.URDF.load(str(path))
    assert robot.validate()
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    q = np.random.default_rng(2).uniform(-0.5, 0.5, size=model.nq)
    robot.update_cfg(dict(zip(MACHINES[name], q, strict=True)))
    pin.framesForwardKinematics(model, data, q)
    for frame_id, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.BODY:
            pose = robot.get_transform(frame.name, robot.base_link)
            np.testing.assert_allclose(pose, data.oMf[frame_id].homogeneous, atol=1e-12)


@every_machine
def test_machine_yaml_follows_the_contract(urdf_dir: Path, name: str) -> None:
    spec = settings(urdf_dir, name)
    model = pin.buildModelFromUrdf(str(urdf_of(urdf_dir, name)))
    assert spec["name"] == name
    assert spec["urdf"] == f"{name}.urdf"
    assert set(spec) <= TOP_KEYS
    passive = set(spec.get("passive", {}))
    assert [*spec["axes"]] == [j for j in MACHINES[name] if j not in passive]
    for axis, entry in spec["axes"].items():
        assert set(entry) <= AXIS_KEYS
        assert entry["joint"] == axis
        assert entry["effects"]
        limit = model.effortLimit[model.joints[model.getJointId(axis)].idx_v]
        assert entry["effort_limit"] == limit
        assert entry.get("rotor_inertia", 0.0) >= 0
    for imu in spec.get("imus", {}).values():
        assert model.existFrame(imu["link"])


@every_machine
def test_shapes_are_primitives_with_named_materials(urdf_dir: Path, name: str) -> None:
    tree = etree.parse(str(urdf_of(urdf_dir, name)))
    defined = {m.get("name") for m in tree.getroot().findall("material")}
    visuals = tree.findall(".//visual")
    assert len(visuals) >= 15
    assert not tree.findall(".//mesh")
    assert {v.find("material").get("name") for v in visuals} == defined
    for joint in MACHINES[name]:
        assert tree.findall(f".//link[@name='{joint}_link']/visual"), f"{joint} carries nothing visible"


def test_the_driller_makes_every_base_parameter_felt(urdf_dir: Path) -> None:
    """Each group of Eq. 3.4 to 3.6 that the workpiece brings is clearly different from zero."""
    model = pin.buildModelFromUrdf(str(urdf_of(urdf_dir, "laser_driller")))
    m, mx, my, mz, ixx, ixy, iyy, ixz, iyz, izz = model.inertias[5].toDynamicParameters()
    groups = {
        "mx": mx,
        "my": my,
        "mz": mz,
        "ixy": ixy,
        "ixz": ixz,
        "iyz": iyz,
        "d": iyy - ixx,
        "izz": izz,
    }
    scale = {"mx": m, "my": m, "mz": m}
    for group, value in groups.items():
        assert abs(value) > 4e-3 * scale.get(group, izz), group


def test_tx40_reaches_its_published_points(urdf_dir: Path) -> None:
    """Upright at q2 = -90°, q3 = +90°: wrist at 0.320 + 0.225 + 0.225 m, flange 0.065 m above."""
    model = pin.buildModelFromUrdf(str(urdf_of(urdf_dir, "tx40")))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0]))
    flange = data.oMf[model.getFrameId("flange")]
    np.testing.assert_allclose(flange.translation, [0, 0.035, 0.835], atol=1e-12)
    np.testing.assert_allclose(flange.rotation[:, 2], [0, 0, 1], atol=1e-12)


def test_tx40_log_lies_inside_the_limits(urdf_dir: Path, data_dir: Path) -> None:
    """The transmission and the zeros of the YAML turn the motor log into joint angles that fit."""
    spec = settings(urdf_dir, "tx40")
    joints = MACHINES["tx40"]
    ratios = np.array([[spec["transmission"][i].get(j, 0.0) for j in joints] for i in joints])
    zero = np.array([spec["axes"][j].get("zero", 0.0) for j in joints])
    with (data_dir / "staubli_tx40" / "pos_read_data.csv").open() as file:
        rows = [[float(x) for x in row] for k, row in enumerate(csv.reader(file)) if k and k % 10 == 0]
    q = np.linalg.solve(ratios, np.array(rows).T).T + zero
    model = pin.buildModelFromUrdf(str(urdf_of(urdf_dir, "tx40")))
    assert np.all(q.min(axis=0) > model.lowerPositionLimit)
    assert np.all(q.max(axis=0) < model.upperPositionLimit)
