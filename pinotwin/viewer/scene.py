"""A machine drawn at a posture, by a node per joint: shapes, and on request its joint frames and centres of mass."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import coal
import meshcat
import meshcat.geometry as mg
import numpy as np
import pinocchio as pin
import umsgpack

from pinotwin.arrays import Floats, mapped
from pinotwin.dynamics.parameters import joint_axis
from pinotwin.errors import InputError, nearest
from pinotwin.machine.urdf import without_missing_meshes
from pinotwin.viewer.meshes import GREY, Rgba, parts_of
from pinotwin.viewer.stage import corners, diagonal, set_stage

_SCRIPT = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"


@dataclass(frozen=True)
class Page:
    """A meshcat window that writes its scene down instead of sending it to a browser: no server, port or child process.

    The page is self-contained. Commands run in their order; on meshcat's own static page they may overtake each other.
    It records what was drawn, (kind, path, property) -> message; a later one of the same kind replaces it.
    """

    messages: dict[tuple[str, str, str], dict[str, Any]] = field(default_factory=dict)

    def send(self, command: Any) -> None:
        """Take down one command of meshcat."""
        self.take(command.lower())

    def take(self, data: dict[str, Any]) -> None:
        """Take down one message."""
        key = (data["type"], str(data.get("path", "")), str(data.get("property", "")))
        self.messages[key] = data

    def copy(self) -> Page:
        """Return a recording that can be drawn on without changing this one."""
        return Page(dict(self.messages))

    def script(self) -> str:
        """Return meshcat's own script, packed."""
        return _packed(_SCRIPT.read_bytes())

    def commands(self) -> tuple[str, str]:
        """Return all commands as one compressed text, the same in every run, and each as pieces of it in JSON."""
        pool, held, known = bytearray(), dict[bytes, list[int]](), dict[str, str]()
        commands = []
        for message in self.messages.values():
            packed, at, pieces = umsgpack.packb(mapped(message, lambda x: _numbered(x, known))), 0, []
            for array in _arrays(message):
                begin = packed.index(array, at)
                pieces += [packed[at:begin], array]
                at = begin + len(array)
            commands.append([_kept(piece, pool, held) for piece in [*pieces, packed[at:]]])
        return _packed(bytes(pool)), json.dumps(commands, separators=(",", ":"))


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def _kept(piece: bytes, pool: bytearray, held: dict[bytes, list[int]]) -> list[int]:
    """Return begin and end of some bytes in the pool, which takes them where they are new."""
    if piece not in held:
        held[piece] = [len(pool), len(pool) + len(piece)]
        pool += piece
    return held[piece]


def _arrays(value: Any, least: int = 64) -> Iterator[bytes]:
    """Yield the bytes of every array of a message of at least so many bytes, in its order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for item in value:
            yield from _arrays(item, least)
    elif isinstance(value, umsgpack.Ext) and len(value.data) >= least:
        yield value.data


_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


def _numbered(value: Any, known: dict[str, str]) -> Any:
    """Return a text, but for a UUID the number of its first appearance."""
    if isinstance(value, str) and _UUID.fullmatch(value):
        return known.setdefault(value, f"00000000-0000-0000-0000-{len(known) + 1:012x}")
    return value


ROOT = "machine"
_AXIS_COLOURS = (0xC8453B, 0x3E9B5F, 0x3B74B8)
_MASS_COLOUR = 0xC2378B


@dataclass(frozen=True)
class Scene:
    """A drawn machine, and the configuration q (nq,) that it was drawn at."""

    model: pin.Model
    visual: pin.GeometryModel
    page: Page
    q: Floats
    name: str

    def viewer(self) -> meshcat.Visualizer:
        """Return a meshcat visualiser that draws on this scene's page."""
        return meshcat.Visualizer(window=self.page)

    def node(self, joint: int) -> meshcat.Visualizer:
        """Return the node that moves with a joint (0: the base)."""
        return self.viewer()[joint_path(self.model, joint)]


def joint_path(model: pin.Model, joint: int) -> str:
    """Return the place of a joint in meshcat's tree."""
    return f"{ROOT}/{model.names[joint]}"


def visual_model(
    model: pin.Model, urdf_path: str | Path, meshes: Sequence[str | Path] = ()
) -> pin.GeometryModel:
    """Return the shapes of a URDF for a model that was built from it (or reduced from that), links found by name.

    Joints and lines stand for missing meshes (:func:`missing_meshes`), which are looked for in the folders first.
    """
    text, missing = without_missing_meshes(Path(urdf_path), [Path(folder) for folder in meshes])
    try:
        visual = pin.buildGeomFromUrdfString(model, text.decode(), pin.GeometryType.VISUAL, None, [])
    except ValueError:  # a mesh that is there but cannot be read
        visual, missing = pin.GeometryModel(), [str(urdf_path)]
    if missing or visual.ngeoms == 0:
        _add_skeleton(model, visual)
    return visual


def missing_meshes(urdf_path: str | Path, meshes: Sequence[str | Path] = ()) -> str:
    """Return one line on the meshes that could not be found; "" when all were."""
    _, missing = without_missing_meshes(Path(urdf_path), [Path(folder) for folder in meshes])
    if not missing:
        return ""
    return (
        f"{len(missing)} meshes are not on this computer ({missing[0]} ...): joints and lines are drawn instead; "
        "give their folder with --meshes DIR or `meshes:` in machine.yaml"
    )


def _add_skeleton(model: pin.Model, visual: pin.GeometryModel) -> None:
    """Draw every joint as a ball or a block, and a rod from the joint before it."""
    reach = [float(np.linalg.norm(pose.translation)) for pose in model.jointPlacements][1:]
    thick = 0.12 * (float(np.median([r for r in reach if r > 1e-6] or [0.3])))
    for joint in range(1, model.njoints):
        slides = model.joints[joint].shortname().startswith("JointModelP")
        knot = coal.Box(*([2.2 * thick] * 3)) if slides else coal.Sphere(1.2 * thick)
        name = str(model.names[joint])
        _add_shape(visual, f"{name}_knot", joint, pin.SE3.Identity(), knot)
        arm = model.jointPlacements[joint].translation
        length = float(np.linalg.norm(arm))
        if length > 1e-6:
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), arm / length).matrix()
            rod = coal.Cylinder(0.5 * thick, length)
            _add_shape(visual, f"{name}_rod", model.parents[joint], pin.SE3(turn, arm / 2), rod)


def _add_shape(
    visual: pin.GeometryModel, name: str, joint: int, pose: pin.SE3, shape: coal.CollisionGeometry
) -> None:
    body = pin.GeometryObject(name, joint, pose, shape)
    body.meshColor = np.array([0.55, 0.60, 0.66, 1.0])
    visual.addGeometryObject(body)


def draw(
    model: pin.Model,
    visual: pin.GeometryModel,
    q: Floats | None = None,
    *,
    frames: bool = False,
    masses: bool = False,
    name: str | None = None,
) -> Scene:
    """Draw a machine at q (nq,) or zero; ``frames``: triads (x red, y green, z blue), ``masses``: spheres."""
    q = np.asarray(pin.neutral(model) if q is None else q, dtype=float)
    drawn = Scene(model, visual, Page(), q, name or model.name)
    points = corners(model, visual, q)
    set_stage(drawn.viewer(), points)
    for shape in visual.geometryObjects:
        _draw_shape(drawn, joint_path(model, shape.parentJoint), shape)
    size = diagonal(points)
    if frames:
        _draw_frames(drawn, 0.12 * size)
    if masses:
        _draw_masses(drawn, size)
    place_joints(drawn)
    return drawn


def add_copy(drawn: Scene, model: pin.Model, visual: pin.GeometryModel, root: str, rgba: Rgba) -> None:
    """Draw what moves of a second machine in one colour (0 to 1) below a root of its own; the scene is changed."""
    for shape in visual.geometryObjects:
        if shape.parentJoint != 0:  # the base would only shine through itself
            _draw_shape(drawn, f"{root}/{model.names[shape.parentJoint]}", shape, rgba)


def _draw_shape(drawn: Scene, place: str, shape: pin.GeometryObject, rgba: Rgba | None = None) -> None:
    """Hang the parts of a shape below a node, each in its own colour or all in one."""
    node = drawn.viewer()[f"{place}/{shape.name}"]
    node.set_transform(shape.placement.homogeneous)
    parts = parts_of(shape)
    for k, part in enumerate(parts):
        red, green, blue, opacity = rgba or part.rgba or (*GREY, 1.0)
        tint = sum(round(255 * x) << bits for x, bits in ((red, 16), (green, 8), (blue, 0)))
        material = mg.MeshPhongMaterial(color=tint, opacity=opacity, transparent=opacity < 1.0)
        owner = node if len(parts) == 1 else node[str(k)]
        owner.set_object(mg.TriangularMeshGeometry(part.vertices, part.faces), material)


def joint_poses(model: pin.Model, q: Floats) -> list[pin.SE3]:
    """Return the pose of every joint in the world, the base first."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return [pin.SE3(pose) for pose in data.oMi]


def place_joints(drawn: Scene) -> None:
    """Set every joint's node to its pose at the scene's configuration."""
    for joint, pose in enumerate(joint_poses(drawn.model, drawn.q)):
        drawn.node(joint).set_transform(pose.homogeneous)


def _draw_frames(drawn: Scene, length: float) -> None:
    """Draw triads that shine through the bodies."""
    for joint in range(1, drawn.model.njoints):
        for k, colour in enumerate(_AXIS_COLOURS):
            arm = drawn.node(joint)["frame"]["xyz"[k]]
            _lay(arm, mg.Cylinder(length, 0.028 * length), colour, np.eye(3)[k], length / 2)


def _lay(node: meshcat.Visualizer, shape: mg.Cylinder, colour: int, along: Floats, middle: float) -> None:
    """Lay meshcat's cylinder (about y) along a unit direction (3,), its middle so far along it [m]."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 1.0, 0.0]), along).matrix()
    node.set_object(shape, _overlay(colour, 0.95))
    node.set_transform(pin.SE3(turn, middle * along).homogeneous)


def _draw_masses(drawn: Scene, size: float) -> None:
    """Draw spheres at the centres of mass; the heaviest has a radius of 4 % of the machine."""
    bodies = list(drawn.model.inertias)
    heaviest = max((body.mass for body in bodies[1:]), default=0.0)
    for joint, body in enumerate(bodies):
        if joint == 0 or body.mass <= 0:
            continue
        radius = 0.04 * size * (body.mass / heaviest) ** (1 / 3)
        ball = drawn.node(joint)["mass"]
        ball.set_object(mg.Sphere(radius), _overlay(_MASS_COLOUR, 0.75))
        ball.set_transform(pin.SE3(np.eye(3), body.lever).homogeneous)


def _overlay(colour: int, opacity: float) -> mg.Material:
    """Return a material that is drawn last and is not hidden by what stands before it."""
    return mg.MeshBasicMaterial(color=colour, opacity=opacity, transparent=True, depthTest=False)


def arrow(drawn: Scene, joint: str, along: Floats, size: float) -> None:
    """Draw an arrow of ``size`` [m] that moves with a joint, from its frame along a unit direction (3,) in it."""
    node = drawn.node(drawn.model.getJointId(joint))["arrow"]
    _lay(node["shaft"], mg.Cylinder(0.8 * size, 0.025 * size), _MASS_COLOUR, along, 0.4 * size)
    _lay(node["head"], mg.Cylinder(0.2 * size, 0.0, 0.0, 0.07 * size), _MASS_COLOUR, along, 0.9 * size)


def place_mark(drawn: Scene, joint: str, at: float, size: float) -> None:
    """Draw a ball of a radius [m] where a joint is at a position ``at`` [m or rad]; it stays with the body before."""
    number = drawn.model.getJointId(joint)
    turns, axis = joint_axis(drawn.model, number)
    moved = pin.SE3(pin.exp3(axis * at), np.zeros(3)) if turns else pin.SE3(np.eye(3), axis * at)
    # Of a joint that turns it is a point off its axis, towards what it carries.
    carried = zip(drawn.model.jointPlacements, drawn.model.parents, strict=True)
    arms = [pose.translation for pose, parent in carried if turns and parent == number]
    arm = max(arms, key=lambda x: float(np.linalg.norm(x)), default=np.zeros(3))
    place = (drawn.model.jointPlacements[number] * moved).act(0.5 * arm)
    ball = drawn.node(drawn.model.parents[number])[f"place {joint}"]
    ball.set_object(mg.Sphere(size), _overlay(_MASS_COLOUR, 0.95))
    ball.set_transform(pin.SE3(np.eye(3), place).homogeneous)


def colour(drawn: Scene, rgba: Mapping[str, Sequence[float]]) -> Scene:
    """Return the scene with shapes in red, green, blue, opacity (0 to 1) by joint; InputError for an unknown one."""
    painted = replace(drawn, page=drawn.page.copy())
    for name, value in rgba.items():
        if not drawn.model.existJointName(name):
            raise InputError(f"colour: no joint {name!r}; {nearest(name, drawn.model.names)}")
        joint = drawn.model.getJointId(name)
        path = f"/meshcat/{joint_path(drawn.model, joint)}"
        painted.page.take({"type": "set_property", "path": path, "property": "color", "value": [*value]})
    return painted
