"""machine.yaml to :class:`Machine` and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.columns import parse_columns
from pinotwin.errors import InputError, MachineError, nearest
from pinotwin.machine.bundled import bundled_path, machines
from pinotwin.machine.machine import Axis, DataSettings, Imu, LoopShape, Machine, Passive
from pinotwin.machine.urdf import check_inertia, load_model
from pinotwin.machine.urdf_check import mimics, moving_joints, read_tree
from pinotwin.machine.yaml_file import (
    DEFAULT_EFFECTS,
    check_keys,
    effect_spec,
    make_effects,
    mapping,
    number,
    read_yaml,
)

KEYS = ("name", "urdf", "axes", "passive", "imus", "loop", "columns", "transmission", "data")
AXIS_KEYS = ("joint", "effects", "rotor_inertia", "effort_limit", "zero", "min_speed")


def load_machine(path: str | Path) -> Machine:
    """See :meth:`Machine.load`."""
    given = Path(path)
    if given.suffix == ".urdf":
        root = read_tree(given)
        followers = mimics(root)  # they have no motor of their own
        axes = {name: {"joint": name} for name in moving_joints(root) if name not in followers}
        spec: dict[str, Any] = {"name": given.stem, "urdf": given.name, "axes": axes}
        return _build(spec, given)
    if not given.exists() and str(path) in machines():
        given = bundled_path(str(path))
    file = given / "machine.yaml" if given.is_dir() else given
    if given.is_dir() and not file.is_file():
        raise MachineError(f"{given}: no machine.yaml in this folder")
    if not file.exists() and len(given.parts) == 1:
        raise MachineError(
            f"{path}: no such machine; give a folder, a machine.yaml, a .urdf, or a bundled one "
            f"({', '.join(machines())})"
        )
    return _build(read_yaml(file), file)


def _build(spec: dict[str, Any], file: Path) -> Machine:
    try:
        return _machine(spec, file)
    except InputError as error:
        if str(file.parent) in str(error) or str(file) in str(error):
            raise
        raise type(error)(f"{file}: {error}") from None


def _machine(spec: dict[str, Any], file: Path) -> Machine:
    check_keys(spec, KEYS, "")
    for key in ("name", "urdf", "axes"):
        if not spec.get(key):
            raise MachineError(f"{key}: missing; a machine needs name, urdf and axes")
    urdf = file.parent / str(spec["urdf"])
    axes_spec = mapping(spec["axes"], "axes.")
    passive_spec = mapping(spec.get("passive"), "passive.")
    joints = _joints(axes_spec, passive_spec)
    model = load_model(urdf, list(joints.values()))
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
        imus=_imus(spec, urdf),
        loop=_loops(spec, names),
        columns=parse_columns(mapping(spec.get("columns"), "columns."), "columns"),
        transmission=_transmission(spec, axes, model.nv),
        data=_data(spec),
        spec=spec,
    )


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


def _place(name: str, settings: Mapping[str, Any], model: pin.Model) -> tuple[str, int, bool]:
    joint = str(settings.get("joint", name))
    at = model.getJointId(joint)
    return joint, int(model.idx_vs[at]), model.joints[at].shortname().startswith("JointModelR")


def _axis(name: str, settings: Any, model: pin.Model) -> Axis:
    where = f"axes.{name}."
    settings = mapping(settings, where)
    check_keys(settings, AXIS_KEYS, where)
    joint, index, rotary = _place(name, settings, model)
    effects = make_effects(
        settings.get("effects", DEFAULT_EFFECTS), name, rotary, f"{where}effects"
    )
    rotor = number(settings.get("rotor_inertia", 0.0), f"{where}rotor_inertia")
    if rotor < 0.0:
        raise MachineError(f"{where}rotor_inertia: {rotor:g} is negative")
    speed = settings.get("min_speed")
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


def _imus(spec: Mapping[str, Any], urdf: Path) -> dict[str, Imu]:
    links = [str(link.get("name")) for link in read_tree(urdf).findall("link")]
    out = {}
    for name, settings in mapping(spec.get("imus"), "imus.").items():
        settings = mapping(settings, f"imus.{name}.")
        check_keys(settings, ("link",), f"imus.{name}.")
        link = str(settings.get("link", ""))
        if link not in links:
            raise MachineError(f"imus.{name}.link: no link {link!r}; {nearest(link, links)}")
        out[str(name)] = Imu(str(name), link)
    return out


def _loops(spec: Mapping[str, Any], axes: tuple[str, ...]) -> dict[str, LoopShape]:
    out = {}
    for name, settings in mapping(spec.get("loop"), "loop.").items():
        check_keys({name: None}, axes, "loop.")
        settings = mapping(settings, f"loop.{name}.")
        check_keys(settings, ("real_poles", "pole_pairs"), f"loop.{name}.")
        counts = {k: int(number(v, f"loop.{name}.{k}")) for k, v in settings.items()}
        shape = LoopShape(**counts)
        if shape.real_poles < 0 or shape.pole_pairs < 0 or shape.real_poles + shape.pole_pairs < 1:
            raise MachineError(f"loop.{name}: needs at least one pole")
        out[str(name)] = shape
    return out


def _transmission(spec: Mapping[str, Any], axes: Mapping[str, Axis], nv: int) -> Floats | None:
    rows = mapping(spec.get("transmission"), "transmission.")
    if not rows:
        return None
    matrix = np.eye(nv)
    for motor, row in rows.items():
        check_keys({motor: None}, tuple(axes), "transmission.")
        row = mapping(row, f"transmission.{motor}.")
        check_keys(row, tuple(axes), f"transmission.{motor}.")
        matrix[axes[motor].index] = 0.0
        for joint, ratio in row.items():
            matrix[axes[motor].index, axes[joint].index] = number(
                ratio, f"transmission.{motor}.{joint}"
            )
    if abs(np.linalg.det(matrix)) < 1e-12:
        raise MachineError("transmission: the matrix is singular; every joint needs a motor")
    return matrix


def _data(spec: Mapping[str, Any]) -> DataSettings:
    given = mapping(spec.get("data"), "data.")
    known = tuple(f.name for f in dataclasses.fields(DataSettings))
    check_keys(given, known, "data.")
    settings = DataSettings()
    for key, value in given.items():
        if key == "filter_effort":
            if str(value).lower() not in ("true", "false"):
                raise MachineError(f"data.{key}: expected true or false, found {value!r}")
            settings = replace(settings, filter_effort=str(value).lower() == "true")
            continue
        settings = replace(settings, **{key: _data_value(key, value)})
    return settings


def _data_value(key: str, value: Any) -> Any:
    where = f"data.{key}"
    if key == "drop":
        ends = value if isinstance(value, list) else [value, value]
        if len(ends) != 2:
            raise MachineError(f"{where}: expected samples at the start and the end, found {value!r}")
        return tuple(max(int(number(x, where)), 0) for x in ends)
    x = number(value, where, positive=True)
    return x if key == "cutoff" else int(x)


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
        if axis.rotor_inertia or "rotor_inertia" in entry:
            entry["rotor_inertia"] = float(axis.rotor_inertia)
        axes[name] = entry
    spec["axes"] = axes
    return spec
