"""A twin on disk: the machine it belongs to, the identified URDF, and what a person reads in ``twin.json`` (versioned).

``covariance.npz`` (array ``lower``: the lower triangle, row by row) holds the covariance of the coefficients and the
moments of the rows, ``misfit.npz`` what the twin keeps of its own logs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NotRequired, TypedDict, get_type_hints

import msgspec
import numpy as np
import pinocchio as pin
import yaml

from pinotwin.arrays import Floats, plain
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.errors import TwinError
from pinotwin.machine import Machine
from pinotwin.machine.loading import machine_spec
from pinotwin.machine.urdf import no_urdf_holds, with_inertias
from pinotwin.machine.yaml_file import read_yaml
from pinotwin.system.writing import write_bytes, write_text
from pinotwin.twin.misfit import FILE, read_misfit, write_misfit
from pinotwin.twin.moments import Moments
from pinotwin.twin.parameters import Parameter, Parameters
from pinotwin.twin.twin import Twin

SCHEMA = "pinotwin.twin/2"
COVARIANCE = "covariance.npz"


class _Settings(TypedDict, total=False):
    """Options of :func:`pinotwin.prepare`."""

    cutoff: float | None
    decimate: int | None
    order: int | None
    resample: float | None
    leave_out: list[tuple[str, str | float, float]] | None
    lead: dict[str, float] | None


class Document(TypedDict):
    """What is read of twin.json."""

    parameters: list[dict[str, Any]]
    effects: list[dict[str, Any]]
    theta: list[float]
    covariance_lower: dict[str, str] | list[list[float]]  # of a file, or written out as twins had it once
    standard_inertial_parameters: list[float]
    loops: dict[str, dict[str, Any]]
    servos: NotRequired[dict[str, dict[str, Any]]]
    diagonal: dict[str, list[float]]
    quality: dict[str, Any]
    not_separable: list[list[str]]
    data: list[dict[str, Any]]
    settings: _Settings
    bodies: NotRequired[list[dict[str, Any]]]
    misfit: NotRequired[dict[str, dict[str, Any]] | None]
    files: dict[str, str]


def write_twin(twin: Twin, folder: Path) -> dict[str, Any]:
    """Write a twin into a folder that is there; return what twin.json holds, digests included.

    Inertias that a URDF cannot hold, of a fit that was free, are in twin.json alone: the URDF keeps its own.
    """
    name = f"{twin.machine.name}.urdf"
    model = twin.machine.model if no_urdf_holds(twin.model) else twin.model
    write_bytes(folder / name, with_inertias(twin.machine.urdf, model))
    write_text(folder / "machine.yaml", _yaml(twin, model))
    with (folder / COVARIANCE).open("wb") as out:
        more = {} if twin.moments is None else twin.moments.arrays()
        np.savez_compressed(out, lower=twin.covariance[np.tril_indices(len(twin.theta))], **more)
    if twin.misfit is not None:
        write_misfit(twin.misfit, folder / FILE)
    content = document(twin)
    content["files"] = _digests(folder, folder / name)
    content["digest"] = _digest(content)
    write_text(folder / "twin.json", _text(content))
    return content


def _digest(content: dict[str, Any]) -> str:
    """Return the digest of a document without its own, whatever the order and layout of its text."""
    rest = {key: value for key, value in content.items() if key != "digest"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _digests(folder: Path, urdf: Path) -> dict[str, str]:
    """Return the digests of a twin's companions; what a log calls its channels is no part of the twin."""
    spec = {k: v for k, v in read_yaml(folder / "machine.yaml").items() if k != "columns"}
    out = {"machine.yaml": hashlib.sha256(json.dumps(spec, sort_keys=True, default=str).encode()).hexdigest()}
    for file in (urdf, folder / FILE, folder / COVARIANCE):
        if file.is_file():
            out[file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return out


def _text(content: dict[str, Any]) -> str:
    """Return JSON with one line per top-level item, or per entry of a list of them."""
    lines = []
    for key, value in content.items():
        name = json.dumps(key)
        if isinstance(value, list) and value and isinstance(value[0], (dict, list)):
            rows = ",\n    ".join(json.dumps(v, ensure_ascii=False, allow_nan=False) for v in value)
            lines.append(f"  {name}: [\n    {rows}\n  ]")
        else:
            lines.append(f"  {name}: {json.dumps(value, ensure_ascii=False, allow_nan=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _yaml(twin: Twin, model: pin.Model) -> str:
    spec = machine_spec(twin.machine)
    spec["urdf"] = f"{twin.machine.name}.urdf"
    for name, axis in twin.machine.axes.items():
        spec["axes"][name].pop("rotor_inertia", None)
        if model.armature[axis.index] > 0.0:
            spec["axes"][name]["rotor_inertia"] = float(model.armature[axis.index])
    for name in twin.machine.passive:
        k, c = twin.coefficients(f"{name}.spring") if f"{name}.spring" in twin.keys else (0.0, 0.0)
        if k > 0.0:
            own = {"stiffness": float(k), "damping": float(c)}
            spec["passive"] = {**spec["passive"], name: {**spec["passive"][name], **own}}
    return yaml.safe_dump(spec, sort_keys=False, allow_unicode=True)


def document(twin: Twin) -> dict[str, Any]:
    """Return the contents of twin.json."""
    return plain(
        {
            "schema": SCHEMA,
            "machine": twin.machine.name,
            "axes": list(twin.machine.axes),
            "gravity": twin.machine.model.gravity.linear.tolist(),
            "parameters": [row.as_dict() for row in twin.parameters],
            "effects": [
                {"key": key, "effect": effect.name, "axis": effect.axis, "fields": _fields(effect)}
                for key, effect in zip(twin.keys, twin.effects, strict=True)
            ],
            "theta": twin.theta,
            "covariance_lower": {"file": COVARIANCE, "array": "lower"},
            "standard_inertial_parameters": twin.pi,
            "bodies": list(twin.bodies),
            "loops": {name: loop.to_dict() for name, loop in twin.loops.items()},
            "servos": {name: servo.to_dict() for name, servo in twin.servos.items()},
            "diagonal": twin.diagonal,
            "quality": twin.quality,
            "not_separable": [list(group) for group in twin.groups],
            "data": list(twin.data),
            "settings": twin.settings,
            "misfit": None if twin.misfit is None else twin.misfit.summary,
        }
    )


def _fields(effect: Effect) -> dict[str, Any]:
    """Return what :func:`_remade` needs to make the effect again, shapes included."""
    if effect.axis is None:
        return {}
    return {
        f.name: getattr(effect, f.name)
        for f in dataclasses.fields(effect)  # type: ignore[arg-type]
        if f.name not in ("axis", "rotary") and f.compare  # the rest comes from the machine
    }


def load(folder: Path) -> Twin:
    """See :meth:`Twin.load`."""
    path = folder / "twin.json" if folder.is_dir() else folder
    if not path.is_file():
        raise TwinError(f"{path}: no such file; give the folder that `pinotwin identify` wrote")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # of JSON, of UTF-8, of a number of 5000 digits
        raise TwinError(f"{path}: not valid JSON ({error}); identify the twin again") from None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else None
        raise TwinError(f"{path}: schema {found!r}, this version reads {SCHEMA!r}; identify again")
    machine = Machine.load(path.parent)
    if content.get("digest") != _digest(content):
        raise TwinError(
            f"{path}: damaged twin (changed after it was saved: its digest differs); identify it again"
        )
    try:
        stated = msgspec.convert(content, Document)
        _check_digests(path.parent, stated["files"], machine)
        return _twin(machine, stated, path.parent)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, OSError) as error:
        raise TwinError(f"{path}: damaged twin ({error}); identify it again") from None


def _check_digests(folder: Path, saved: dict[str, str], machine: Machine) -> None:
    """Refuse a twin whose files come from different runs."""
    found = _digests(folder, machine.urdf)
    for name in {**saved, **found}:
        if name not in found:
            raise TwinError(f"{folder / name}: is missing; put it back, or identify the twin again")
        if saved.get(name) != found[name]:
            raise TwinError(
                f"{folder / name}: is not the one that this twin was saved with (its digest in "
                "twin.json differs); put it back, or identify the twin again"
            )


def _twin(machine: Machine, content: Document, folder: Path) -> Twin:
    effects = tuple(_remade(machine, item) for item in content["effects"])
    theta = np.array(content["theta"])
    if len(theta) != effect_slices(effects)[-1].stop:
        raise ValueError("the number of coefficients does not fit the effects")
    pi = np.array(content["standard_inertial_parameters"])
    _check_physics(machine, effects, theta, pi, bool(content["quality"].get("consistency")))
    misfit, (covariance, moments) = None, _read(folder, content["covariance_lower"], len(theta))
    if (summary := content.get("misfit")) and (folder / FILE).is_file():
        misfit = read_misfit(folder / FILE, machine.names, machine.rotary, summary)
    return Twin(
        machine=machine,
        effects=effects,
        theta=theta,
        covariance=covariance,
        parameters=Parameters(map(_parameter, content["parameters"])),
        pi=pi,
        diagonal={key: np.array(row) for key, row in content["diagonal"].items()},
        bodies=tuple(content.get("bodies", ())),
        **_closed_loop(content["loops"], content.get("servos", {})),
        quality=content["quality"],
        data=content["data"],
        settings=content["settings"],
        groups=content["not_separable"],
        misfit=misfit,
        moments=moments,
    )


def _check_physics(
    machine: Machine, effects: Sequence[Effect], theta: Floats, pi: Floats, consistent: bool
) -> None:
    """Refuse coefficients outside the bounds of their effects, and bodies of negative mass."""
    own = [(key, c) for key, e in zip(effect_keys(effects), effects, strict=True) for c in e.coefficients()]
    for (key, c), x in zip(own, theta.tolist(), strict=True):
        if not c.lower - 1e-9 <= x <= c.upper + 1e-9:
            raise ValueError(f"{key}.{c.name} is {x:.4g}, outside {c.lower:.4g} to {c.upper:.4g}")
    if consistent and pi[: 10 * (machine.model.njoints - 1) : 10].min(initial=0.0) < 0.0:
        raise ValueError("a mass is negative")


def _read(
    folder: Path, given: dict[str, str] | list[list[float]], size: int
) -> tuple[Floats, Moments | None]:
    """Return the covariance, shape (size, size), and the moments, which older twins do not have."""
    moments = None
    if isinstance(given, dict):
        with np.load(folder / COVARIANCE, allow_pickle=False) as file:
            lower, moments = file["lower"], Moments.read(file)
    else:
        lower = np.concatenate(given)
    matrix = np.zeros((size, size))
    matrix[np.tril_indices(size)] = lower.reshape(size * (size + 1) // 2)
    return matrix + np.tril(matrix, -1).T, moments


def _remade(machine: Machine, item: dict[str, Any]) -> Effect:
    if item["axis"] is None:
        return machine.rigid_body
    for effect in machine.effects:
        if effect.name == item["effect"] and effect.axis == item["axis"]:
            types = get_type_hints(type(effect))
            found = {k: msgspec.convert(x, types[k]) for k, x in item["fields"].items()}
            return dataclasses.replace(effect, **found)  # type: ignore[type-var]
    raise ValueError(f"effect {item['key']} is not in machine.yaml")


def _parameter(row: dict[str, Any]) -> Parameter:
    row = {**row, "error": row["standard_error"]}
    nothing = {"value": np.nan, "error": np.nan, "dof": np.inf}
    return msgspec.convert({**row, **{k: x for k, x in nothing.items() if row.get(k) is None}}, Parameter)


def _closed_loop(loops: dict[str, dict[str, Any]], servos: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the loops and controllers of a twin; of one without, their code is not imported."""
    if not loops and not servos:
        return {}
    from pinotwin.loop import LoopModel, Servo

    return {
        "loops": {k: LoopModel.from_dict(v) for k, v in loops.items()},
        "servos": {k: Servo.from_dict(v) for k, v in servos.items()},
    }
