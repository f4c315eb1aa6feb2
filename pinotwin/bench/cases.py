"""The cases of the blind bench: machine, situation, what is put into the truth, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

HEALTHY: dict[str, tuple[str, ...]] = {
    "trunnion": ("stribeck:C",),
    "laser_driller": ("joint_flexibility",),
    "emps": ("coulomb_asymmetric", "drive_flexibility", "stribeck"),
}
"""Machine -> effects of its truth that its machine.yaml does not list: withheld in every case."""

SIZES: dict[str, tuple[float, float]] = {
    "coulomb_asymmetric": (0.005, 0.06), "stribeck": (0.02, 0.15), "ripple": (0.005, 0.06),
    "ripple_modulated": (0.005, 0.06), "position_table": (0.005, 0.05),
    "load_friction": (0.03, 0.3), "viscous_thermal": (0.2, 0.9), "presliding": (0.3, 3.0),
    "drive_flexibility": (0.03, 0.3), "joint_flexibility": (0.03, 0.3), "backlash": (0.02, 0.2),
    "encoder_error": (0.1, 1.0), "delay": (0.05, 0.4), "geometric_error": (0.02, 0.3),
    "quadratic_drag": (0.01, 0.1), "effort_scale": (0.03, 0.2), "external_force": (0.05, 0.4),
    "viscous": (0.01, 0.1), "coulomb": (0.01, 0.1), "payload": (0.03, 0.3),
    "inertial_coupling": (0.03, 0.3),
}  # fmt: skip
"""Effect -> smallest and largest relative size, drawn log-uniformly."""

STRUCTURE = (
    "coulomb_asymmetric", "stribeck", "ripple", "ripple_modulated", "position_table",
    "load_friction", "viscous_thermal", "drive_flexibility", "joint_flexibility", "backlash",
    "encoder_error", "delay", "geometric_error", "quadratic_drag",
)  # fmt: skip
CHANGE = (
    *STRUCTURE, "viscous", "coulomb", "payload", "inertial_coupling", "effort_scale",
)  # fmt: skip
OUTSIDE = ("ripple_speed", "coulomb_position", "mains", "chatter")
OUTSIDE_SIZE = (0.02, 0.2)

LISTED: dict[str, dict[str, tuple[str, ...]]] = {
    "trunnion": {
        "Y": ("ripple", "ripple_modulated", "position_table", "stribeck"),
        "A": ("ripple", "ripple_modulated", "position_table"),
        "C": (),
    },
    "laser_driller": dict.fromkeys("XYZBC", ("stribeck",)),
    "emps": {"X": ("coulomb_asymmetric",)},
}
"""Effects that an axis' machine.yaml lists already: nothing is missing if the truth has more of them."""


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        number: running number.
        machine: bundled machine.
        situation: ``structure`` or ``change``.
        kind: healthy, single, double, outside.
        effects: (effect, axis, size) put into the truth.
        seed: of trajectory, noise and whatever the effects leave to chance.
    """

    number: int
    machine: str
    situation: str
    kind: str
    effects: tuple[tuple[str, str, float], ...]
    seed: int


def draw_cases(
    machines: Sequence[str], seeds: int, *, situations: Sequence[str] = ("structure", "change"),
    seed: int = 0,
) -> list[Case]:  # fmt: skip
    """Return the cases of a bench: per machine and seed a healthy one, each effect once, and others.

    Args:
        machines: bundled machines, or folders.
        seeds: repetitions.
        situations: which of the two.
        seed: of everything drawn.
    """
    rng = np.random.default_rng([seed, 7])
    out: list[Case] = []
    for machine in machines:
        axes = axes_of(machine)
        for situation in situations:
            for _ in range(seeds):
                pool = STRUCTURE if situation == "structure" else CHANGE
                kinds: list[tuple[str, tuple[str, ...]]] = [("healthy", ())] * 3
                kinds += [("single", (name,)) for name in pool]
                kinds += [("double", _two(rng, pool)) for _ in range(2)]
                kinds += [("outside", (name,)) for name in OUTSIDE]
                for kind, names in kinds:
                    effects = _placed(rng, machine, situation, axes, names)
                    if effects is None:
                        continue
                    run = int(rng.integers(1 << 30))
                    out.append(Case(len(out), machine, situation, kind, effects, run))
    return out


def axes_of(machine: str) -> list[str]:
    """Return the axis names of a bundled machine or folder."""
    from pinotwin.machine import Machine

    return list(Machine.load(machine).axes)


def _two(rng: np.random.Generator, pool: Sequence[str]) -> tuple[str, ...]:
    return tuple(str(x) for x in rng.choice(np.array(pool), 2, replace=False))


def _placed(rng, machine, situation, axes, names):  # type: ignore[no-untyped-def]
    out = []
    for name in names:
        listed = LISTED.get(machine, {})
        free = [a for a in axes if situation == "change" or name not in listed.get(a, ())]
        if situation == "change" and name in ("ripple", "ripple_modulated", "position_table"):
            free = list(axes)
        if not free:
            return None
        low, high = SIZES.get(name, OUTSIDE_SIZE)
        size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        out.append((name, str(rng.choice(np.array(free))), size))
    return tuple(out)
