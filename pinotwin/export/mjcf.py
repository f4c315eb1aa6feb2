"""MuJoCo: the tree with armature, damping and dry friction, and a passive-force function for the rest."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.export.geometry import Geometry, geometry_of, numbers, quaternion
from pinotwin.export.header import header
from pinotwin.export.inverse import Inverse, joint_axis
from pinotwin.export.native import Native, split
from pinotwin.export.numpy_file import literal, runtime_text
from pinotwin.machine.urdf import impossible_bodies
from pinotwin.twin import Twin

STEP = 5e-4
"""Time step of the file [s]."""
_FRICTION = {"solreffriction": "0.001 1", "solimpfriction": "0.99 0.99 0.001"}
"""Dry friction that turns round within 1 ms: MuJoCo's 20 ms would show in every reversal of a servo axis."""
_LEAST = 1e-9
"""Smallest mass [kg] and principal moment [kg·m²]: MuJoCo refuses zero."""


def mjcf_text(twin: Twin, inverse: Inverse) -> bytes:
    """Return the text of the MJCF file."""
    model, native = twin.model, split(inverse.data)
    geometry = geometry_of(twin.machine.urdf, twin.machine.model)
    root = etree.Element("mujoco", model=twin.machine.name)
    root.append(etree.Comment("\n  " + "\n  ".join(header(inverse)).replace("--", "- -") + "\n"))
    compiler = {"angle": "radian", "autolimits": "true", "boundmass": "0", "fusestatic": "false"}
    if impossible_bodies(model):
        compiler["balanceinertia"] = "true"
    etree.SubElement(root, "compiler", compiler)
    gravity = numbers(model.gravity.linear)
    etree.SubElement(root, "option", timestep=f"{STEP:g}", integrator="implicitfast", gravity=gravity)
    if geometry.meshes:
        asset = etree.SubElement(root, "asset")
        for mesh in geometry.meshes:
            etree.SubElement(asset, "mesh", mesh)
    _bodies(root, twin, native, geometry)
    if native.ties:
        _ties(root, twin, native)
    actuator = etree.SubElement(root, "actuator")
    for axis in twin.machine.axes.values():
        motor = etree.SubElement(actuator, "motor", name=axis.name, joint=axis.joint)
        if np.isfinite(axis.effort_limit):
            motor.set("ctrlrange", numbers((-axis.effort_limit, axis.effort_limit)))
    return etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True)


def _bodies(root: etree._Element, twin: Twin, native: Native, geometry: Geometry) -> None:
    model = twin.model
    world = etree.SubElement(root, "worldbody")
    etree.SubElement(world, "light", pos="0 0 3", dir="0 0 -1", directional="true")
    elements = {0: world}
    _shapes(world, geometry, 0)
    data: dict[str, Any] = {row.joint: row.index for row in twin.machine.parts}
    for i in range(1, model.njoints):
        name, place = str(model.names[i]), model.jointPlacements[i]
        at = {"pos": numbers(place.translation), "quat": quaternion(place.rotation)}
        body = etree.SubElement(elements[int(model.parents[i])], "body", name=f"{name}_body", **at)
        body.append(_inertial(model.inertias[i]))
        body.append(_joint(model, i, data[name], native))
        _shapes(body, geometry, i)
        elements[i] = body


def _joint(model: pin.Model, i: int, column: int, native: Native) -> etree._Element:
    rotary, axis = joint_axis(model, i)
    low, high = model.lowerPositionLimit[column], model.upperPositionLimit[column]
    out = {
        "name": str(model.names[i]),
        "type": "hinge" if rotary else "slide",
        "axis": numbers(axis),
        "armature": f"{native.armature[column]:.12g}",
        "damping": f"{native.damping[column]:.12g}",
        "stiffness": f"{native.stiffness[column]:.12g}",
        "frictionloss": f"{native.friction[column]:.12g}",
    }
    if native.friction[column] > 0.0:
        out |= _FRICTION
    if max(abs(low), abs(high)) < 1e3:
        out["range"] = numbers((low, high))
    return etree.Element("joint", out)


def _inertial(inertia: pin.Inertia) -> etree._Element:
    """Return the mass properties; those that are zero get the least that MuJoCo takes."""
    values, axes = np.linalg.eigh(inertia.inertia)
    m = axes @ np.diag(np.maximum(values, _LEAST)) @ axes.T
    full = numbers((m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))
    mass = f"{max(inertia.mass, _LEAST):.12g}"
    return etree.Element("inertial", mass=mass, pos=numbers(inertia.lever), fullinertia=full)


def _shapes(body: etree._Element, geometry: Geometry, joint: int) -> None:
    for shape in geometry.shapes.get(joint, ()):
        etree.SubElement(body, "geom", shape | {"contype": "0", "conaffinity": "0", "group": "1"})


def _ties(root: etree._Element, twin: Twin, native: Native) -> None:
    """Write motors that turn two joints: a tendon along the sum of the two."""
    tendon = etree.SubElement(root, "tendon")
    joints = {part.index: part.joint for part in twin.machine.parts}
    for tie in native.ties:
        fixed = etree.SubElement(tendon, "fixed", name="_".join(joints[j] for j in tie.joints))
        for key, value in (
            ("armature", tie.armature),
            ("damping", tie.damping),
            ("frictionloss", tie.friction),
        ):
            fixed.set(key, f"{value:.12g}")
        for key, text in _FRICTION.items():
            fixed.set(key, text)
        for j in tie.joints:
            etree.SubElement(fixed, "joint", joint=joints[j], coef="1")


def passive_text(twin: Twin, inverse: Inverse, stem: str) -> str:
    """Return the text of the module beside the file.

    Args:
        twin: the machine.
        inverse: its inverse model.
        stem: name of the MJCF file without its suffix.
    """
    native = split(inverse.data)
    names = [""] * twin.machine.nv
    for part in twin.machine.parts:
        names[part.index] = part.joint
    text = (files("pinotwin.export") / "passive.py").read_text(encoding="utf-8")
    own = text[text.index("class PassiveForce") :].strip()
    core = re.split(r"^class InverseModel", runtime_text(), flags=re.MULTILINE)[0].strip()
    head = "\n".join(
        [
            f"What {stem}.xml cannot say of {twin.machine.name}: efforts of position and speed, friction with memory.",
            "",
            "    model = mujoco.MjModel.from_xml_path(...)",
            f"    from {stem}_passive import install",
            "    install(model)                          # from now on every mj_step has it",
            "    install(model, memory=True)             # for mj_inverse: dry friction to the letter",
            "",
            "MuJoCo's own dry friction (frictionloss) keeps a simulation stable and lets an axis stick. The twin's",
            "keeps its direction while an axis slows down and turns over a small speed after a reversal;",
            "memory=True switches frictionloss off and does that, which only an inverse dynamics should ask for.",
            *left_out_lines(native),
        ]
    )
    numbers_ = literal(native.rest | {"joints": names, "whole": native.dry})
    return f'"""{head}\n"""\n\n{core}\n\n\nDATA = {numbers_}\n\n\n{own}\n'


def left_out_lines(native: Native) -> list[str]:
    """Return a line for what neither file can hold."""
    return [f"left out: {', '.join(native.inexpressible)}"] if native.inexpressible else []


def mjcf_lines(twin: Twin, inverse: Inverse) -> list[str]:
    """Return what the two files leave out, a line each."""
    lines = left_out_lines(split(inverse.data))
    odd = impossible_bodies(twin.model)
    if odd:
        lines.append(f"MuJoCo balances the inertia of {', '.join(odd)}: what was identified cannot exist")
    lost = geometry_of(twin.machine.urdf, twin.machine.model).lost
    if lost:
        lines.append(f"{lost} shapes are not drawn: MuJoCo reads meshes as STL and OBJ, and from a file")
    return lines


def armature(native: Native) -> Floats:
    """Return the rotor inertia on the diagonal of MuJoCo's mass matrix, shape (nv,)."""
    out = native.armature.copy()
    for tie in native.ties:
        out[list(tie.joints)] += tie.armature
    return out
