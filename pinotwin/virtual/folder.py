"""What a virtual machine needs of a machine folder: its URDF, axes and passive joints, and the sealed truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from pinotwin.errors import MachineError
from pinotwin.system.reading import made
from pinotwin.virtual.truth import Truth


@dataclass(frozen=True)
class Folder:
    """What a virtual machine is made from."""

    name: str  # name of the machine
    urdf: Path  # the URDF
    axes: Mapping[str, str]  # axis name -> joint name
    passive: Mapping[str, str]  # passive name -> joint name
    truth: Truth  # the sealed truth
    rotors: Mapping[str, float] = field(default_factory=dict)  # axis -> reflected rotor inertia [kg, kg·m²]
    limits: Mapping[str, float] = field(default_factory=dict)  # axis -> effort limit of the drive [N or N·m]
    gravity: tuple[float, ...] | None = None  # in the axes of the URDF's root [m/s²]; the usual one when None


def read_folder(path: Path | str) -> Folder:
    """Return the contents of a machine folder (or that of a ``machine.yaml``); MachineError for a missing file."""
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
    raw = _yaml(path)
    truth: Truth = made({} if raw is None else raw, Truth, str(path))
    return truth
