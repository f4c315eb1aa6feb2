"""What a virtual machine needs of a machine folder: its URDF, axes and passive joints, and the sealed truth."""

from __future__ import annotations

import dataclasses
import sys
import types
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import yaml

from pinotwin.errors import MachineError, nearest
from pinotwin.virtual.truth import Truth


@dataclass(frozen=True)
class Folder:
    """What a virtual machine is made from."""

    name: str  # name of the machine
    urdf: Path | str  # path of the URDF, or its text
    axes: Mapping[str, str]  # axis name -> joint name
    passive: Mapping[str, str]  # passive name -> joint name
    truth: Truth  # the sealed truth
    # axis -> nominal reflected rotor inertia [kg or kg·m²]
    rotors: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)  # axis -> effort limit of the drive [N or N·m]
    gravity: tuple[float, ...] | None = None  # in the axes of the URDF's root [m/s²]; the usual one when None


def read_folder(path: Path | str) -> Folder:
    """Return the contents of a machine folder (or of the folder of a ``machine.yaml``).

    Raises:
        MachineError: a file is missing or cannot be used.
    """
    path = Path(path)
    file = path / "machine.yaml" if path.is_dir() else path
    if not file.is_file():
        raise MachineError(f"{path}: no machine.yaml here; give a machine folder or its YAML")
    raw = _yaml(file)
    if not isinstance(raw, Mapping) or not {"name", "urdf", "axes"} <= set(raw):
        raise MachineError(f"{file}: needs the keys name, urdf and axes")
    axes, passive = _specs(raw["axes"], file), _specs(raw.get("passive"), file)
    urdf, sealed = file.parent / str(raw["urdf"]), file.parent / "virtual.yaml"
    if not urdf.is_file():
        raise MachineError(f"{file}: urdf {str(raw['urdf'])!r} does not exist beside it")
    return Folder(
        str(raw["name"]),
        urdf,
        {n: str(spec.get("joint", n)) for n, spec in axes.items()},
        {n: str(spec.get("joint", n)) for n, spec in passive.items()},
        read_truth(sealed) if sealed.is_file() else Truth(),
        {n: float(spec.get("rotor_inertia", 0.0)) for n, spec in axes.items()},
        {n: float(spec.get("effort_limit", 0.0)) for n, spec in axes.items()},
        tuple(map(float, raw["gravity"])) if "gravity" in raw else None,
    )


def _specs(raw: Any, file: Path) -> dict[str, Mapping[str, Any]]:
    """Return name -> keys of axes or passive joints."""
    raw = {} if raw is None else raw
    if not isinstance(raw, Mapping) or not all(isinstance(x, Mapping | None) for x in raw.values()):
        raise MachineError(f"{file}: axes and passive are given as name: {{joint: ...}}")
    return {str(name): spec or {} for name, spec in raw.items()}


def _yaml(file: Path) -> Any:
    try:
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MachineError(f"{file}: not YAML: {' '.join(str(error).split())}") from None


def read_truth(path: Path) -> Truth:
    """Return the truth in a YAML file; a key or a value that cannot be used is a :class:`MachineError`."""
    truth: Truth = _built(Truth, _yaml(path), str(path))
    return truth


def _built(kind: Any, raw: Any, where: str) -> Any:
    """Return plain YAML as an instance of a dataclass, tuple, mapping or number; ``where`` is for messages."""
    origin, args = get_origin(kind), get_args(kind)
    if origin is types.UnionType:  # of something and None
        return None if raw is None else _built(args[0], raw, where)
    if dataclasses.is_dataclass(kind) or origin is Mapping:
        raw = {} if raw is None else raw
        if not isinstance(raw, Mapping):
            raise MachineError(f"{where}: expected keys and values, found {raw!r}")
        if origin is Mapping:
            return {str(k): _built(args[1], v, f"{where}[{k}]") for k, v in raw.items()}
        return _dataclass(kind, raw, where)
    if origin is tuple:
        if not isinstance(raw, list):
            raise MachineError(f"{where}: expected a list, found {raw!r}")
        kinds = args[:1] * len(raw) if args[-1] is Ellipsis else args
        if len(kinds) != len(raw):
            raise MachineError(f"{where}: expected {len(kinds)} values, found {len(raw)}")
        return tuple(_built(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, raw, strict=True)))
    return _scalar(kind, raw, where)


def _dataclass(kind: Any, raw: Mapping[Any, Any], where: str) -> Any:
    hints = get_type_hints(kind)
    for key in raw:
        if key not in hints:
            raise MachineError(f"{where}: unknown key {key!r}; {nearest(str(key), hints)}")
    try:
        return kind(**{key: _built(hints[key], value, f"{where}.{key}") for key, value in raw.items()})
    except TypeError as error:
        raise MachineError(f"{where}: {error}") from None


def _scalar(kind: Any, raw: Any, where: str) -> Any:
    if kind is float and isinstance(raw, str):  # YAML 1.1 reads 1e-6 as a word
        try:
            raw = float(raw)
        except ValueError:
            raise MachineError(f"{where}: expected a number, found {raw!r}") from None
    accepted = kind if kind in (bool, str) else (int, float)
    if not isinstance(raw, accepted) or (accepted == (int, float) and isinstance(raw, bool)):
        raise MachineError(f"{where}: expected {kind.__name__}, found {raw!r}")
    if kind is not str and not abs(raw) <= sys.float_info.max:
        raise MachineError(f"{where}: expected a finite number, found {raw!r}")
    return kind(raw)
