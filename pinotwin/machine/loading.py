"""machine.yaml, or a bare URDF, to :class:`Machine` and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinotwin.errors import InputError, MachineError, nearest
from pinotwin.machine import sections
from pinotwin.machine.bundled import bundled_path, machines, robots
from pinotwin.machine.machine import Machine
from pinotwin.machine.parts import Axis, Passive
from pinotwin.machine.urdf import check_inertia, load_model
from pinotwin.machine.urdf_check import MOVING, UNFIT, axis_names, moving_joints, read_tree
from pinotwin.machine.yaml_file import (
    DEFAULT_EFFECTS,
    check_keys,
    effect_spec,
    make_effects,
    mapping,
    number,
    read_yaml,
)
from pinotwin.system.writing import as_path

_REQUIRED = ("name", "urdf", "axes")
KEYS = (*_REQUIRED, "passive", "gravity", "imus", "loop", "columns", "transmission", "data", "meshes")
AXIS_KEYS = (
    "joint",
    "effects",
    "rotor_inertia",
    "effort_limit",
    "zero",
    "min_speed",
    "min_acceleration",
    "lead",
)


def load_machine(path: str | Path) -> Machine:
    """See :meth:`Machine.load`."""
    given = as_path(path, "path")
    if not str(path).strip():
        raise MachineError(f"no machine named; give a folder, a .urdf, or one of {_bundled()}")
    if given.suffix == ".urdf":
        return _of_urdf(given)
    if not given.exists() and str(path) in machines():
        given = bundled_path(str(path))
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
            f"({_bundled()}) or a robot of example-robot-data"
        )
    return build(read_yaml(file), file)


def _bundled() -> str:
    return ", ".join(machines())


def _of_urdf(path: Path) -> Machine:
    """Return the machine of a bare URDF: every moving joint an axis with the default effects."""
    root = read_tree(path)
    axes = {name: {"joint": joint} for name, joint in axis_names(root).items()}
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


def _machine(spec: dict[str, Any], file: Path) -> Machine:
    check_keys(spec, KEYS, "")
    for key in _REQUIRED:
        if not spec.get(key):
            raise MachineError(f"{key}: missing; a machine needs name, urdf and axes")
    _check_words(spec)
    urdf = file.parent / str(spec["urdf"])
    axes_spec = mapping(spec["axes"], "axes.")
    passive_spec = mapping(spec.get("passive"), "passive.")
    joints = _joints(axes_spec, passive_spec)
    _check_joints(urdf, joints, tuple(axes_spec))
    model = load_model(urdf, list(joints.values()))
    model.gravity.linear = sections.gravity(spec)
    axes = {str(n): _axis(str(n), s, model) for n, s in axes_spec.items()}
    passive = {str(n): _passive(str(n), s, model) for n, s in passive_spec.items()}
    _apply_rotors(model, axes)
    check_inertia(model, str(urdf))
    _check_partners(axes)
    names = tuple(axes)
    return Machine(
        name=str(spec["name"]),
        path=file,
        urdf=urdf,
        model=model,
        axes=axes,
        passive=passive,
        imus=sections.imus(spec, urdf),
        loop=sections.loops(spec, names),
        columns=sections.columns(spec, (*axes, *passive), model),
        transmission=sections.transmission(spec, axes, model.nv),
        data=sections.data_settings(spec),
        spec=spec,
        meshes=_meshes(spec, file.parent),
    )


def _meshes(spec: Mapping[str, Any], folder: Path) -> tuple[Path, ...]:
    """Return the folders of meshes; one that does not exist costs a picture, never a result."""
    given = spec.get("meshes") or ()
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise MachineError(f"meshes: expected a folder or a list of folders, found {given!r}")
    return tuple((folder / name).resolve() for name in names)


def _check_words(spec: Mapping[str, Any]) -> None:
    """Refuse names that cannot name a file, a channel or an axis on the command line."""
    if isinstance(spec["name"], (list, dict)) or set("/\\\n") & set(str(spec["name"])):
        raise MachineError(f"name: {spec['name']!r} cannot name a file; use letters and digits")
    if str(spec["name"]).strip(". ") != str(spec["name"]):
        raise MachineError(f"name: {spec['name']!r} begins or ends with a dot or blank")
    if not isinstance(spec["urdf"], str):
        raise MachineError(f"urdf: expected the name of a file, found {spec['urdf']!r}")
    for key in ("name", "urdf"):
        if max(len(part) for part in str(spec[key]).split("/")) > 200 or len(str(spec[key])) > 2000:
            raise MachineError(f"{key}: {spec[key]!r} is too long to name a file; shorten it")
    for kind in ("axes", "passive"):
        for name in mapping(spec.get(kind), f"{kind}."):
            text = "" if name is None else str(name)
            if not text or text.strip() != text or UNFIT & set(text):
                way = f"{kind}: {{J1: {{joint: {text!r}}}}}"
                raise MachineError(f"{kind}: {name!r} cannot name an axis; give it a name of its own, {way}")


def _joints(axes: Mapping[str, Any], passive: Mapping[str, Any]) -> dict[str, str]:
    joints: dict[str, str] = {}
    for kind, group in (("axes", axes), ("passive", passive)):
        for name, settings in group.items():
            where = f"{kind}.{name}."
            joint = str(mapping(settings, where).get("joint", name))
            if str(name) in joints:
                raise MachineError(f"{where[:-1]}: this name is under axes and under passive")
            if joint in joints.values():
                raise MachineError(f"{where}joint: joint {joint!r} is used twice")
            joints[str(name)] = joint
    return joints


def _check_joints(urdf: Path, joints: Mapping[str, str], axes: tuple[str, ...]) -> None:
    """Refuse an axis or passive joint that the URDF does not have, or that is none."""
    root = read_tree(urdf)
    types = {str(j.get("name")): str(j.get("type")) for j in root.findall("joint")}
    for name, joint in joints.items():
        where = f"{'axes' if name in axes else 'passive'}.{name}.joint"
        if joint not in types:
            hint = nearest(joint, moving_joints(root))
            raise MachineError(f"{where}: no moving joint {joint!r} in {urdf.name}; {hint}")
        if types[joint] not in MOVING:
            raise MachineError(f"{where}: {joint!r} is {types[joint]}; an axis is one of {', '.join(MOVING)}")


def _place(name: str, settings: Mapping[str, Any], model: pin.Model) -> tuple[str, int, bool]:
    joint = str(settings.get("joint", name))
    at = model.getJointId(joint)
    return joint, int(model.idx_vs[at]), model.joints[at].shortname().startswith("JointModelR")


def _axis(name: str, settings: Any, model: pin.Model) -> Axis:
    where = f"axes.{name}."
    settings = mapping(settings, where)
    check_keys(settings, AXIS_KEYS, where)
    joint, index, rotary = _place(name, settings, model)
    effects = make_effects(settings.get("effects", DEFAULT_EFFECTS), name, rotary, f"{where}effects")
    rotor = number(settings.get("rotor_inertia", 0.0), f"{where}rotor_inertia")
    if rotor < 0.0:
        raise MachineError(f"{where}rotor_inertia: {rotor:g} is negative")
    speed = None if settings.get("min_speed") is None else settings["min_speed"]
    if speed is not None and number(speed, f"{where}min_speed") < 0.0:
        raise MachineError(f"{where}min_speed: {speed} is negative; a speed here has no sign")
    return Axis(
        name=name,
        joint=joint,
        index=index,
        rotary=rotary,
        effects=effects,
        rotor_inertia=rotor,
        effort_limit=_positive(settings, "effort_limit", where, np.inf),
        zero=number(settings.get("zero", 0.0), f"{where}zero"),
        min_speed=None if speed is None else number(speed, f"{where}min_speed"),
        min_acceleration=_positive(settings, "min_acceleration", where, np.inf),
        lead=None if settings.get("lead") is None else sections.seconds(settings["lead"], f"{where}lead"),
    )


def _positive(settings: Mapping[str, Any], key: str, where: str, default: float) -> float:
    if settings.get(key) is None:
        return default
    return number(settings[key], where + key, positive=True)


def _passive(name: str, settings: Any, model: pin.Model) -> Passive:
    where = f"passive.{name}."
    settings = mapping(settings, where)
    check_keys(settings, ("joint", "stiffness", "damping"), where)
    joint, index, rotary = _place(name, settings, model)
    values = {
        key: None if settings.get(key) is None else number(settings[key], where + key)
        for key in ("stiffness", "damping")
    }
    for key, value in values.items():
        if value is not None and value < 0.0:
            raise MachineError(f"{where}{key}: {value:g} is negative; correct it")
    return Passive(name, joint, index, rotary, values["stiffness"], values["damping"])


def _apply_rotors(model: pin.Model, axes: Mapping[str, Axis]) -> None:
    armature = np.zeros(model.nv)
    for axis in axes.values():
        armature[axis.index] = axis.rotor_inertia
    model.armature = armature


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
    spec = {key: value for key, value in machine.spec.items() if key in KEYS}
    spec["name"], spec["urdf"] = machine.name, machine.urdf.name
    old = mapping(machine.spec.get("axes"), "axes.")
    axes = {}
    for name, axis in machine.axes.items():
        entry = dict(mapping(old.get(name), "axes."))
        entry["joint"] = axis.joint
        entry["effects"] = [effect_spec(effect) for effect in axis.effects]
        for key, value, default in (
            ("rotor_inertia", axis.rotor_inertia, 0.0),
            ("effort_limit", axis.effort_limit, np.inf),
            ("zero", axis.zero, 0.0),
            ("min_speed", axis.min_speed, None),
            ("min_acceleration", axis.min_acceleration, np.inf),
            ("lead", axis.lead, None),
        ):
            entry.pop(key, None)
            if value is not None and value != default:
                entry[key] = float(value)
        axes[name] = entry
    spec["axes"] = axes
    pull = machine.model.gravity.linear.tolist()
    spec = {k: v for k, v in spec.items() if k != "gravity"} | (
        {} if tuple(pull) == sections.GRAVITY else {"gravity": pull}
    )
    if machine.meshes:
        spec["meshes"] = [str(folder) for folder in machine.meshes]
    data = sections.data_spec(machine.data)
    spec.pop("data", None)
    return {**spec, "data": data} if data else spec
