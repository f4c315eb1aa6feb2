"""Machines of random kinematics, written as a machine folder: on known ones a bench measures what code remembers.

Tree, axes, bodies, friction, controllers and rates come from one seed. ``machine.yaml`` lists what the truth holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from pinotwin.arrays import Floats
from pinotwin.virtual.defaults import Scale
from pinotwin.virtual.machine import VirtualMachine


@dataclass(frozen=True)
class Part:
    """One axis and the body that it moves."""

    name: str  # axis, joint; the link is <name>_link
    parent: int  # index of the carrying part, -1 for the ground
    rotary: bool  # whether it turns
    direction: Floats  # joint axis in the joint frame
    origin: Floats  # of the joint in the parent's frame [m]
    turn: Floats  # roll, pitch and yaw of the joint frame in the parent's [rad]
    box: Floats  # edges of the body [m]
    centre: Floats  # of mass in the joint frame [m]
    mass: float  # [kg]
    travel: float  # half of it [m or rad]


def write_random_machine(folder: Path, seed: int) -> Path:
    """Write the machine folder of a seed, which decides everything about it, and return it."""
    rng = np.random.default_rng([seed, 2029])
    name = f"random_{seed}"
    parts = _parts(rng)
    truths = {part.name: _drive(part, rng) for part in parts}
    sealed = {
        "seed": int(rng.integers(1, 10_000)),
        "control_rate": 4000.0,
        "log_rate": 500.0,
        "inertial_error": [0.05, 0.2],
        "scatter": float(rng.uniform(0.003, 0.01)),
        "axes": truths,
    }
    listed: dict[str, dict[str, Any]] = {part.name: {"joint": part.name} for part in parts}
    machine = {"name": name, "urdf": f"{name}.urdf", "axes": listed}
    folder.mkdir(parents=True, exist_ok=True)
    body = "".join(_xml(part, parts) for part in parts)
    text = f'<?xml version="1.0"?>\n<robot name="{name}">\n<link name="base_link"/>\n{body}</robot>\n'
    (folder / f"{name}.urdf").write_text(text, encoding="utf-8")
    _write(folder, machine, sealed)
    # Friction is set against the effort that an axis needs, which the whole tree decides.
    scales = VirtualMachine.load(folder).scales
    needed = _needed(folder / f"{name}.urdf", {k: x["limits"] for k, x in truths.items()}, seed)
    for part in parts:
        scale, most = scales[part.name], needed[part.name]
        if most > 3.0 * scale.rated + 2.0 * scale.hold:  # the usual drive would be at its limit
            truths[part.name]["controller"]["effort_limit"] = most
        truths[part.name] |= _friction(scale, rng)
        slow = truths[part.name]["friction"]["static"] > 1.0
        effects: list[Any] = ["viscous", "presliding" if slow else {"presliding": {"stribeck": 0}}]
        listed[part.name]["effects"] = [*effects, *(["ripple"] if "ripple" in truths[part.name] else [])]
    _write(folder, machine, sealed)
    return folder


def _needed(
    urdf: Path, limits: Mapping[str, Mapping[str, Any]], seed: int, spare: float = 1.5
) -> dict[str, float]:
    """Return the effort that each drive needs while all axes move [N or N·m], times ``spare``."""
    rng = np.random.default_rng([seed, 2030])
    model = pin.buildModelFromUrdf(str(urdf))
    data, most = model.createData(), np.zeros(model.nv)
    names = sorted(limits, key=lambda x: model.idx_vs[model.getJointId(x)])
    travel, speed, push = (
        np.array([limits[x][k] for x in names]) for k in ("travel", "speed", "acceleration")
    )
    for _ in range(400):
        q = rng.uniform(travel[:, 0], travel[:, 1])
        v, a = (x * rng.choice([-1.0, 1.0], len(x)) for x in (speed, push))
        most = np.maximum(most, np.abs(pin.rnea(model, data, q, v, a)))
    return {x: spare * float(m) for x, m in zip(names, most, strict=True)}


def _write(folder: Path, machine: dict[str, Any], sealed: dict[str, Any]) -> None:
    for file, content in (("machine.yaml", machine), ("virtual.yaml", sealed)):
        (folder / file).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def _parts(rng: np.random.Generator) -> list[Part]:
    count = int(rng.integers(2, 6))
    kinds = rng.uniform(size=count) < 0.55
    kinds[int(rng.integers(count))] = True  # one axis turns and one slides, at least
    kinds[(int(np.argmax(kinds)) + 1) % count] = False
    parts: list[Part] = []
    for i, rotary in enumerate(kinds):
        # Four of five sit on the axis before, as in a chain; the others branch off further back.
        parent = i - 1 if rng.uniform() < 0.8 else int(rng.integers(-1, i))
        parts.append(_part(f"Q{i + 1}", parent, bool(rotary), parts, rng))
    return parts


def _part(
    name: str, parent: int, rotary: bool, before: list[Part], rng: np.random.Generator, density: float = 3.5e3
) -> Part:
    """Return an axis; ``density`` is that of a ribbed machine part, hollow as castings are [kg/m³]."""
    edge = 0.45 * 0.78 ** len(before)
    box = edge * rng.uniform(0.4, 1.1, 3)
    mass = density * float(np.prod(box)) * float(rng.uniform(0.15, 0.5))
    direction = np.eye(3)[int(rng.integers(3))] * rng.choice((-1.0, 1.0))
    if rng.uniform() < 0.2:  # oblique axes exist: nutating heads
        direction = direction + rng.normal(0.0, 0.5, 3)
    direction = direction / np.linalg.norm(direction)
    # The centre of mass is beside the axis by a fifth of the body: it couples and it weighs.
    centre = 0.2 * box * rng.uniform(-1.0, 1.0, 3)
    reach = 0.5 * before[parent].box if parent >= 0 else np.full(3, 0.2)
    turn = rng.choice([0.0, 0.0, 0.5 * np.pi], 3) if rng.uniform() < 0.4 else np.zeros(3)
    travel = float(rng.uniform(1.0, 2.8)) if rotary else float(rng.uniform(0.1, 0.3))
    origin = reach * rng.uniform(-1.0, 1.0, 3)
    return Part(name, parent, rotary, direction, origin, turn, box, centre, mass, travel)


def _drive(part: Part, rng: np.random.Generator) -> dict[str, Any]:
    speed = float(rng.uniform(1.5, 5.0) if part.rotary else rng.uniform(0.2, 0.6))
    push = speed / float(rng.uniform(0.08, 0.2))
    # A ramp of acceleration takes ten samples of the log or more: a shorter one is no longer in it.
    limits = {
        "speed": speed,
        "acceleration": push,
        "jerk": push / float(rng.uniform(0.02, 0.04)),
        "travel": [-part.travel, part.travel],
    }
    forward = float(rng.uniform(0.5, 1.0))
    if rng.uniform() < 0.5:
        own: dict[str, Any] = {"kind": "p_pi", "bandwidth": float(rng.uniform(14.0, 35.0))}
    else:
        poles = [float(rng.uniform(*x)) for x in ((40.0, 60.0), (7.0, 12.0), (0.6, 0.9))]
        own = {"kind": "pid", "poles": poles}
    return {"limits": limits, "controller": {**own, "acceleration_feedforward": forward}}


def _friction(scale: Scale, rng: np.random.Generator) -> dict[str, Any]:
    """Return friction, and a ripple on some axes, of the usual share of the rated effort."""
    small = (1e-5, 6e-5) if scale.rotary else (4e-6, 1.5e-5)
    out: dict[str, Any] = {
        "friction": {
            "coulomb": float(rng.uniform(0.02, 0.1) * scale.rated),
            "viscous": float(rng.uniform(0.03, 0.12) * scale.rated / scale.speed),
            "static": float(rng.uniform(1.15, 1.5)) if rng.uniform() < 0.6 else 1.0,
            "stribeck_speed": float(rng.uniform(0.008, 0.03) * scale.speed),
            "presliding": float(rng.uniform(*small)),
        }
    }
    if rng.uniform() < 0.4:
        turns, pitch = int(rng.integers(9, 40)), float(rng.uniform(0.012, 0.04))
        period = 2.0 * np.pi / turns if scale.rotary else pitch
        size, phase = (float(rng.uniform(*r)) for r in ((0.01, 0.05), (0.0, 6.28)))
        out["ripple"] = [{"amplitude": size * scale.rated, "period": period, "phase": phase}]
    return out


def _xml(part: Part, parts: list[Part]) -> str:
    parent = parts[part.parent].name + "_link" if part.parent >= 0 else "base_link"
    kind = "revolute" if part.rotary else "prismatic"
    reach = 1.1 * part.travel
    squares = part.box**2  # a solid box
    inertia = zip(("ixx", "iyy", "izz"), part.mass * (squares.sum() - squares) / 12.0, strict=True)
    values = " ".join(f'{k}="{v:.9g}"' for k, v in inertia)
    return f"""<joint name="{part.name}" type="{kind}">
  <parent link="{parent}"/><child link="{part.name}_link"/>
  <origin xyz="{_three(part.origin)}" rpy="{_three(part.turn)}"/>
  <axis xyz="{_three(part.direction)}"/>
  <limit lower="{-reach:.6g}" upper="{reach:.6g}" velocity="100" effort="100000"/>
</joint>
<link name="{part.name}_link">
  <inertial><origin xyz="{_three(part.centre)}"/><mass value="{part.mass:.9g}"/>
    <inertia {values} ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="{_three(part.centre)}"/>
    <geometry><box size="{_three(part.box)}"/></geometry></visual>
</link>
"""


def _three(values: Floats) -> str:
    return " ".join(f"{float(x):.9g}" for x in values)
