"""A machine on a wall or a ceiling is the one on the floor with its URDF turned; friction stays in the model."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest
import yaml
from lxml import etree

import pinotwin as pt
from pinotwin.analysis.disturbance import split
from pinotwin.dynamics import inverse
from pinotwin.errors import MachineError
from pinotwin.export.inverse import default_speed, default_travel, inverse_of, sweep
from pinotwin.machine import Machine
from pinotwin.simulation import simulate
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.imu import record_imu
from tests.dynamics_models import random_tree
from tests.simulated import known_twin, smooth_command

TURNS = {
    "ceiling": pin.rpy.rpyToMatrix(np.pi, 0.0, 0.0),
    "wall": pin.rpy.rpyToMatrix(0.0, np.pi / 2.0, 0.0),
    "slope": pin.rpy.rpyToMatrix(0.3, -0.5, 1.1),
}
NAME = "laser_driller"


@pytest.fixture(params=TURNS)
def mounts(request, tmp_path):
    """One machine mounted by ``gravity`` of its machine.yaml, and by a URDF whose base is turned."""
    turn = TURNS[request.param]
    folders = []
    for kind in ("stated", "turned"):
        folder = Machine.load(NAME).save(tmp_path / kind).parent
        spec = yaml.safe_load((folder / "machine.yaml").read_text())
        if kind == "stated":
            spec["gravity"] = (turn.T @ [0.0, 0.0, -9.81]).tolist()
        else:
            path = folder / f"{NAME}.urdf"
            root = etree.parse(path).getroot()
            children = {j.find("child").get("link") for j in root.findall("joint")}
            (base,) = (link.get("name") for link in root.findall("link") if link.get("name") not in children)
            etree.SubElement(root, "link", name="building")
            joint = etree.SubElement(root, "joint", name="mount", type="fixed")
            rpy = " ".join(map(str, pin.rpy.matrixToRpy(turn)))
            etree.SubElement(joint, "origin", xyz="0 0 0", rpy=rpy)
            etree.SubElement(joint, "parent", link="building")
            etree.SubElement(joint, "child", link=base)
            path.write_bytes(etree.tostring(root))
        (folder / "machine.yaml").write_text(yaml.safe_dump(spec))
        folders.append(folder)
    return folders


def test_a_mounted_machine_is_the_turned_one(mounts):
    stated, turned = map(Machine.load, mounts)
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 20, stated.nv))
    wanted = inverse(turned.model, q, v, a)
    np.testing.assert_allclose(inverse(stated.model, q, v, a), wanted, atol=1e-9 * np.abs(wanted).max())
    plain = inverse(Machine.load(NAME).model, q, v, a)
    assert np.abs(plain - wanted).max() > 0.1 * np.abs(wanted).max()

    logs = []
    for folder in mounts:
        virtual = VirtualMachine.load(folder)
        truth = virtual.record(random_trajectory(virtual, 6.0, 3), seed=3)
        logs.append(truth.to_log())
    for channel in logs[0].channels:
        x, y = logs[0][channel], logs[1][channel]
        np.testing.assert_allclose(x, y, atol=1e-6 * np.abs(y).max())

    twins = [pt.identify(m, logs[0], loop=False) for m in (stated, turned)]
    efforts = [twin.effort(logs[0]) for twin in twins]
    np.testing.assert_allclose(*efforts, atol=1e-5 * np.abs(efforts[0]).max())
    assert pt.check(stated, logs[0]).as_dict()["ok"] == pt.check(turned, logs[0]).as_dict()["ok"]


def test_the_mount_goes_into_every_computation_and_file(mounts, tmp_path):
    stated, turned = map(Machine.load, mounts)
    twins = [known_twin(m) for m in (stated, turned)]
    command = smooth_command(stated, 3.0, 250.0)
    one, other = (simulate(twin, command) for twin in twins)
    for channel in one.channels:
        np.testing.assert_allclose(one[channel], other[channel], atol=1e-6 * np.abs(other[channel]).max())
    motion = sweep(stated, default_travel(stated), default_speed(stated), 1.0)
    weights = [split(twin, motion)["gravity"] for twin in twins]
    np.testing.assert_allclose(*weights, atol=1e-9 * np.abs(weights[0]).max())
    assert inverse_of(twins[0]).data["gravity"] == stated.model.gravity.linear.tolist()

    twins[0].save(tmp_path / "twin")
    again = pt.Twin.load(tmp_path / "twin")
    np.testing.assert_array_equal(again.model.gravity.linear, stated.model.gravity.linear)
    assert (
        json.loads((tmp_path / "twin" / "twin.json").read_text())["gravity"]
        == stated.model.gravity.linear.tolist()
    )
    pt.export(again, "mjcf", tmp_path / "m.xml")
    option = etree.parse(tmp_path / "m.xml").find("option")
    np.testing.assert_allclose([float(x) for x in option.get("gravity").split()], stated.model.gravity.linear)
    said = pt.export(again, "urdf", tmp_path / "m.urdf")
    assert any("no place for: " in line and "gravity [" in line for line in said.notes)


def test_an_imu_feels_the_mount(tmp_path):
    folder = Machine.load("trunnion").save(tmp_path).parent
    spec = yaml.safe_load((folder / "machine.yaml").read_text())
    forces = []
    for pull in ([0.0, 0.0, -9.81], [0.0, 0.0, 9.81]):
        (folder / "machine.yaml").write_text(yaml.safe_dump(spec | {"gravity": pull}))
        virtual = VirtualMachine.load(folder)
        recording = virtual.record(
            random_trajectory(virtual, 2.0, 3), seed=3, truth_rate=virtual.truth.control_rate
        )
        log = record_imu(recording.truth, "C_link", 1, 1)
        forces.append([log[f"a{x}"][0] for x in "xyz"])
    up, down = np.array(forces)
    np.testing.assert_allclose(up, -down, atol=0.5)
    assert np.linalg.norm(up - down) > 19.0


def test_a_model_keeps_its_gravity_damping_and_friction(tmp_path):
    model = random_tree(np.random.default_rng(1), joints=3)
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    model.damping, model.upperDryFrictionLimit = np.array([1.0, 0.0, 3.0]), np.array([0.5, 0.0, 0.25])
    machine = Machine.from_model(model)
    again = Machine.load(machine.save(tmp_path))
    order = [model.idx_vs[model.getJointId(n)] for n in machine.names]
    for made in (machine, again):
        np.testing.assert_array_equal(made.model.gravity.linear, [0.0, -9.81, 0.0])
        np.testing.assert_array_equal(made.model.damping, model.damping[order])
        np.testing.assert_array_equal(made.model.upperDryFrictionLimit, model.upperDryFrictionLimit[order])
    q, v, a = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 9, 3))
    data = model.createData()
    turned = [x[:, np.argsort(order)] for x in (q, v, a)]
    wanted = np.array([pin.rnea(model, data, *row) for row in zip(*turned, strict=True)])[:, order]
    np.testing.assert_allclose(inverse(machine.model, q, v, a), wanted, atol=1e-9 * np.abs(wanted).max())


def test_gravity_that_is_no_vector_is_refused(tmp_path):
    folder = Machine.load("emps").save(tmp_path).parent
    text = (folder / "machine.yaml").read_text()
    for given, said in [
        ("down", r"gravity: expected \[x, y, z\] in m/s²"),
        ("[0, -9.81]", r"gravity: expected \[x, y, z\] in m/s²"),
        ("[0, 0, down]", r"gravity: expected \[x, y, z\] in m/s²"),
    ]:
        (folder / "machine.yaml").write_text(f"gravity: {given}\n{text}")
        with pytest.raises(MachineError, match=said):
            Machine.load(folder)
    (folder / "machine.yaml").write_text(f"gravty: [0, 0, 0]\n{text}")
    with pytest.raises(MachineError, match="did you mean 'gravity'"):
        Machine.load(folder)


def with_friction(machine: Machine, effects: list[str]) -> pt.Twin:
    """A twin whose every axis has these effects, with coefficients of 1, 2, ..."""
    from pinotwin.machine.effect_list import make_effects

    for name, axis in machine.axes.items():
        machine = machine.with_effects(name, make_effects(effects, name, axis.rotary, f"axes.{name}."))
    twin = known_twin(machine)
    theta = twin.theta.copy()
    for effect, s in zip(twin.effects, twin.slices, strict=True):
        if effect.axis is not None:
            theta[s] = 1.0 + np.arange(s.stop - s.start)
    return dataclasses.replace(twin, theta=theta)


def test_the_model_of_a_twin_has_damping_friction_and_armature():
    machine = Machine.load("laser_driller")
    for effects, upper, lower in [
        (["viscous", "coulomb"], 1.0, -1.0),
        (["viscous", "coulomb", "stribeck"], 1.0, -1.0),
        (["viscous", "coulomb_asymmetric"], 1.0, -2.0),
        (["viscous"], 0.0, 0.0),
    ]:
        twin = with_friction(machine, effects)
        np.testing.assert_allclose(twin.model.damping, 1.0, atol=1e-12)
        np.testing.assert_allclose(twin.model.upperDryFrictionLimit, upper, atol=1e-12)
        np.testing.assert_allclose(twin.model.lowerDryFrictionLimit, lower, atol=1e-12)
        np.testing.assert_array_equal(twin.model.armature, twin.pi[-machine.nv :])


def test_friction_of_the_model_is_counted_once(tmp_path):
    """Pinocchio, our regressor and a twin say the same whether or not the URDF states friction."""
    plain = Machine.load("laser_driller")
    rough = plain.model.copy()
    rough.damping, rough.upperDryFrictionLimit = np.full(plain.nv, 40.0), np.full(plain.nv, 70.0)
    stated = Machine.from_model(rough)
    assert set(stated.model.damping) == {40.0}
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 20, plain.nv))
    smooth = Machine.from_model(plain.model)
    np.testing.assert_array_equal(inverse(stated.model, q, v, a), inverse(smooth.model, q, v, a))
    np.testing.assert_array_equal(
        stated.base.regressor(stated.model, q, v, a), smooth.base.regressor(smooth.model, q, v, a)
    )
    one, other = known_twin(stated), known_twin(smooth)
    np.testing.assert_array_equal(one.predict(q, v, a), other.predict(q, v, a))
    np.testing.assert_array_equal(one.model.damping, other.model.damping)
    model = other.model.copy()
    model.damping, model.upperDryFrictionLimit = np.zeros(plain.nv), np.zeros(plain.nv)
    np.testing.assert_array_equal(inverse(other.model, q, v, a), inverse(model, q, v, a))
