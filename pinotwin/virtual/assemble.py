"""Build the true machine from its URDF and its truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinotwin.errors import MachineError, require
from pinotwin.virtual.amounts import Body
from pinotwin.virtual.axis_truth import AxisTruth
from pinotwin.virtual.defaults import Scale, filled, resolved_axis, resolved_limits, scales
from pinotwin.virtual.folder import Folder
from pinotwin.virtual.parameters import Layout
from pinotwin.virtual.tree import assembled, axes_of, links_of, perturbed
from pinotwin.virtual.truth import Passive, Truth
from pinotwin.virtual.withholding import changed


def resolve(folder: Folder, model: pin.Model, cad: pin.Model) -> tuple[Truth, dict[str, Scale]]:
    """Return the truth without gaps, and the reference sizes of every axis."""
    truth, joints = folder.truth, {n: model.getJointId(j) - 1 for n, j in folder.axes.items()}
    rng = np.random.default_rng([truth.seed, 2])
    given = [("axis", n, folder.axes) for n in truth.axes]
    for kind, name, known in [*given, *(("passive joint", n, folder.passive) for n in truth.passive)]:
        require(name, known, f"{folder.name}: virtual.yaml: no {kind}", MachineError)
    axes: dict[str, AxisTruth] = {}
    rotary, _ = axes_of(cad)
    travels = np.zeros((model.nv, 2))
    for name, j in joints.items():
        axis = truth.axes.get(name, AxisTruth())
        limits = resolved_limits(axis.limits, model, j, bool(rotary[j]))
        off = 1.0 + rng.choice((-1.0, 1.0)) * rng.uniform(*truth.inertial_error)
        axis = replace(axis, drive=filled(axis.drive, rotor=folder.rotors.get(name, 0.0) * off))
        top = axis.controller.effort_limit or folder.limits.get(name)
        axes[name] = replace(changed(axis, "controller", effort_limit=top), limits=limits)
        travels[j] = limits.travel or (0.0, 0.0)
    sizes = scales(cad, joints, axes, travels)
    axes = {name: resolved_axis(axis, sizes[name]) for name, axis in axes.items()}
    passive = {n: truth.passive.get(n, Passive(frequency=25.0)) for n in folder.passive}
    return replace(truth, axes=axes, passive=passive), sizes


def true_model(truth: Truth, folder: Folder, model: pin.Model) -> tuple[pin.Model, Layout]:
    """Return the true machine, inertials perturbed by its own seed first, and where the names sit in it."""
    bodies = perturbed(model, truth.inertial_error, np.random.default_rng([truth.seed, 1]))
    names = list(model.names)[1:]
    for load in truth.payload:
        require(load.joint, names, "payload: no joint", MachineError)
        bodies[names.index(load.joint)] += pin.Inertia(load.mass, np.array(load.centre), np.zeros((3, 3)))
    specs = {folder.axes[name]: axis for name, axis in truth.axes.items()}
    tilts = {joint: axis.tilt for joint, axis in specs.items()}
    bends = {joint: axis.bend.share for joint, axis in specs.items() if axis.bend is not None}
    true = assembled(model, bodies, tilts, bends)
    layout = _layout(truth, folder, true)
    armature = np.zeros(true.nv)
    for name, j in layout.drive.items():
        drive, rotor = truth.axes[name].drive, truth.axes[name].drive.rotor or 0.0
        if drive.frequency == 0.0:
            armature[j] += rotor
        elif drive.inside and name not in layout.bend:
            armature[j] -= rotor
    true.armature = armature
    return true, layout


def _layout(truth: Truth, folder: Folder, true: pin.Model) -> Layout:
    names = list(true.names)[1:]
    drive = {axis: names.index(joint) for axis, joint in folder.axes.items()}
    home, group = np.zeros(true.nv), np.full(true.nv, -1, dtype=np.intp)
    for axis, j in drive.items():
        home[j] = float(np.mean(truth.axes[axis].limits.travel or (0.0, 0.0)))
    drives = list(drive.values())
    for j, parent in enumerate(list(true.parents)[1:]):
        group[j] = drives.index(j) if j in drives else (group[parent - 1] if parent > 0 else -1)
    return Layout(
        axes=tuple(drive),
        drive=drive,
        passive={name: names.index(joint) for name, joint in folder.passive.items()},
        bend={axis: j + 1 for axis, j in drive.items() if truth.axes[axis].bend is not None},
        home=home,
        group=group,
    )


def bodies_of(folder: Folder, model: pin.Model) -> dict[str, Body]:
    """Return what each axis moves."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    out, (_, axes) = {}, axes_of(model)
    for name, joint in folder.axes.items():
        i = model.getJointId(joint)
        links = (link for link, frame in links_of(model).items() if frame.parentJoint == i)
        own, world = (tuple(map(float, x)) for x in (axes[i - 1], data.oMi[i].rotation @ axes[i - 1]))
        out[name] = Body(joint, next(links, ""), own, world, float(model.inertias[i].mass) or 1.0)
    return out
