"""MuJoCo: the tree with armature, damping, springs and dry friction, and a passive-force function for the rest.

Shapes are those of the URDF as MuJoCo takes them: primitives, and meshes in STL or OBJ.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import joint_axis
from pinotwin.export.inverse import Inverse, header, literal, rendered, runtime_text
from pinotwin.machine.urdf import impossible_bodies, resolve_meshes
from pinotwin.machine.urdf_check import read_tree
from pinotwin.system.templates import asset
from pinotwin.twin import Twin

_FRICTION = {"solreffriction": "0.001 1", "solimpfriction": "0.99 0.99 0.001"}
"""Dry friction that turns round within 1 ms: MuJoCo's 20 ms would show in every reversal of a servo axis."""


def mjcf_files(twin: Twin, inverse: Inverse, stem: str) -> tuple[dict[str, bytes], list[str]]:
    """Return the MJCF file and the module beside it by name, and what the two leave out, a line each."""
    native = split(inverse.data)
    shapes, meshes, lost = geometry_of(twin.machine.urdf, twin.machine.model)
    out = [f"left out: {', '.join(native.inexpressible)}"] if native.inexpressible else []
    files = {
        f"{stem}.xml": _model(twin, inverse, native, {"shapes": shapes, "meshes": meshes}),
        f"{stem}_passive.py": _passive(twin, inverse, native, stem, out).encode(),
    }
    odd = impossible_bodies(twin.model)
    if odd:
        out.append(f"MuJoCo balances the inertia of {', '.join(odd)}: what was identified cannot exist")
    if lost:
        out.append(f"{lost} shapes are not drawn: MuJoCo reads meshes as STL and OBJ, and from a file")
    return files, out


def _model(twin: Twin, inverse: Inverse, native: Native, drawn: dict[str, Any], step: float = 5e-4) -> bytes:
    """Return the text of the MJCF file with the shapes and meshes that are ``drawn``, for a time step [s]."""
    model = twin.model
    compiler = {"angle": "radian", "autolimits": "true", "boundmass": "0", "fusestatic": "false"}
    if impossible_bodies(model):
        compiler["balanceinertia"] = "true"
    gravity = numbers(model.gravity.linear)
    text = rendered(
        "mjcf.xml",
        name=twin.machine.name,
        header=header(inverse),
        compiler=compiler,
        option={"timestep": f"{step:g}", "integrator": "implicitfast", "gravity": gravity},
        **drawn,
        bodies=_bodies(twin, native),
        ties=_ties(twin, native),
        motors=_motors(twin),
    )
    root = etree.fromstring(text.encode(), etree.XMLParser(remove_blank_text=True))
    return etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True)


_Attributes = dict[str, str]


def _bodies(twin: Twin, native: Native) -> list[tuple[int, dict[str, Any], _Attributes, _Attributes]]:
    """Return number, body, mass properties and joint of every moving body."""
    model, out = twin.model, []
    columns = {row.joint: row.index for row in twin.machine.parts}
    for i in range(1, model.njoints):
        name, place = str(model.names[i]), model.jointPlacements[i]
        at = {"pos": numbers(place.translation), "quat": quaternion(place.rotation)}
        body = {"parent": int(model.parents[i]), "attributes": {"name": f"{name}_body", **at}}
        out.append((i, body, _inertial(model.inertias[i]), _joint(model, i, columns[name], native)))
    return out


def _joint(model: pin.Model, i: int, column: int, native: Native) -> _Attributes:
    rotary, axis = joint_axis(model, i)
    low, high = model.lowerPositionLimit[column], model.upperPositionLimit[column]
    out = {"name": str(model.names[i]), "type": "hinge" if rotary else "slide", "axis": numbers(axis)}
    for key in ("armature", "damping", "stiffness"):
        out[key] = f"{getattr(native, key)[column]:.12g}"
    out["frictionloss"] = f"{native.friction[column]:.12g}"
    if native.friction[column] > 0.0:
        out |= _FRICTION
    return out | ({"range": numbers((low, high))} if max(abs(low), abs(high)) < 1e3 else {})


def _inertial(inertia: pin.Inertia, least: float = 1e-9) -> _Attributes:
    """Return the mass properties; mass [kg] and moments [kg·m²] of zero get the least: MuJoCo refuses zero."""
    values, axes = np.linalg.eigh(inertia.inertia)
    m = axes @ np.diag(np.maximum(values, least)) @ axes.T
    full = numbers((m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))
    return {"mass": f"{max(inertia.mass, least):.12g}", "pos": numbers(inertia.lever), "fullinertia": full}


def _ties(twin: Twin, native: Native) -> list[tuple[_Attributes, list[str]]]:
    """Return motors that turn two joints: a tendon along the sum of the two."""
    names, out = {part.index: part.joint for part in twin.machine.parts}, []
    for tie in native.ties:
        joints = [names[j] for j in tie.joints]
        sizes = {"armature": tie.armature, "damping": tie.damping, "frictionloss": tie.friction}
        shown = {key: f"{value:.12g}" for key, value in sizes.items()}
        out.append(({"name": "_".join(joints), **shown, **_FRICTION}, joints))
    return out


def _motors(twin: Twin) -> list[_Attributes]:
    out = []
    for axis in twin.machine.axes.values():
        limit = axis.effort_limit
        range_ = {"ctrlrange": numbers((-limit, limit))} if np.isfinite(limit) else {}
        out.append({"name": axis.name, "joint": axis.joint, **range_})
    return out


def _passive(twin: Twin, inverse: Inverse, native: Native, stem: str, left_out: list[str]) -> str:
    """Return the text of the module beside the MJCF file, whose name without its suffix is ``stem``."""
    names = [part.joint for part in sorted(twin.machine.parts, key=lambda part: part.index)]
    text = asset("pinotwin.export", "passive.py")
    own = text[text.index("class PassiveForce") :].strip()
    core = re.split(r"^class InverseModel", runtime_text(), flags=re.MULTILINE)[0].strip()
    return rendered(
        "passive.txt",
        stem=stem,
        name=twin.machine.name,
        left_out=left_out,
        runtime=core,
        data=literal(native.rest | {"joints": names, "whole": inverse.data["dry"]}),
        passive=own,
    )


@dataclass(frozen=True)
class Tie:
    """What the motor that turns two joints adds along their sum (a tendon of MuJoCo)."""

    joints: tuple[int, int]  # columns of the two joints
    armature: float  # rotor inertia [kg·m²]
    damping: float  # viscous friction [N·m·s/rad]
    friction: float  # dry friction [N·m]


@dataclass(frozen=True)
class Native:
    """A machine's effort split in two."""

    armature: Floats  # rotor inertia of each joint, shape (nv,)
    damping: Floats  # viscous friction [N·s/m or N·m·s/rad], shape (nv,)
    stiffness: Floats  # spring to zero [N/m or N·m/rad], shape (nv,)
    friction: Floats  # dry friction, the same at every speed and both ways [N or N·m], shape (nv,)
    ties: tuple[Tie, ...]  # motors that turn two joints
    rest: dict[str, Any]  # what is left, as :class:`pinotwin.export.runtime.Friction` takes it
    inexpressible: tuple[str, ...]  # what neither part can hold, in words


def split(data: dict[str, Any]) -> Native:
    """Return the two parts of ``Inverse.data``."""
    nv = len(data["names"])
    friction = np.zeros(nv)
    armature, viscous = (np.array(data[key], dtype=float) for key in ("armature", "viscous"))
    dry, tied = [], {}
    for row in data["dry"]:
        level, rest = _level(row)
        if row["partner"] >= 0:
            tied[_pair(row["joint"], row["partner"])] = level
        else:
            friction[row["joint"]] += level
        if rest is not None:
            dry.append(rest)
    ties, lost = [], []
    for i, j, inertia, damping in data["coupled"]:
        most = float(np.clip(inertia, 0.0, min(armature[i], armature[j])))
        if inertia - most > 1e-3 * abs(inertia):
            names = f"{data['names'][i]} and {data['names'][j]}"
            lost.append(f"{inertia - most:.3g} kg·m² of the rotor that turns {names}")
        ties.append(Tie((int(i), int(j)), most, float(damping), tied.pop(_pair(i, j), 0.0)))
        armature[[i, j]] -= most
        viscous[[i, j]] -= damping
    ties += [Tie(pair, 0.0, 0.0, level) for pair, level in tied.items()]
    damping, left = np.maximum(viscous, 0.0), np.minimum(viscous, 0.0)
    rest = {key: data[key] for key in ("names", "position", "velocity", "slip")}
    rest |= {"viscous": left.tolist(), "stiffness": [0.0] * nv, "dry": dry, "coupled": []}
    stiffness = np.array(data["stiffness"], dtype=float)
    return Native(armature, damping, stiffness, friction, tuple(ties), rest, tuple(lost))


def _pair(i: int, j: int) -> tuple[int, int]:
    return (min(int(i), int(j)), max(int(i), int(j)))


def _level(row: dict[str, Any]) -> tuple[float, dict[str, Any] | None]:
    """Return the friction common to all speeds and both directions, and the rest of the element."""
    plus, minus = row["plus"], row["minus"]
    level = max(0.0, min(min(plus.y), -max(minus.y)))
    rest_plus, rest_minus = [y - level for y in plus.y], [y + level for y in minus.y]
    if not any(abs(y) > 1e-9 * max(level, 1e-12) for y in (*rest_plus, *rest_minus)):
        return level, None
    return level, row | {"plus": plus._replace(y=rest_plus), "minus": minus._replace(y=rest_minus)}


def geometry_of(path: Path, model: pin.Model) -> tuple[dict[int, list[_Attributes]], list[_Attributes], int]:
    """Return the visual shapes of a URDF, placed in the joints of the model.

    They are joint number (0: the base) -> attributes of each ``<geom>``, attributes of each ``<mesh>``, and how many
    were lost: meshes that MuJoCo does not read or that are not there.
    """
    root = read_tree(path)
    resolve_meshes(root, path)
    shapes = dict[int, list[_Attributes]]()
    meshes, lost = list[_Attributes](), 0
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
    return shapes, meshes, lost


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
    if file.suffix.lower() not in (".stl", ".obj") or not file.is_file():
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
