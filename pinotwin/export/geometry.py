"""The shapes of a URDF as MuJoCo takes them: primitives, and meshes in STL or OBJ."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.machine.urdf import resolve_meshes
from pinotwin.machine.urdf_check import read_tree

_READABLE = (".stl", ".obj")


@dataclass(frozen=True)
class Geometry:
    """Shapes by joint number (0: the base), meshes, and how many shapes could not be taken."""

    shapes: dict[int, list[dict[str, str]]]  # joint number -> attributes of each ``<geom>``
    meshes: list[dict[str, str]]  # attributes of each ``<mesh>``
    lost: int  # meshes that MuJoCo does not read or that are not there


def geometry_of(path: Path, model: pin.Model) -> Geometry:
    """Return the visual shapes of a URDF, placed in the joints of the model."""
    root = read_tree(path)
    resolve_meshes(root, path)
    shapes = dict[int, list[dict[str, str]]]()
    meshes, lost = list[dict[str, str]](), 0
    for link in root.findall("link"):
        name = str(link.get("name"))
        if not model.existFrame(name, pin.FrameType.BODY):
            continue
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        for visual in link.findall("visual"):
            shape = _shape(visual, meshes)
            if shape is None:
                lost += 1
                continue
            at = pin.SE3(frame.placement) * _origin(visual.find("origin"))
            shape |= {"pos": numbers(at.translation), "quat": quaternion(at.rotation)}
            shapes.setdefault(int(frame.parentJoint), []).append(shape)
    return Geometry(shapes, meshes, lost)


def _origin(element: etree._Element | None) -> pin.SE3:
    if element is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array((element.get(k) or "0 0 0").split(), dtype=float) for k in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def _shape(visual: etree._Element, meshes: list[dict[str, str]]) -> dict[str, str] | None:
    kind = visual.find("geometry/*")
    if kind is None:
        return None
    colour = visual.find("material/color")
    paint = {"rgba": str(colour.get("rgba"))} if colour is not None else {}
    if kind.tag == "mesh":
        return _mesh(kind, meshes, paint)
    if kind.tag == "box":
        return paint | {"type": "box", "size": numbers(0.5 * float(x) for x in str(kind.get("size")).split())}
    if kind.tag == "sphere":
        return paint | {"type": "sphere", "size": str(kind.get("radius"))}
    if kind.tag in ("cylinder", "capsule"):
        size = f"{kind.get('radius')} {0.5 * float(str(kind.get('length')))!r}"
        return paint | {"type": str(kind.tag), "size": size}
    return None


def _mesh(kind: etree._Element, meshes: list[dict[str, str]], paint: dict[str, str]) -> dict[str, str] | None:
    file = Path(kind.get("filename") or "")
    if file.suffix.lower() not in _READABLE or not file.is_file():
        return None
    entry = {"name": f"mesh{len(meshes)}", "file": str(file)}
    if kind.get("scale"):
        entry["scale"] = str(kind.get("scale"))
    meshes.append(entry)
    return paint | {"type": "mesh", "mesh": entry["name"]}


def numbers(values: object) -> str:
    """Return numbers as an attribute."""
    return " ".join(f"{float(x):.12g}" for x in values)  # type: ignore[attr-defined]


def quaternion(rotation: object) -> str:
    """Return a rotation as w x y z."""
    x, y, z, w = pin.Quaternion(np.asarray(rotation)).coeffs()
    return numbers((w, x, y, z))
