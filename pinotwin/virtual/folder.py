"""What a virtual machine needs of a machine folder: name, URDF, axes and passive joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from pinotwin.errors import MachineError
from pinotwin.virtual.truth import Truth
from pinotwin.virtual.truth_yaml import read_truth


@dataclass(frozen=True)
class Folder:
    """What a virtual machine is made from.

    Attributes:
        name: name of the machine.
        urdf: path of the URDF, or its text.
        axes: axis name -> joint name.
        passive: passive name -> joint name.
        truth: the sealed truth.
        rotors: axis -> nominal reflected rotor inertia [kg or kg·m²].
        limits: axis -> effort limit of the drive [N or N·m].
        gravity: in the axes of the URDF's root [m/s²]; the usual one when None.
    """

    name: str
    urdf: Path | str
    axes: Mapping[str, str]
    passive: Mapping[str, str]
    truth: Truth
    rotors: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    gravity: tuple[float, ...] | None = None


def read_folder(path: Path | str) -> Folder:
    """Return the contents of a machine folder (or of the folder of a ``machine.yaml``).

    Raises:
        MachineError: a file is missing or cannot be used.
    """
    path = Path(path)
    file = path / "machine.yaml" if path.is_dir() else path
    if not file.is_file():
        raise MachineError(f"{path}: no machine.yaml here; give a machine folder or its YAML")
    try:
        raw = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MachineError(f"{file}: not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(raw, Mapping) or not {"name", "urdf", "axes"} <= set(raw):
        raise MachineError(f"{file}: needs the keys name, urdf and axes")
    sealed = file.parent / "virtual.yaml"
    truth = read_truth(sealed) if sealed.is_file() else Truth()
    urdf = file.parent / str(raw["urdf"])
    if not urdf.is_file():
        raise MachineError(f"{file}: urdf {str(raw['urdf'])!r} does not exist beside it")
    return Folder(
        str(raw["name"]),
        urdf,
        _joints(raw["axes"], file),
        _joints(raw.get("passive"), file),
        truth,
        _numbers(raw["axes"], "rotor_inertia"),
        _numbers(raw["axes"], "effort_limit"),
        tuple(map(float, raw["gravity"])) if "gravity" in raw else None,
    )


def _numbers(axes: Mapping[str, Any], key: str) -> dict[str, float]:
    return {str(n): float(a[key]) for n, a in axes.items() if isinstance(a, Mapping) and key in a}


def _joints(raw: Any, file: Path) -> dict[str, str]:
    if raw is None:
        return {}
    if not isinstance(raw, Mapping):
        raise MachineError(f"{file}: axes and passive are given as name: {{joint: ...}}")
    return {
        str(name): str((spec or {}).get("joint", name)) if isinstance(spec, Mapping | None) else ""
        for name, spec in raw.items()
    }
