"""A ``pin.Model`` that came without a file, as a machine: its tree is written out as a URDF.

A machine is saved, viewed and written back as one; what a URDF cannot say is refused here, not when that is done.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.dynamics.parameters import joint_axis
from pinotwin.effects import Effect
from pinotwin.errors import MachineError, nearest
from pinotwin.machine.loading import build
from pinotwin.machine.machine import Machine
from pinotwin.machine.urdf import inertial_element, load_model, with_inertias, written

_KINDS = {"JointModelRUB": "continuous", "JointModelR": "revolute", "JointModelP": "prismatic"}


def machine_of_model(
    model: pin.Model,
    axes: Iterable[str] | Mapping[str, Any] | None,
    name: str | None,
    effects: Iterable[Any] | None = None,
) -> Machine:
    """See :meth:`Machine.from_model`."""
    title = name or model.name or "robot"
    if np.any(model.gravity.angular):
        raise MachineError(
            f"{title}: model.gravity.angular is not zero: {model.gravity.angular.tolist()}; set it to zero"
        )
    single = {str(model.names[i]): i for i in range(1, model.njoints) if _kind(model, i)}
    chosen = _axes(title, axes, single)
    model = _locked(title, model, single)
    rotors = {str(model.names[i]): float(model.armature[model.idx_vs[i]]) for i in range(1, model.njoints)}
    usual = None if effects is None else list(effects)
    settings = {axis: _settings(axis, given, rotors, usual) for axis, given in chosen.items()}
    urdf = new_folder() / "model.urdf"
    urdf.write_bytes(urdf_of_model(model, title))
    pull = model.gravity.linear.tolist()
    return build({"name": title, "urdf": urdf.name, "gravity": pull, "axes": settings}, urdf)


def with_bodies(machine: Machine, model: pin.Model) -> Machine:
    """Return the machine with the inertias and rotor inertias of another model of its joints, in hand."""
    axes = {
        k: replace(a, rotor_inertia=max(float(model.armature[a.index]), 0.0)) for k, a in machine.axes.items()
    }
    urdf = new_folder() / machine.urdf.name
    urdf.write_bytes(with_inertias(machine.urdf, model))
    other = load_model(urdf, [part.joint for part in machine.parts])
    other.armature = model.armature.copy()
    return replace(machine, urdf=urdf, model=other, axes=axes)


def new_folder() -> Path:
    """Return a new folder that goes when this process ends."""
    return Path(tempfile.mkdtemp(dir=_scratch().name))


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="pinotwin-")


def _kind(model: pin.Model, joint: int) -> str:
    """Return the URDF type of a joint, or nothing for one that a URDF does not have."""
    name = model.joints[joint].shortname()
    if model.joints[joint].nv != 1 or "Mimic" in name:
        return ""
    return next((kind for start, kind in _KINDS.items() if name.startswith(start)), "")


def _axes(title: str, axes: Any, single: Mapping[str, int]) -> dict[str, Any]:
    """Return joint -> what is said of the axis, for the joints that were asked for."""
    if isinstance(axes, str):
        raise MachineError(f"{title}: axes: expected names of joints, found the text {axes!r}")
    given = dict(axes) if isinstance(axes, Mapping) else dict.fromkeys(single if axes is None else axes)
    for joint, settings in given.items():
        named = settings.get("joint", joint) if isinstance(settings, Mapping) else joint
        if named not in single:
            raise MachineError(f"{title}: no moving joint {named!r} of one axis; {nearest(named, single)}")
    if not given:
        raise MachineError(f"{title}: no joint of it can be an axis (revolute, continuous, prismatic)")
    return given


def _settings(axis: str, given: Any, rotors: Mapping[str, float], usual: list[Any] | None) -> dict[str, Any]:
    """Return an axis' part of machine.yaml from nothing, a list of effects, or the part itself."""
    out = dict(given) if isinstance(given, Mapping) else {} if given is None else {"effects": given}
    out.setdefault("joint", axis)
    out.setdefault("rotor_inertia", rotors[out["joint"]])
    if usual is not None:
        out.setdefault("effects", [e for e in usual if not isinstance(e, Effect) or e.axis == axis])
    return out


def _locked(title: str, model: pin.Model, single: Mapping[str, int]) -> pin.Model:
    """Return the model with the joints that a URDF does not have locked where they are neutral."""
    mimics = [n for n, j in zip(model.names, model.joints, strict=True) if "Mimic" in j.shortname()]
    if mimics:
        raise MachineError(f"{title}: mimic joints {mimics} are not supported; build it with mimic=False")
    others = [i for i in range(1, model.njoints) if i not in single.values()]
    return pin.buildReducedModel(model, others, pin.neutral(model)) if others else model


def urdf_of_model(model: pin.Model, name: str) -> bytes:
    """Return a model of revolute, continuous and prismatic joints as URDF text, without rotor inertias and geometry."""
    root = etree.Element("robot", name=name)
    links = _links(model)
    for joint, link in enumerate(links):
        element = etree.SubElement(root, "link", name=link)
        if joint and np.any(model.inertias[joint].toDynamicParameters()):
            element.append(inertial_element(model.inertias[joint]))
    for joint in range(1, model.njoints):
        element = _joint(root, str(model.names[joint]), _kind(model, joint), model.jointPlacements[joint])
        etree.SubElement(element, "parent", link=links[model.parents[joint]])
        etree.SubElement(element, "child", link=links[joint])
        etree.SubElement(element, "axis", xyz=written(joint_axis(model, joint)[1]))
        etree.SubElement(element, "limit", _limits(model, joint))
        at = model.idx_vs[joint]
        lost = {"damping": model.damping[at], "friction": model.upperDryFrictionLimit[at]}
        if any(lost.values()):
            etree.SubElement(element, "dynamics", {key: repr(float(x)) for key, x in lost.items()})
    taken = {*links, *map(str, model.names)}
    for frame in model.frames:
        if frame.name in taken or frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT):
            continue
        taken.add(frame.name)
        etree.SubElement(root, "link", name=frame.name)
        element = _joint(root, f"{frame.name}_fixed", "fixed", frame.placement)
        etree.SubElement(element, "parent", link=links[frame.parentJoint])
        etree.SubElement(element, "child", link=frame.name)
    return etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True)


def _links(model: pin.Model) -> list[str]:
    """Return a name for the link of the base and of every joint: that of its body frame if it has one."""
    out: list[str] = []
    for joint in range(model.njoints):
        bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == joint]
        names = [str(f.name) for f in bodies if f.placement.isIdentity(1e-12)]
        out.append(next((n for n in names if n not in out), f"{model.names[joint]}_link"))
    return out


def _joint(root: etree._Element, name: str, kind: str, place: pin.SE3) -> etree._Element:
    element = etree.SubElement(root, "joint", name=name, type=kind)
    rpy = written(pin.rpy.matrixToRpy(place.rotation))
    etree.SubElement(element, "origin", xyz=written(place.translation), rpy=rpy)
    return element


def _limits(model: pin.Model, joint: int, wide_open: float = 1e9) -> dict[str, str]:
    """Return effort, velocity and range; an end that is not finite, or only a placeholder, is left wide open."""
    at = model.idx_vs[joint]
    wide = {"effort": model.upperEffortLimit[at], "velocity": model.upperVelocityLimit[at]}
    out = {key: repr(min(float(x), wide_open)) for key, x in wide.items()}
    if _kind(model, joint) != "continuous":
        q = model.idx_qs[joint]
        ends = (float(model.lowerPositionLimit[q]), float(model.upperPositionLimit[q]))
        out["lower"], out["upper"] = (repr(float(np.clip(x, -wide_open, wide_open))) for x in ends)
    return out
