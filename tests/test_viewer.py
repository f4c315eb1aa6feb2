"""The viewer: postures, the self-contained page, playback, and one look through Chromium."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import re
import zlib
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import umsgpack

import pinotwin as pt
from pinotwin.errors import InputError, MachineError
from pinotwin.machine import Machine
from pinotwin.viewer import (
    Scene,
    colour,
    draw,
    missing_meshes,
    parse_posture,
    view,
    visual_model,
)
from pinotwin.viewer.meshes import parts_of
from pinotwin.viewer.stage import ASPECT, FIELD_OF_VIEW, aim, corners
from tests.screenshot import browser, screenshot


def at(model: pin.Model, posture: dict[str, float]) -> np.ndarray:
    """Return the configuration of a posture, joint -> m or rad."""
    v = np.zeros(model.nv)
    for name, x in posture.items():
        v[model.joints[model.getJointId(name)].idx_v] = x
    return pin.integrate(model, pin.neutral(model), v)


def scene(urdf: Path, posture: dict[str, float] | None = None, **looks: bool) -> Scene:
    """Draw the machine of a URDF."""
    model = pin.buildModelFromUrdf(str(urdf))
    return draw(model, visual_model(model, urdf), at(model, posture or {}), **looks)


ROTARY = {"Y": False, "A": True, "C": True}
SHARED = Path(__file__).resolve().parents[2] / "shared" / "cases" / "viewer"
NAMES = ["laser_driller", "trunnion", "flexure_rig", "emps", "tx40"]


def of(urdf_dir: Path, name: str) -> Path:
    return urdf_dir / name / f"{name}.urdf"


def messages(html: str) -> list[dict]:
    """What the page tells meshcat, unpacked."""
    ((text, commands),) = re.findall(r'^const PACKED = "(.*)";\nconst COMMANDS = (.*);$', html, re.M)
    packed = zlib.decompress(base64.b64decode(text))
    return [umsgpack.unpackb(b"".join(packed[a:b] for a, b in pieces)) for pieces in json.loads(commands)]


# ---------------------------------------------------------------------------------------- postures
def test_posture_reads_units_and_bare_si() -> None:
    got = parse_posture("Y=0.1, A=30deg,C = -1e-1 rev", ROTARY)
    assert got == pytest.approx({"Y": 0.1, "A": math.pi / 6, "C": -0.2 * math.pi})
    assert parse_posture("Y=25mm,A=-.5", ROTARY) == pytest.approx({"Y": 0.025, "A": -0.5})
    assert parse_posture("A=10°", ROTARY) == pytest.approx({"A": math.pi / 18})
    assert parse_posture("", ROTARY) == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("B=1", "posture: no axis 'B'; known: A, C, Y"),
        ("Y", "posture: expected axis=value, found 'Y', e.g. Y=0.1,A=30deg"),
        ("Y=", "posture: '' of axis 'Y' is not a number"),
        ("Y=abc", "posture: 'abc' of axis 'Y' is not a number"),
        ("Y=nan", "posture: 'nan' of axis 'Y' is not a number"),
        ("A=1,A=2", "posture: axis 'A' is given twice"),
    ],
)
def test_bad_posture_says_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        parse_posture(text, ROTARY)
    assert str(error.value) == message


def test_bad_unit_names_the_axis_and_the_nearest_unit() -> None:
    with pytest.raises(InputError, match=r"unit 'deg' does not fit axis 'Y', which slides"):
        parse_posture("Y=3deg", ROTARY)
    with pytest.raises(InputError, match=r"unit 'dge' .* axis 'A', which turns; did you mean 'deg'"):
        parse_posture("A=3dge", ROTARY)


def test_a_wheel_without_shapes_is_drawn(tmp_path: Path) -> None:
    urdf = tmp_path / "wheel.urdf"
    urdf.write_text(
        '<robot name="wheel"><link name="a"/><link name="b"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="W" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        "</joint></robot>"
    )
    drawn = scene(urdf, posture={"W": 1.0}, frames=True, masses=True)  # a machine without shapes
    np.testing.assert_allclose(node_pose(drawn, "machine/W")[:2, 0], [math.cos(1.0), math.sin(1.0)])


# ---------------------------------------------------------------------------------------- the page
@pytest.mark.parametrize("name", NAMES)
def test_page_is_self_contained_and_holds_every_shape(urdf_dir: Path, tmp_path: Path, name: str) -> None:
    drawn = scene(of(urdf_dir, name))
    view(of(urdf_dir, name), html=tmp_path / "new" / f"{name}.html", frames=False)
    html = (tmp_path / "new" / f"{name}.html").read_text(encoding="utf-8").replace('href="data:,"', "")
    # The one address inside names the XML language of web pages; nothing is fetched from it.
    assert set(re.findall(r"https?://[^\"'`\s)]+", html)) <= {"http://www.w3.org/1999/xhtml"}
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)\s*=", html)
    told = messages(html)
    shapes = [m for m in told if m["type"] == "set_object" and m["path"].startswith("/meshcat/machine/")]
    shapes = [m for m in shapes if not m["path"].endswith("/inertia")]
    assert len(shapes) == drawn.visual.ngeoms
    assert len(html) < 2_000_000


def node_pose(drawn: Scene, path: str) -> np.ndarray:
    matrix = drawn.page.messages[("set_transform", f"/meshcat/{path}", "")]["matrix"]
    return np.array(matrix).reshape(4, 4).T


def test_shapes_stand_where_pinocchio_puts_them(urdf_dir: Path) -> None:
    posture = {"J1": 0.4, "J2": -1.0, "J3": 1.2, "J5": 0.3}
    drawn = scene(of(urdf_dir, "tx40"), posture=posture)
    data, placed = drawn.model.createData(), drawn.visual.createData()
    q = np.array([0.4, -1.0, 1.2, 0.0, 0.3, 0.0])
    pin.updateGeometryPlacements(drawn.model, data, drawn.visual, placed, q)
    for shape, expected in zip(drawn.visual.geometryObjects, placed.oMg, strict=True):
        joint = drawn.model.names[shape.parentJoint]
        got = node_pose(drawn, f"machine/{joint}") @ node_pose(drawn, f"machine/{joint}/{shape.name}")
        np.testing.assert_allclose(got, expected.homogeneous, atol=1e-12)


def test_frames_and_masses_are_optional(urdf_dir: Path) -> None:
    def count(drawn: Scene, word: str) -> int:
        return sum(kind == "set_object" and word in path for kind, path, _ in drawn.page.messages)

    plain = scene(of(urdf_dir, "trunnion"))
    full = scene(of(urdf_dir, "trunnion"), frames=True, masses=True)
    assert (count(plain, "/frame/"), count(plain, "/mass")) == (0, 0)
    assert (count(full, "/frame/"), count(full, "/mass")) == (9, 3)
    lever = full.model.inertias[2].lever
    np.testing.assert_allclose(node_pose(full, "machine/A/mass")[:3, 3], lever)


def test_a_reduced_model_keeps_all_shapes(urdf_dir: Path) -> None:
    """A machine with locked joints is drawn whole, its locked links with their parent."""
    path = of(urdf_dir, "flexure_rig")
    model = pin.buildModelFromUrdf(str(path))
    locked = pin.buildReducedModel(model, [model.getJointId("delta")], pin.neutral(model))
    drawn = draw(locked, visual_model(locked, path), at(locked, {"A": 0.3}))
    assert drawn.visual.ngeoms == visual_model(model, path).ngeoms
    np.testing.assert_allclose(
        corners(locked, drawn.visual, at(locked, {"A": 0.3})).max(axis=0),
        corners(model, visual_model(model, path), at(model, {"A": 0.3})).max(axis=0),
        atol=1e-12,
    )


@pytest.mark.parametrize("name", NAMES)
def test_camera_sees_the_whole_machine(urdf_dir: Path, name: str) -> None:
    drawn = scene(of(urdf_dir, name))
    points = corners(drawn.model, drawn.visual, drawn.q)
    camera = aim(points)
    back = camera.offset / np.linalg.norm(camera.offset)
    right = np.cross([0, 0, 1], back) / np.linalg.norm(np.cross([0, 0, 1], back))
    seen = points - camera.target - camera.offset
    slope = np.tan(np.radians(FIELD_OF_VIEW / 2))
    up = (seen @ np.cross(back, right)) / -(seen @ back) / slope
    across = (seen @ right) / -(seen @ back) / slope / ASPECT
    widest = max(np.abs(up).max(), np.abs(across).max())
    assert 0.85 < widest <= 1.0
    assert up.max() == pytest.approx(-up.min(), abs=0.03)  # in the middle
    assert across.max() == pytest.approx(-across.min(), abs=0.03)


def test_colour_changes_one_joint_only(urdf_dir: Path) -> None:
    drawn = scene(of(urdf_dir, "emps"))
    painted = colour(drawn, {"X": (1.0, 0.0, 0.0, 1.0)})
    extra = set(painted.page.messages) - set(drawn.page.messages)
    assert extra == {("set_property", "/meshcat/machine/X", "color")}
    with pytest.raises(InputError, match="colour: no joint 'Z'"):
        colour(drawn, {"Z": (1.0, 0.0, 0.0, 1.0)})


def test_missing_files_are_named(urdf_dir: Path, tmp_path: Path) -> None:
    with pytest.raises((InputError, MachineError), match=r"nothing\.urdf"):
        view(tmp_path / "nothing.urdf")
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="file is not a folder"):
        view(of(urdf_dir, "emps")).save(blocked / "page.html")


# ----------------------------------------------------------------------------------------- picture
def test_chromium_sees_a_machine(urdf_dir: Path, tmp_path: Path) -> None:
    if browser() is None:
        pytest.skip("no Chromium on this computer; Debian: apt install chromium")
    from PIL import Image

    page = view(of(urdf_dir, "flexure_rig"), frames=False).save(tmp_path / "m.html")
    png = screenshot(page, tmp_path / "m.png", size=(800, 375))
    pixels = np.asarray(Image.open(png).convert("RGB"), dtype=float)[:, :500]
    assert pixels.shape == (375, 500, 3)
    background = pixels[5, 5]
    assert background.min() > 200  # bright
    differs = np.abs(pixels - background).max(axis=2) > 40
    assert 0.15 < differs.mean() < 0.8
    assert differs[:, 100:400].mean() > differs[:, :50].mean()  # the machine is in the middle


GONE = """<robot name="arm"><link name="base"/>
  <joint name="J1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://arm_description/meshes/upper.stl"/></geometry></visual>
    <visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <joint name="J2" type="prismatic"><parent link="upper"/><child link="hand"/><origin xyz="0.4 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="hand"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://arm_description/meshes/hand.stl"/></geometry></visual></link>
</robot>"""


def test_without_meshes_the_joints_and_the_lines_between_them_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(GONE)
    model = pin.buildModelFromXML(GONE)
    names = {g.name for g in visual_model(model, path).geometryObjects}
    assert {"J1_knot", "J1_rod", "J2_knot", "J2_rod"} <= names
    assert len(names) == 5  # and the box that needs no file
    assert "2 meshes are not on this computer (package://arm_description/meshes/upper.stl" in missing_meshes(
        path
    )
    view(path, html=tmp_path / "page.html", posture={"J1": 0.4})
    assert (tmp_path / "page.html").stat().st_size > 10_000


@pytest.mark.parametrize("place", ["arm_description/meshes", "meshes", "."])
def test_meshes_are_found_in_a_given_folder_however_deep_it_is(tmp_path: Path, place: str) -> None:
    path, given = tmp_path / "urdf" / "arm.urdf", tmp_path / "elsewhere"
    path.parent.mkdir()
    path.write_text(GONE)
    (given / place).mkdir(parents=True)
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    for name in ("upper", "hand"):
        (given / place / f"{name}.stl").write_text(f"solid s\n{facet}endsolid s\n")
    assert missing_meshes(path, [given]) == ""
    assert visual_model(pin.buildModelFromXML(GONE), path, [given]).ngeoms == 3
    (given / place / "hand.stl").write_bytes(b"no mesh")
    names = {g.name for g in visual_model(pin.buildModelFromXML(GONE), path, [given]).geometryObjects}
    assert "J2_rod" in names  # a mesh that cannot be read costs no picture either


def test_a_folder_of_meshes_in_the_yaml(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(GONE)
    text = "name: arm\nurdf: arm.urdf\nmeshes: ../parts\naxes: {J1: {joint: J1}, J2: {joint: J2}}\n"
    (tmp_path / "machine.yaml").write_text(text)
    machine = Machine.load(tmp_path)
    assert machine.meshes == ((tmp_path / "../parts").resolve(),)
    copy = tmp_path / "copy"
    copy.mkdir()
    machine.save(copy)
    assert Machine.load(copy).meshes == machine.meshes
    (tmp_path / "machine.yaml").write_text(text.replace("../parts", "{a: 1}"))
    with pytest.raises(MachineError, match="meshes: expected a folder"):
        Machine.load(tmp_path)


def test_a_picture_that_fails_is_one_line_and_costs_no_diagnosis(tmp_path: Path) -> None:
    from pinotwin.diagnosis.result import Diagnosis
    from pinotwin.log import Log
    from pinotwin.logs.prepared import Prepared
    from pinotwin.report.saved import write_view

    (tmp_path / "arm.urdf").write_text(GONE)
    machine = Machine.load(tmp_path / "arm.urdf")
    t = 0.01 * np.arange(400)
    log = Log({"t": t, "J1.q": np.sin(t), "J2.q": 0.1 * np.sin(2 * t)})
    found = Diagnosis("", {}, (), (), (), {}, {}, "assumed", (), "structure", {}, subject=machine)
    said = write_view(dataclasses.replace(found, prepared=[Prepared(machine, log)]), tmp_path, None)
    assert (tmp_path / "machine.html").is_file()
    assert len(said) == 1
    assert "joints and lines are drawn" in said[0]
    wrong = Log({"t": t, "Q.q": np.sin(t)})
    (said,) = write_view(dataclasses.replace(found, prepared=[Prepared(machine, wrong)]), tmp_path, None)
    assert said.startswith("machine.html was not written: ")
    assert "\n" not in said


# ------------------------------------------------------------------------------------------ meshes
CUBE = "\n".join(f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1))
SIDES = {"red": "1 2 4 3", "blue": "5 6 8 7"}  # two sides of the cube, each a square of two triangles


def one_mesh(folder: Path, file: str, extra: str = "", scale: str = "1 1 1") -> Path:
    path = folder / "thing.urdf"
    path.write_text(
        f'<robot name="thing"><link name="base"/><joint name="J" type="prismatic"><parent link="base"/>'
        f'<child link="thing"/><axis xyz="0 0 1"/><limit lower="0.1" upper="1" effort="1" velocity="1"/></joint>'
        f'<link name="thing"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        f'iyz="0"/></inertial><visual><geometry><mesh filename="{file}" scale="{scale}"/></geometry>{extra}'
        f"</visual></link></robot>"
    )
    return path


def parts(path: Path) -> dict[tuple[float, ...], int]:
    (shape,) = visual_model(pin.buildModelFromUrdf(str(path)), path).geometryObjects
    return {tuple(round(x, 3) for x in part.rgba or ()): len(part.faces) for part in parts_of(shape)}


def two_sides(folder: Path) -> None:
    (folder / "sides.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    sides = "\n".join(f"usemtl {name}\nf {corners}" for name, corners in SIDES.items())
    (folder / "sides.obj").write_text(f"mtllib sides.mtl\n{CUBE}\n{sides}\n")


def test_every_material_of_a_file_keeps_its_colour(tmp_path: Path) -> None:
    two_sides(tmp_path)
    assert parts(one_mesh(tmp_path, "sides.obj")) == {(1, 0, 0, 1): 2, (0, 0, 1, 1): 2}


def test_a_material_of_the_urdf_goes_before_the_files(tmp_path: Path) -> None:
    two_sides(tmp_path)
    green = '<material name="green"><color rgba="0 1 0 0.5"/></material>'
    assert parts(one_mesh(tmp_path, "sides.obj", green)) == {(0, 1, 0, 0.5): 4}


def test_a_scaled_mesh_is_scaled_once(tmp_path: Path) -> None:
    two_sides(tmp_path)
    path = one_mesh(tmp_path, "sides.obj", scale="0.001 0.002 0.003")
    model = pin.buildModelFromUrdf(str(path))
    visual = visual_model(model, path)
    (shape,) = visual.geometryObjects
    high = np.max([part.vertices.max(axis=0) for part in parts_of(shape)], axis=0)
    np.testing.assert_allclose(high, [0.001, 0.002, 0.003], rtol=1e-6)
    np.testing.assert_allclose(corners(model, visual, pin.neutral(model)).max(axis=0), high, rtol=1e-6)


def test_edges_stay_sharp_and_round_things_round() -> None:
    shapes = pin.GeometryModel()
    for name, shape in (("box", coal.Box(1, 1, 1)), ("ball", coal.Sphere(1))):
        shapes.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3.Identity(), shape))
    (box,), (ball,) = (parts_of(shape) for shape in shapes.geometryObjects)
    assert len(box.vertices) == 24  # a corner once for each of its three sides
    assert len(ball.vertices) == len(np.unique(ball.vertices, axis=0))


def test_a_texture_gives_its_mean_colour(tmp_path: Path) -> None:
    from PIL import Image

    two_sides(tmp_path)
    Image.fromarray(np.array([[[250, 50, 0], [150, 150, 0]]], dtype=np.uint8)).save(tmp_path / "wood.png")
    (tmp_path / "sides.mtl").write_text("newmtl red\nKd 1 1 1\nmap_Kd wood.png\nnewmtl blue\nKd 0 0 1\n")
    text = (tmp_path / "sides.obj").read_text().replace("f 1 2 4 3", "vt 0 0\nvt 1 1\nf 1/1 2/1 4/2 3/2")
    (tmp_path / "sides.obj").write_text(text)
    assert parts(one_mesh(tmp_path, "sides.obj")) == {(0.784, 0.392, 0, 1): 2, (0, 0, 1, 1): 2}


def test_what_the_first_reader_cannot_read_comes_from_pinocchios(tmp_path: Path) -> None:
    body = (SHARED / "two_bodies.dae").read_text() if SHARED.is_dir() else pytest.skip("no shared cases")
    (tmp_path / "broken.dae").write_text(
        body.replace("<instance_effect url=", "<instance_effect url='#none' x=")
    )
    path = one_mesh(tmp_path, "broken.dae")
    (shape,) = visual_model(pin.buildModelFromUrdf(str(path)), path).geometryObjects
    assert sum(parts(path).values()) == shape.geometry.num_tris > 0


def test_a_start_that_is_not_zero_is_said(tmp_path: Path) -> None:
    two_sides(tmp_path)
    path = one_mesh(tmp_path, "sides.obj")
    found = view(path)
    assert found.posture == {"J": 0.1}
    assert found.notes == ("Zero lies outside the limits of J: drawn at the limit next to it",)
    assert found.notes[0] in found.page
    assert '"zero":' not in found.page
    assert view(path, posture="J=0.2").notes == ()
    assert view(path, posture={"J": 2.0}).notes == ("Outside the limits of the URDF: J",)


def test_a_model_in_hand_is_viewed(urdf_dir: Path) -> None:
    model = pin.buildModelFromUrdf(str(of(urdf_dir, "trunnion")))
    found = pt.view(model, posture={"A": 0.3})
    assert found.posture == {"Y": 0.0, "A": 0.3, "C": 0.0}
    assert "<iframe srcdoc=" in found._repr_html_()
