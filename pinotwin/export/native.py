"""What a simulator expresses by itself (damping, spring, constant dry friction), and the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.arrays import Floats


@dataclass(frozen=True)
class Tie:
    """What the motor that turns two joints adds along their sum (a tendon of MuJoCo)."""

    joints: tuple[int, int]  # columns of the two joints
    armature: float  # rotor inertia [kg·m²]
    damping: float  # viscous friction [N·m·s/rad]
    friction: float  # dry friction [N·m]


@dataclass(frozen=True)
class Native:
    """A machine's effort split in two."""

    armature: Floats  # rotor inertia of each joint, shape (nv,)
    damping: Floats  # viscous friction [N·s/m or N·m·s/rad], shape (nv,)
    stiffness: Floats  # spring to zero [N/m or N·m/rad], shape (nv,)
    friction: Floats  # dry friction, the same at every speed and both ways [N or N·m], shape (nv,)
    ties: tuple[Tie, ...]  # motors that turn two joints
    rest: dict[str, Any]  # what is left, as :class:`pinotwin.export.runtime.Friction` takes it
    dry: list[dict[str, Any]]  # all dry friction, for a model whose own is switched off
    inexpressible: tuple[str, ...]  # what neither part can hold, in words


def split(data: dict[str, Any]) -> Native:
    """Return the two parts of ``Inverse.data``."""
    nv = len(data["names"])
    friction = np.zeros(nv)
    armature, viscous = (np.array(data[key], dtype=float) for key in ("armature", "viscous"))
    dry, tied = [], {}
    for row in data["dry"]:
        level, rest = _level(row)
        if row["partner"] >= 0:
            tied[_pair(row["joint"], row["partner"])] = level
        else:
            friction[row["joint"]] += level
        if rest is not None:
            dry.append(rest)
    ties, lost = [], []
    for i, j, inertia, damping in data["coupled"]:
        most = float(np.clip(inertia, 0.0, min(armature[i], armature[j])))
        if inertia - most > 1e-3 * abs(inertia):
            names = f"{data['names'][i]} and {data['names'][j]}"
            lost.append(f"{inertia - most:.3g} kg·m² of the rotor that turns {names}")
        ties.append(Tie((int(i), int(j)), most, float(damping), tied.pop(_pair(i, j), 0.0)))
        armature[[i, j]] -= most
        viscous[[i, j]] -= damping
    ties += [Tie(pair, 0.0, 0.0, level) for pair, level in tied.items()]
    damping, left = np.maximum(viscous, 0.0), np.minimum(viscous, 0.0)
    rest = {key: data[key] for key in ("names", "position", "velocity", "slip")}
    rest |= {"viscous": left.tolist(), "stiffness": [0.0] * nv, "dry": dry, "coupled": []}
    stiffness = np.array(data["stiffness"], dtype=float)
    return Native(armature, damping, stiffness, friction, tuple(ties), rest, data["dry"], tuple(lost))


def _pair(i: int, j: int) -> tuple[int, int]:
    return (min(int(i), int(j)), max(int(i), int(j)))


def _level(row: dict[str, Any]) -> tuple[float, dict[str, Any] | None]:
    """Return the friction common to all speeds and both directions, and the rest of the element."""
    plus, minus = row["plus"], row["minus"]
    level = max(0.0, min(min(plus.y), -max(minus.y)))
    rest_plus, rest_minus = [y - level for y in plus.y], [y + level for y in minus.y]
    if not any(abs(y) > 1e-9 * max(level, 1e-12) for y in (*rest_plus, *rest_minus)):
        return level, None
    return level, row | {"plus": plus._replace(y=rest_plus), "minus": minus._replace(y=rest_minus)}
