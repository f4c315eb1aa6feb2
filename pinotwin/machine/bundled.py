"""Machines by name: those that come with pinotwin, and the robots of example-robot-data."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pinocchio as pin


def machines() -> dict[str, Path]:
    """Return the bundled machines: name -> folder with ``<name>.urdf`` and ``machine.yaml``."""
    package = Path(__file__).resolve().parents[1]
    folder = next((p / "urdf" for p in (package, package.parent) if (p / "urdf").is_dir()), package)
    return {p.parent.name: p.parent for p in sorted(folder.glob("*/machine.yaml"))}


@cache
def robots() -> dict[str, Path]:
    """Return example-robot-data's robots: name -> URDF; by file (``ur5_robot``, ``ur5``) or only one in a folder."""
    within = "share/example-robot-data/robots"  # beside the Pinocchio that is in use: wheels, conda, ROS
    root = next((p / within for p in Path(pin.__file__).parents if (p / within).is_dir()), None)
    if root is None:
        return {}
    files = sorted(root.rglob("*.urdf"))
    folders = [path.relative_to(root).parts[0] for path in files]
    places = zip(folders, files, strict=True)
    alone = {f.removesuffix("_description"): p for f, p in places if folders.count(f) == 1}
    stems = [path.stem for path in files]
    own = {path.stem: path for path in files if stems.count(path.stem) == 1}
    arms = {path.stem.removesuffix("_robot"): path for path in files if path.stem.endswith("_robot")}
    return dict(sorted({**alone, **own, **arms}.items()))
