"""MuJoCo: the tree with armature, damping and dry friction, and a passive-force function for the rest."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.dynamics.parameters import joint_axis
from pinotwin.export.geometry import Geometry, geometry_of, numbers, quaternion
from pinotwin.export.inverse import Inverse
from pinotwin.export.native import Native, split
from pinotwin.export.texts import header, literal, rendered, runtime_text
from pinotwin.machine.urdf import impossible_bodies
from pinotwin.system.templates import asset
from pinotwin.twin import Twin

_FRICTION = {"solreffriction": "0.001 1", "solimpfriction": "0.99 0.99 0.001"}
"""Dry friction that turns round within 1 ms: MuJoCo's 20 ms would show in every reversal of a servo axis."""


def mjcf_files(twin: Twin, inverse: Inverse, stem: str) -> tuple[dict[str, bytes], list[str]]:
    """Return the MJCF file and the module beside it by name, and what the two leave out, a line each."""
    native, geometry = split(inverse.data), geometry_of(twin.machine.urdf, twin.machine.model)
    out = [f"left out: {', '.join(native.inexpressible)}"] if native.inexpressible else []
    files = {
        f"{stem}.xml": _model(twin, inverse, native, geometry),
        f"{stem}_passive.py": _passive(twin, native, stem, out).encode(),
    }
    odd = impossible_bodies(twin.model)
    if odd:
        out.append(f"MuJoCo balances the inertia of {', '.join(odd)}: what was identified cannot exist")
    if geometry.lost:
        out.append(
            f"{geometry.lost} shapes are not drawn: MuJoCo reads meshes as STL and OBJ, and from a file"
        )
    return files, out


def _model(twin: Twin, inverse: Inverse, native: Native, geometry: Geometry, step: float = 5e-4) -> bytes:
    """Return the text of the MJCF file, for a time step [s]."""
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
        meshes=geometry.meshes,
        shapes=geometry.shapes,
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


def _passive(twin: Twin, native: Native, stem: str, left_out: list[str]) -> str:
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
        data=literal(native.rest | {"joints": names, "whole": native.dry}),
        passive=own,
    )
