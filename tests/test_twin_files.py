"""A twin on disk: the same after reading, and its URDF gives the same efforts in Pinocchio and MuJoCo."""

from __future__ import annotations

import dataclasses
import json

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.errors import InputError, TwinError
from pinotwin.identification.judge import warnings
from pinotwin.twin.files import _digest
from pinotwin.virtual import VirtualMachine, random_trajectory


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    virtual = VirtualMachine.load(pt.machines()["laser_driller"])
    log = virtual.record(random_trajectory(virtual, 8.0, 3), seed=3).to_log()
    twin = pt.identify(pt.Machine.load("laser_driller"), log, loop=False)
    folder = tmp_path_factory.mktemp("twin")
    twin.save(folder)
    return twin, log, folder


def test_reading_it_again_gives_the_same_efforts_and_table(saved):
    twin, log, folder = saved
    again = pt.Twin.load(folder)
    motion = twin.motion(log).cut(100, 1100)
    np.testing.assert_allclose(again.effort(motion), twin.effort(motion), rtol=1e-12, atol=1e-9)
    assert [row.name for row in again.parameters] == [row.name for row in twin.parameters]
    assert again.machine.axis("Z").rotor_inertia == pytest.approx(twin.model.armature[2])


def test_pinocchio_gets_the_twins_rigid_body_efforts_from_the_urdf(saved):
    twin, log, folder = saved
    model = pt.Machine.load(folder).model
    motion = twin.motion(log)
    rigid = twin.parts(motion)["rigid_body"]
    data = model.createData()
    for k in range(200, len(motion), 311):
        tau = pin.rnea(model, data, motion.q[k], motion.v[k], motion.a[k])
        np.testing.assert_allclose(tau, rigid[k], atol=1e-6 * np.abs(rigid).max())


def test_mujoco_gets_them_too(saved):
    twin, log, folder = saved
    text = (folder / "laser_driller.urdf").read_text()
    settings = '<mujoco><compiler fusestatic="true" balanceinertia="false" discardvisual="true"/></mujoco>'
    head = text.index(">", text.index("<robot")) + 1
    model = mujoco.MjModel.from_xml_string(text[:head] + settings + text[head:])
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.opt.gravity[:] = (0.0, 0.0, -9.81)
    data = mujoco.MjData(model)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, j) for j in range(model.njnt)]
    place = [names.index(name) for name in twin.machine.names]
    model.dof_armature[place] = twin.model.armature
    motion = twin.motion(log)
    rigid = twin.parts(motion)["rigid_body"]
    for k in range(200, len(motion), 311):
        data.qpos[place], data.qvel[place] = motion.q[k], motion.v[k]
        data.qacc[place] = motion.a[k]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(data.qfrc_inverse[place], rigid[k], atol=1e-6 * np.abs(rigid).max())


def test_every_number_has_unit_error_and_verdict(saved):
    _, _, folder = saved
    content = json.loads((folder / "twin.json").read_text())
    assert content["schema"] == "pinotwin.twin/2"
    for row in content["parameters"]:
        assert row["unit"]
        assert row["verdict"]
        assert row["determined"] == (row["standard_error"] is not None)


def test_a_damaged_twin_is_refused_in_one_line(saved, tmp_path):
    _, _, folder = saved
    for name in ("machine.yaml", "laser_driller.urdf"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "twin.json").write_text('{"schema": "pinotwin.twin/0"}')
    with pytest.raises(TwinError, match="identify again"):
        pt.Twin.load(tmp_path)


def test_files_of_another_run_and_edits_are_refused(tmp_path, saved):
    """A twin is its three files together; only what a log calls its channels may be edited."""
    twin = saved[0]
    name = f"{twin.machine.name}.urdf"

    def loaded_after(change):
        folder = tmp_path / f"t{len(list(tmp_path.iterdir()))}"
        twin.save(folder)
        change(folder)
        return pt.Twin.load(folder)

    def replaced(file, old, new):
        def change(folder):
            text = (folder / file).read_text()
            assert old in text
            (folder / file).write_text(text.replace(old, new, 1))

        return change

    loaded_after(replaced("machine.yaml", "axes:", "columns: {t: Time}\naxes:"))
    for change, said in [
        (replaced(name, "</robot>", "<!-- of another run --></robot>"), rf"{name}: is not the one"),
        (replaced("machine.yaml", "viscous", "quadratic_drag"), r"machine\.yaml: is not the one"),
        (replaced("twin.json", '"value": ', '"value": 1'), r"twin\.json: damaged twin \(changed"),
        (replaced("twin.json", '"schema"', '"x": ' + 5000 * "9" + ', "schema"'), r"not valid JSON"),
    ]:
        with pytest.raises(TwinError, match=said):
            loaded_after(change)


def test_a_file_that_was_deleted_is_missed(saved, tmp_path):
    twin, _, folder = saved
    files = json.loads((folder / "twin.json").read_text())["files"]
    assert {"misfit.npz", "covariance.npz"} <= set(files)
    for name in files:
        twin.save(tmp_path / name)
        (tmp_path / name / name).unlink()
        with pytest.raises(
            InputError, match=rf"{name}: (is missing; put it back|no such URDF|.*found: )|no machine.yaml"
        ):
            pt.Twin.load(tmp_path / name)


def test_a_twin_with_its_covariance_written_out_is_read(saved, tmp_path):
    """As twin.json had it until 0.2."""
    twin, _, folder = saved
    twin.save(tmp_path / "old")
    (tmp_path / "old" / "covariance.npz").unlink()
    path = tmp_path / "old" / "twin.json"
    content = json.loads(path.read_text())
    del content["files"]["covariance.npz"]
    content["covariance_lower"] = [row[: k + 1] for k, row in enumerate(twin.covariance.tolist())]
    content["digest"] = _digest(content)
    path.write_text(json.dumps(content))
    again = [pt.Twin.load(place).covariance for place in (tmp_path / "old", folder)]
    np.testing.assert_array_equal(*again)


def test_twin_json_holds_no_large_matrix(saved):
    twin, _, folder = saved
    content = json.loads((folder / "twin.json").read_text())
    assert content["covariance_lower"] == {"file": "covariance.npz", "array": "lower"}
    rows = [len(value) for value in content.values() if isinstance(value, list)]
    assert max(rows) <= max(len(twin.parameters), len(twin.pi))


def test_a_twin_of_impossible_inertias_can_be_loaded(saved, tmp_path):
    """``--inconsistent``: a URDF has no place for a negative mass, twin.json has."""
    twin, log, _ = saved
    pi = twin.pi.copy()
    pi[0] = -abs(pi[0])
    theta = np.r_[twin.machine.base.P @ pi, twin.theta[len(twin.machine.base.P) :]]
    odd = dataclasses.replace(twin, theta=theta, pi=pi, quality={**twin.quality, "consistency": None})
    odd.save(tmp_path / "odd")
    again = pt.Twin.load(tmp_path / "odd")
    np.testing.assert_allclose(again.pi, pi)
    np.testing.assert_allclose(again.effort(log), odd.effort(log), rtol=1e-12, atol=1e-9)
    described, kept = (m.inertias[1] for m in (twin.machine.model, again.machine.model))
    assert kept.isApprox(described, 1e-9)
    assert [
        w
        for w in warnings(twin.quality, odd, twin.motion(log))
        if "inertias that were found are impossible" in w
    ]
    assert not [w for w in warnings(twin.quality, twin, twin.motion(log)) if "impossible" in w]


WRONG = {
    "theta": ["x"],
    "effects": [{}],
    "parameters": [{"name": 1, "value": [], "standard_error": None}],
    "standard_inertial_parameters": None,
    "loops": [],
    "servos": {"Z": {"gains": "x"}},
    "diagonal": 1.0,
    "quality": None,
    "not_separable": [1],
    "data": "x",
    "settings": {"cutoff": "x"},
    "files": None,
    "misfit": True,
    "covariance_lower": {"file": 1},
}


@pytest.mark.parametrize("key", WRONG)
def test_a_value_of_another_type_is_one_line_whatever_the_digest_says(saved, tmp_path, key):
    _, _, folder = saved
    content = json.loads((folder / "twin.json").read_text()) | {key: WRONG[key]}
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "twin.json").write_text(json.dumps(content | {"digest": _digest(content)}))
    with pytest.raises(TwinError, match=r"damaged twin .*; identify it again"):
        pt.Twin.load(tmp_path)


def _negative_mass(content, machine):
    beta = slice(0, len(machine.base.P))  # the rigid bodies are the first effect
    pi = np.array(content["standard_inertial_parameters"])
    pi[0] = -1.0
    content["standard_inertial_parameters"] = pi.tolist()
    content["theta"][beta] = (machine.base.P @ pi).tolist()


CHANGES = {
    r"\w+\.\w+\.\w+ is -[\d.e+-]+, outside 0 to inf": lambda c, _: c.update(theta=[-x for x in c["theta"]]),
    "a mass is negative": _negative_mass,
}


@pytest.mark.parametrize("said", CHANGES)
def test_coefficients_outside_physics_are_refused_whatever_the_digest_says(saved, tmp_path, said):
    twin, _, folder = saved
    content = json.loads((folder / "twin.json").read_text())
    CHANGES[said](content, twin.machine)
    twin.save(tmp_path / "edited")
    (tmp_path / "edited" / "twin.json").write_text(json.dumps(content | {"digest": _digest(content)}))
    with pytest.raises(TwinError, match=rf"damaged twin \({said}"):
        pt.Twin.load(tmp_path / "edited")
