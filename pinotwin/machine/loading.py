"""machine.yaml, or a bare URDF, to :class:`Machine` and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinotwin.errors import InputError, MachineError, nearest
from pinotwin.machine import sections
from pinotwin.machine.bundled import machines, robots
from pinotwin.machine.effect_list import effect_spec, make_effects
from pinotwin.machine.machine import Machine
from pinotwin.machine.parts import Axis, MachineFile, Passive
from pinotwin.machine.urdf import idle_joints, load_model
from pinotwin.machine.urdf_check import MOVING, UNFIT, axis_names, moving_joints, read_tree
from pinotwin.machine.yaml_file import read_yaml
from pinotwin.system.reading import kinds_of, read
from pinotwin.system.writing import as_path

DEFAULT_EFFECTS = ("viscous", "coulomb")
GRAVITY = MachineFile.gravity
"""Acceleration of gravity of a machine that stands on the floor, in the axes of the URDF's root [m/s²]."""
REQUIRED = ("name", "urdf", "axes")


def load_machine(path: str | Path) -> Machine:
    """See :meth:`Machine.load`."""
    given = as_path(path, "path")
    if not str(path).strip():
        raise MachineError(f"no machine named; give a folder, a .urdf, or one of {', '.join(machines())}")
    if given.suffix == ".urdf":
        return _of_urdf(given)
    if not given.exists() and str(path) in machines():
        given = machines()[str(path)]
    if not given.exists() and str(path) in robots():
        return _of_urdf(robots()[str(path)])
    file = given / "machine.yaml" if given.is_dir() else given
    if given.is_dir() and not file.is_file():
        found = ", ".join(sorted(f.name for f in given.glob("*.urdf"))) or "no .urdf either"
        raise MachineError(
            f"{given}: no machine.yaml in this folder (found: {found}); write one, or give a .urdf"
        )
    if not file.exists() and len(given.parts) == 1:
        more = nearest(str(path), [*machines(), *robots()])
        raise MachineError(
            f"{path}: no such machine; {more}; give a folder, a machine.yaml, a .urdf, a bundled one "
            f"({', '.join(machines())}) or a robot of example-robot-data"
        )
    return build(read_yaml(file), file)


def _of_urdf(path: Path) -> Machine:
    """Return the machine of a bare URDF: every moving joint an axis with the default effects."""
    axes = {name: {"joint": joint} for name, joint in axis_names(read_tree(path)).items()}
    if not axes:
        raise MachineError(f"{path}: no joint of it can be an axis ({', '.join(MOVING)})")
    return build({"name": path.stem, "urdf": path.name, "axes": axes}, path)


def build(spec: dict[str, Any], file: Path) -> Machine:
    """Return the machine of a mapping as in machine.yaml; ``file`` is where it stands, or would."""
    try:
        return _machine(spec, file)
    except InputError as error:
        said = " ".join(str(error).splitlines())  # a key may hold a line break
        where = "" if str(file.parent) in said else f"{file}: "
        raise type(error)(where + said) from None


def _machine(spec: dict[str, Any], path: Path) -> Machine:
    file = read(spec, MachineFile, "")
    for key in REQUIRED:
        if not file.get(key):
            raise MachineError(f"{key}: missing; a machine needs name, urdf and axes")
    mapped = file.get("columns", {})
    efforts, weightless = sections.efforts(file["axes"], file.get("effort"), mapped)
    if efforts:
        spec = {**spec, "columns": {**mapped, **efforts}}
    parts = {"axes": file["axes"], "passive": file.get("passive", {})}
    _check_words(file["name"], file["urdf"], parts)
    urdf = path.parent / file["urdf"]
    joints = _joints(urdf, parts)
    model = load_model(urdf, list(joints.values()))
    model.gravity.linear = np.zeros(3) if weightless else np.array(file.get("gravity", GRAVITY))
    places = {name: _place(name, joint, model) for name, joint in joints.items()}
    axes = {name: _axis(places[name], stated) for name, stated in parts["axes"].items()}
    passive = {name: Passive(**{**stated, **places[name]}) for name, stated in parts["passive"].items()}
    model.armature = np.zeros(model.nv)
    for axis in axes.values():
        model.armature[axis.index] = axis.rotor_inertia
    for joint in idle_joints(model)[:1]:
        raise MachineError(
            f"{urdf}: joint {joint!r} moves no inertia (massless link); give its "
            "link an <inertial> or the axis a rotor_inertia, or leave it out of the axes"
        )
    _check_partners(axes)
    given = file.get("meshes") or []
    meshes = [given] if isinstance(given, str) else given
    return Machine(
        name=file["name"],
        path=path,
        urdf=urdf,
        model=model,
        axes=axes,
        passive=passive,
        imus=sections.imus(file.get("imus", {}), urdf),
        loop=sections.loops(file, tuple(axes)),
        columns=sections.columns({**mapped, **efforts}, (*axes, *passive), model),
        transmission=sections.transmission(file.get("transmission", {}), axes, model.nv),
        data=sections.data_settings(file.get("data", {})),
        spec=spec,
        meshes=tuple((path.parent / folder).resolve() for folder in meshes),
    )


def _check_words(name: str, urdf: str, parts: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse names that cannot name a file, a channel or an axis on the command line."""
    if set("/\\\n") & set(name):
        raise MachineError(f"name: {name!r} cannot name a file; use letters and digits")
    if name.strip(". ") != name:
        raise MachineError(f"name: {name!r} begins or ends with a dot or blank")
    for key, text in (("name", name), ("urdf", urdf)):
        if max(len(part) for part in text.split("/")) > 200 or len(text) > 2000:
            raise MachineError(f"{key}: {text!r} is too long to name a file; shorten it")
    for kind, names in parts.items():
        for one in names:
            if not one or one.strip() != one or UNFIT & set(one):
                way = f"{kind}: {{J1: {{joint: {one!r}}}}}"
                raise MachineError(f"{kind}: {one!r} cannot name an axis; give it a name of its own, {way}")


def _joints(urdf: Path, parts: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return axis or passive name -> its joint in the URDF, used once and of a kind that can be an axis."""
    root = read_tree(urdf)
    types = {str(j.get("name")): str(j.get("type")) for j in root.findall("joint")}
    joints: dict[str, str] = {}
    for kind, names in parts.items():
        for name, stated in names.items():
            joint, where = stated.get("joint", name), f"{kind}.{name}.joint"
            if name in joints:
                raise MachineError(f"{kind}.{name}: this name is under axes and under passive")
            if joint in joints.values():
                raise MachineError(f"{where}: joint {joint!r} is used twice")
            if joint not in types:
                hint = nearest(joint, moving_joints(root))
                raise MachineError(f"{where}: no moving joint {joint!r} in {urdf.name}; {hint}")
            if types[joint] not in MOVING:
                kinds = ", ".join(MOVING)
                raise MachineError(f"{where}: {joint!r} is {types[joint]}; an axis is one of {kinds}")
            joints[name] = joint
    return joints


def _place(name: str, joint: str, model: pin.Model) -> dict[str, Any]:
    at = model.getJointId(joint)
    rotary = model.joints[at].shortname().startswith("JointModelR")
    return {"name": name, "joint": joint, "index": int(model.idx_vs[at]), "rotary": rotary}


def _axis(place: Mapping[str, Any], stated: Mapping[str, Any]) -> Axis:
    where = f"axes.{place['name']}"
    listed = stated.get("effects", DEFAULT_EFFECTS)
    effects = make_effects(listed, place["name"], place["rotary"], f"{where}.effects")
    lead = {"lead": sections.seconds(stated["lead"], f"{where}.lead")} if "lead" in stated else {}
    return Axis(**{**stated, **lead, **place, "effects": effects})


def _check_partners(axes: Mapping[str, Axis]) -> None:
    for axis in axes.values():
        for effect in axis.effects:
            partner = getattr(effect, "partner", None)
            if partner is not None and (partner not in axes or partner == axis.name):
                raise MachineError(
                    f"axes.{axis.name}.effects: {effect.name} needs `with:` another axis; "
                    f"{nearest(str(partner), set(axes) - {axis.name})}"
                )


def machine_spec(machine: Machine) -> dict[str, Any]:
    """Return the mapping that :func:`load_machine` turns into the same machine."""
    spec = {key: value for key, value in machine.spec.items() if key not in ("gravity", "data")}
    spec["name"], spec["urdf"] = machine.name, machine.urdf.name
    spec["axes"] = {}
    usual = {f.name: f.default for f in dataclasses.fields(Axis)}
    for name, axis in machine.axes.items():
        numbers = {key: getattr(axis, key) for key in tuple(kinds_of(Axis))[2:]}
        stated = {key: float(x) for key, x in numbers.items() if x not in (None, usual[key])}
        effects = [effect_spec(effect) for effect in axis.effects]
        spec["axes"][name] = {"joint": axis.joint, "effects": effects, **stated}
    pull = machine.model.gravity.linear.tolist()
    if tuple(pull) != GRAVITY:
        spec["gravity"] = pull
    if machine.meshes:
        spec["meshes"] = [str(folder) for folder in machine.meshes]
    data = sections.data_spec(machine.data)
    return {**spec, "data": data} if data else spec
