"""The machines that come with pinotwin, wherever it is installed."""

from __future__ import annotations

from pathlib import Path


def _folder() -> Path:
    package = Path(__file__).resolve().parents[1]
    inside = package / "urdf"
    return inside if inside.is_dir() else package.parent / "urdf"


def machines() -> dict[str, Path]:
    """Return the bundled machines: name -> folder with ``<name>.urdf`` and ``machine.yaml``."""
    folder = _folder()
    if not folder.is_dir():
        return {}
    return {p.parent.name: p.parent for p in sorted(folder.glob("*/machine.yaml"))}


def bundled_path(name: str) -> Path:
    """Return the folder of a bundled machine."""
    return machines()[name]
