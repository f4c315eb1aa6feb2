"""Machine: machine.yaml and back, names, URDF joints that are no axes, saving with meshes."""

from __future__ import annotations

import dataclasses
import json
import runpy
from pathlib import Path

import jsonschema
import numpy as np
import pinocchio as pin
import pytest
import yaml

import pinotwin as pt
from pinotwin.columns import bind
from pinotwin.errors import MachineError, nearest
from pinotwin.log import Log
from pinotwin.machine import Machine, machines
from pinotwin.machine.effect_list import make_effects
from pinotwin.machine.loading import machine_spec
from pinotwin.machine.yaml_file import read_yaml
from tests.conftest import ROOT
from tests.rig import URDF, YAML, good_log, write_machine

FOLDERS = {
    **machines(),
    **{p.parent.name: p.parent for p in ROOT.glob("examples/machines/*/machine.yaml")},
}


@pytest.fixture(params=sorted(FOLDERS))
def machine(request: pytest.FixtureRequest) -> Machine:
    return Machine.load(FOLDERS[request.param])


def assert_same_model(a: pin.Model, b: pin.Model) -> None:
    assert list(a.names) == list(b.names)
    assert list(a.parents) == list(b.parents)
    for one, other in zip(a.inertias, b.inertias, strict=True):
        assert one.isApprox(other, 1e-12)
    for one, other in zip(a.jointPlacements, b.jointPlacements, strict=True):
        assert one.isApprox(other, 1e-12)
    for name in ("armature", "lowerPositionLimit", "upperPositionLimit", "upperVelocityLimit"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def assert_same_machine(a: Machine, b: Machine) -> None:
    assert_same_model(a.model, b.model)
    for field in ("name", "axes", "passive", "imus", "loop", "columns", "data", "effects", "names"):
        one, other = getattr(a, field), getattr(b, field)
        if field == "effects":  # the rigid body holds the model, compared above
            one, other = one[1:], other[1:]
        assert one == other, field
    np.testing.assert_array_equal(a.transmission, b.transmission)


def test_load_save_load_is_the_same_machine(machine: Machine, tmp_path: Path) -> None:
    path = machine.save(tmp_path / "copy")
    again = Machine.load(path)
    assert_same_machine(machine, again)
    assert machine_spec(machine) == machine_spec(again)
    assert again.save(tmp_path / "copy") == path  # onto itself
    assert_same_machine(machine, Machine.load(tmp_path / "copy"))


def test_what_was_changed_in_python_is_saved(tmp_path: Path) -> None:
    machine = Machine.load(write_machine(tmp_path / "rig"))
    axis = dataclasses.replace(machine.axes["B"], zero=0.25, effort_limit=3.0, min_speed=0.01)
    other = dataclasses.replace(machine, axes={**machine.axes, "B": axis})
    other = other.with_effects("X", machine.axes["X"].effects[:1])
    other.save(tmp_path / "copy")
    again = Machine.load(tmp_path / "copy")
    assert again.axes == other.axes
    assert [effect.name for effect in again.axes["X"].effects] == ["viscous"]


def test_axis_names_are_not_joint_names(tmp_path: Path) -> None:
    swapped = "name: rig\nurdf: rig.urdf\naxes:\n  B: {joint: jx}\n  X: {joint: jb}\n"
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=swapped))
    assert machine.names == ("B", "X")  # the model's order: jx carries jb
    assert machine.axes["B"].rotary is False
    assert machine.axes["X"].rotary is True
    assert machine.axes["X"].joint == "jb"
    machine.save(tmp_path / "copy")
    assert Machine.load(tmp_path / "copy").names == ("B", "X")


def test_order_of_the_yaml_does_not_matter_to_the_model(tmp_path: Path) -> None:
    turned = "name: rig\nurdf: rig.urdf\naxes:\n  B: {joint: jb}\n  X: {joint: jx}\n"
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=turned))
    assert list(machine.axes) == ["B", "X"]
    assert machine.names == ("X", "B")
    assert [machine.axes[name].index for name in ("X", "B")] == [0, 1]


def test_columns_are_kept_and_used(tmp_path: Path) -> None:
    mapped = YAML + 'columns:\n  t: {column: Zeit, unit: ms}\n  X.q: {column: "Ist X", unit: mm}\n'
    Machine.load(write_machine(tmp_path / "rig", yaml=mapped)).save(tmp_path / "copy")
    machine = Machine.load(tmp_path / "copy")
    good = good_log()
    raw = Log({"Zeit": good["t"] * 1e3, "Ist X": good["X.q"] * 1e3, "B.q": good["B.q"]})
    bound = bind(raw, machine.columns)
    np.testing.assert_allclose(bound["X.q"], good["X.q"], atol=1e-12)
    np.testing.assert_allclose(bound.t, good["t"], atol=1e-12)


def test_yaml_words_that_look_like_truth_values_stay_names(tmp_path: Path) -> None:
    text = "name: on\nurdf: rig.urdf\naxes:\n  y: {joint: jx}\n  no: {joint: jb}\n"
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=text))
    assert machine.name == "on"
    assert list(machine.axes) == ["y", "no"]
    machine.save(tmp_path / "copy")
    assert list(Machine.load(tmp_path / "copy").axes) == ["y", "no"]


def test_joints_that_are_not_listed_are_locked_at_zero(tmp_path: Path) -> None:
    # Locking at zero must give the same efforts as the full tree with that joint held at zero.
    whole = Machine.load(write_machine(tmp_path / "rig"))
    locked = YAML.replace("  B: {joint: jb}\n", "")
    slide = Machine.load(write_machine(tmp_path / "slide", yaml=locked))
    assert slide.names == ("X",)
    a = np.array([1.3, 0.0])
    full = pin.rnea(whole.model, whole.model.createData(), np.zeros(2), np.zeros(2), a)
    one = pin.rnea(slide.model, slide.model.createData(), np.zeros(1), np.zeros(1), a[:1])
    assert one[0] == pytest.approx(full[0], rel=1e-12)


def test_rigid_joints_lock_the_passive_ones() -> None:
    rig = Machine.load("flexure_rig")
    rigid = rig.with_rigid_joints()
    assert rigid.passive == {}
    assert rigid.names == tuple(name for name in rig.names if name != "delta")
    q, v, a = (np.array([0.1, 0.2, 0.3]) * k for k in (1, 2, 3))
    keep = [rig.names.index(name) for name in rigid.names]
    big = [np.zeros(rig.nv) for _ in range(3)]
    for full, small in zip(big, (q, v, a), strict=True):
        full[keep] = small
    expected = pin.rnea(rig.model, rig.model.createData(), *big)[keep]
    found = pin.rnea(rigid.model, rigid.model.createData(), q, v, a)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_bundled_machines_by_name_folder_and_file() -> None:
    for name, folder in machines().items():
        assert Machine.load(name).name == name
        assert Machine.load(folder / "machine.yaml").name == name
        assert Machine.load(folder / f"{name}.urdf").name == name


def test_posture() -> None:
    machine = Machine.load("trunnion")
    assert machine.posture({"A": 0.3}).tolist() == [0.0, 0.3, 0.0]
    with pytest.raises(MachineError, match=r"trunnion: no axis 'a'; did you mean 'A'\? known: A, C, Y"):
        machine.posture({"a": 0.3})


def test_unknown_axis_names_the_nearest() -> None:
    with pytest.raises(MachineError, match=r"trunnion: no axis 'y'; did you mean 'Y'\?"):
        Machine.load("trunnion").axis("y")


def test_hints_list_few_words_of_many() -> None:
    words = [f"joint_{i}" for i in range(100)]
    assert nearest("joint_4", words[:3]) == "did you mean 'joint_2'? known: joint_0, joint_1, joint_2"
    many = nearest("joint_x", words)
    assert many.startswith("did you mean 'joint_")
    assert "of 100: " in many
    assert many.count(",") <= 5
    assert nearest("q", []) == "known: none"


def test_meshes_are_found_from_a_copy(tmp_path: Path) -> None:
    mesh = tmp_path / "meshes" / "arm.stl"
    mesh.parent.mkdir()
    mesh.write_text("solid arm\nendsolid arm\n")
    visual = '<visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    for k, name in enumerate(("../meshes/arm.stl", f"package://{tmp_path.name}/meshes/arm.stl")):
        urdf = URDF.replace("</link>\n  <joint", visual.format(name) + "\n  <joint", 1)
        machine = Machine.load(write_machine(tmp_path / f"rig{k}", urdf))
        machine.save(tmp_path / "far" / f"copy{k}")
        text = (tmp_path / "far" / f"copy{k}" / "rig.urdf").read_text()
        assert f'filename="{mesh}"' in text
        assert_same_model(machine.model, Machine.load(tmp_path / "far" / f"copy{k}").model)


def test_a_bare_urdf_needs_no_yaml(tmp_path: Path) -> None:
    folder = write_machine(tmp_path / "rig", yaml=None)
    machine = Machine.load(folder / "rig.urdf")
    assert machine.names == ("jx", "jb")
    assert [e.name for e in machine.axes["jb"].effects] == ["viscous", "coulomb"]
    saved = yaml.safe_load(machine.save(tmp_path / "copy").read_text())
    assert saved["axes"]["jb"] == {"joint": "jb", "effects": ["viscous", "coulomb"]}


def test_a_follower_is_no_axis_unless_the_yaml_says_so(tmp_path: Path) -> None:
    mimic = URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="jx"/>')
    folder = write_machine(tmp_path / "rig", mimic)
    assert Machine.load(folder / "rig.urdf").names == ("jx",)
    assert Machine.load(folder).names == ("X", "B")


def test_a_revolute_joint_without_limits_turns_freely(tmp_path: Path) -> None:
    free = URDF.replace('<limit lower="-2" upper="2" effort="50" velocity="10"/>', "")
    model = Machine.load(write_machine(tmp_path / "rig", free)).model
    assert model.lowerPositionLimit[1] < -1e8
    assert model.upperPositionLimit[1] > 1e8


@pytest.mark.parametrize("kind", ["floating", "planar", "fixed"])
def test_joints_of_other_kinds_are_held(tmp_path: Path, kind: str) -> None:
    # A load on the arm that the URDF lets float is carried as if it were bolted on.
    load = (
        '<link name="load"><inertial><mass value="3"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        f'<joint name="jl" type="{kind}"><parent link="arm"/><child link="load"/>'
        '<origin xyz="0.3 0 0"/></joint></robot>'
    )
    folder = write_machine(tmp_path / "rig", URDF.replace("</robot>", load))
    machine = Machine.load(folder / "rig.urdf")
    assert machine.names == ("jx", "jb")
    arm = machine.model.inertias[2]
    assert arm.mass == pytest.approx(5.0)
    np.testing.assert_allclose(arm.mass * arm.lever, [0.2 + 0.9, 0.0, -0.4], atol=1e-12)


@pytest.mark.parametrize(
    ("given", "replaced", "said"),
    [
        ("<limit lower", "<limits lower", "a prismatic joint needs a <limit>"),
        ('velocity="2"', "", "its <limit> lacks velocity"),
        ("<box", "<cube", "the <geometry> of a <visual> needs one of <box>, <cylinder>, <sphere>, <mesh>"),
    ],
)
def test_what_other_readers_of_urdfs_stumble_over_is_a_warning(
    tmp_path: Path, given: str, replaced: str, said: str
) -> None:
    path = tmp_path / "slide.urdf"
    path.write_text(
        '<robot name="slide"><link name="base"/>'
        '<link name="table"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
        '<visual><geometry><box size="1 1 1"/></geometry></visual></link>'
        '<joint name="X" type="prismatic"><parent link="base"/><child link="table"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="2"/></joint></robot>'.replace(given, replaced)
    )
    messages = [finding.message for finding in pt.check(path).findings if "URDF" in finding.message]
    assert messages == [f"URDF: {said}"]


def test_the_schema_for_editors_is_what_is_read() -> None:
    written = json.loads((ROOT / "docs" / "machine.schema.json").read_text(encoding="utf-8"))
    made = runpy.run_path(str(ROOT / "docs" / "generate_schema.py"))["machine_schema"]()
    assert written == made, "python docs/generate_schema.py"
    check = jsonschema.Draft202012Validator(made)
    for folder in FOLDERS.values():
        assert not list(check.iter_errors(read_yaml(folder / "machine.yaml"))), folder
    for wrong in ("zeroo: 1", "rotor_inertia: -1", "effects: [viscos]", "effects: [{stribeck: {vs: 3}}]"):
        spec = yaml.safe_load(YAML.replace("joint: jb", f"joint: jb, {wrong}"))
        assert list(check.iter_errors(spec)), wrong


def test_settings_may_be_numbers_of_numpy() -> None:
    effects = [{"stribeck": {"v_s": np.float64(0.02)}}, {"ripple": {"harmonics": (np.int64(1), 2)}}]
    machine = Machine.load("emps").listing({"X": effects})
    stribeck, ripple = machine.axis("X").effects[-2:]
    assert (stribeck.v_s, ripple.harmonics) == (0.02, (1, 2))


@pytest.mark.parametrize("given", [3, 3.0, "3", [3]])
def test_one_harmonic_needs_no_list(given: object) -> None:
    (ripple,) = make_effects([{"ripple": {"harmonics": given}}], "X", rotary=False, where="axes.X.effects")
    assert ripple.harmonics == (3,)
