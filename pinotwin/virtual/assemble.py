"""Build the true tree of a machine from its URDF and its truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import MachineError, nearest
from pinotwin.virtual.axis_truth import AxisTruth
from pinotwin.virtual.defaults import Scale, fallback, resolved_axis, resolved_limits, scales
from pinotwin.virtual.doses import Body
from pinotwin.virtual.folder import Folder
from pinotwin.virtual.parameters import Layout
from pinotwin.virtual.rigid import Tree
from pinotwin.virtual.tree import perturbed, tilted, with_hidden_joint, with_payload
from pinotwin.virtual.truth import Passive, Truth
from pinotwin.virtual.withholding import changed


def resolve(folder: Folder, model: pin.Model, cad: Tree) -> tuple[Truth, dict[str, Scale]]:
    """Return the truth without gaps, and the reference sizes of every axis."""
    truth, joints = folder.truth, {n: model.getJointId(j) - 1 for n, j in folder.axes.items()}
    rng = np.random.default_rng([truth.seed, 2])
    given = [("axis", n, folder.axes) for n in truth.axes]
    for kind, name, known in [*given, *(("passive joint", n, folder.passive) for n in truth.passive)]:
        if name not in known:
            raise MachineError(f"{folder.name}: virtual.yaml: no {kind} {name!r}; {nearest(name, known)}")
    axes: dict[str, AxisTruth] = {}
    travels = np.zeros((model.nv, 2))
    for name, j in joints.items():
        axis = truth.axes.get(name, AxisTruth())
        limits = resolved_limits(axis.limits, model, j, bool(cad.rotary[j]))
        off = 1.0 + rng.choice((-1.0, 1.0)) * rng.uniform(*truth.inertial_error)
        axis = changed(axis, "drive", rotor=fallback(axis.drive.rotor, folder.rotors.get(name, 0.0) * off))
        top = axis.controller.effort_limit or folder.limits.get(name)
        axes[name] = replace(changed(axis, "controller", effort_limit=top), limits=limits)
        travels[j] = limits.travel or (0.0, 0.0)
    sizes = scales(cad, joints, axes, travels)
    axes = {name: resolved_axis(axis, sizes[name]) for name, axis in axes.items()}
    passive = {n: truth.passive.get(n, Passive(frequency=25.0)) for n in folder.passive}
    return replace(truth, axes=axes, passive=passive), sizes


def true_tree(
    truth: Truth, folder: Folder, model: pin.Model, cad: Tree
) -> tuple[Tree, Layout, tuple[str, ...]]:
    """Return the true tree, where the names sit in it, and the name of every joint.

    Inertials are perturbed first, with the machine's own seed, so that switching an effect on or
    off never changes them.
    """
    tree = perturbed(cad, truth.inertial_error, np.random.default_rng([truth.seed, 1]))
    index = {n: model.getJointId(j) - 1 for n, j in {**folder.axes, **folder.passive}.items()}
    joint_of = {name: i for i, name in enumerate(list(model.names)[1:])}
    for load in truth.payload:
        if load.joint not in joint_of:
            raise MachineError(f"payload: no joint {load.joint!r}; {nearest(load.joint, joint_of)}")
        tree = with_payload(tree, joint_of[load.joint], load.mass, np.array(load.centre))
    for name, axis in truth.axes.items():
        if any(axis.tilt):
            tree = tilted(tree, index[name], np.array(axis.tilt))
    armature = tree.armature.copy()
    for name, axis in truth.axes.items():
        rotor = axis.drive.rotor or 0.0
        if axis.drive.frequency == 0.0:
            armature[index[name]] += rotor
        elif axis.drive.inside and axis.bend is None:
            armature[index[name]] -= rotor
    return _with_bends(truth, folder, model, tree._replace(armature=armature), index)


def _with_bends(
    truth: Truth, folder: Folder, model: pin.Model, tree: Tree, index: Mapping[str, int]
) -> tuple[Tree, Layout, tuple[str, ...]]:
    home = np.zeros(model.nv)
    for name, axis in truth.axes.items():
        home[index[name]] = float(np.mean(axis.limits.travel or (0.0, 0.0)))
    links = list(model.names)[1:]
    names = list(links)
    bend: dict[str, int] = {}
    at = {j: j for j in range(model.nv)}  # CAD joint -> its drive joint in the true tree
    for name in sorted(folder.axes, key=lambda n: -index[n]):
        spec, j = truth.axes[name].bend, index[name]
        if spec is None:
            continue
        tree = with_hidden_joint(tree, j, spec.share)
        home = np.insert(home, j + 1, 0.0)
        names.insert(j + 1, f"{names[j]}~")
        at = {k: v + (k > j) for k, v in at.items()}
        bend = {**{k: v + 1 for k, v in bend.items()}, name: j + 1}
    drive = {n: at[index[n]] for n in folder.axes}
    behind = {drive[n]: j for n, j in bend.items()}
    layout = Layout(
        axes=tuple(folder.axes),
        drive=drive,
        body={n: behind.get(at[k], at[k]) for k, n in enumerate(links)},
        passive={n: at[index[n]] for n in folder.passive},
        bend=bend,
        home=home,
        group=_groups(tree, list(drive.values())),
    )
    return tree, layout, tuple(names)


def _groups(tree: Tree, drives: list[int]) -> Ints:
    group = np.full(len(tree.mass), -1, dtype=np.intp)
    for j in range(len(group)):
        parent = int(tree.parent[j])
        group[j] = drives.index(j) if j in drives else (group[parent] if parent >= 0 else -1)
    return group


def link_frames(model: pin.Model, layout: Layout) -> dict[str, tuple[int, Floats, Floats]]:
    """Return, for every link of the URDF, its joint in the true tree and its frame there."""
    links = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0]
    return {
        f.name: (
            layout.body[model.names[f.parentJoint]],
            np.array(f.placement.rotation),
            np.array(f.placement.translation),
        )
        for f in links
    }


def bodies_of(folder: Folder, model: pin.Model, cad: Tree) -> dict[str, Body]:
    """Return what each axis moves."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    out = {}
    for name, joint in folder.axes.items():
        i = model.getJointId(joint)
        links = (f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == i)
        own, world = (tuple(map(float, x)) for x in (cad.axis[i - 1], data.oMi[i].rotation @ cad.axis[i - 1]))
        out[name] = Body(joint, next(links, ""), own, world, float(cad.mass[i - 1]) or 1.0)
    return out
