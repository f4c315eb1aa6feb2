"""Passive joints that no log holds, bent as the springs in machine.yaml have it.

The motors' rows show a joint's mode (k / I, c / I) and how strongly it pulls (lambda² / I), not its inertia: that
stays the CAD's. What drives the joint is the same lambda that its acceleration is weighed with. Fitted beside a
deflection that came of lambda_0 it comes out as lambda² / lambda_0, so that the mean of both is nearly right at once,
where putting the one in the place of the other would swing for ever. Springs are moved twice, at first beside dry
friction by sign, then with friction and tables of a first plant taken off the effort: on the virtual rig the
deflection is 27 % off after the first and 8 % after the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.analysis.deflection import Bending, PassiveSpring, holds
from pinotwin.arrays import Floats
from pinotwin.identification.plant import fit_plant
from pinotwin.identification.springs import keep_spring
from pinotwin.identification.table import open_loop
from pinotwin.log import Log
from pinotwin.logs.columns import bind
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin import OpenLoop

SURE = 0.25
"""Standard error over size below which a base parameter is taken from the first plant; else the CAD's stays."""
FELT = 1e-9
"""Share of the largest column below which a motor does not feel a parameter while the joints stand."""


@dataclass(frozen=True)
class Bent:
    """Logs of which the passive joints are bent, and how."""

    bending: Bending
    logs: tuple[Log, ...]

    def also(self, logs: Sequence[Log]) -> list[Log]:
        """Return other logs of the machine, bent in the same way where they do not hold the joints."""
        out = []
        for log in (bind(x, self.bending.machine.columns) for x in logs):
            held = any(holds(log, spring.name) for spring in self.bending.springs)
            out.append(log if held else self.bending.bend(log, _motion(self.bending.machine, log)))
        return out

    def completed(self, plant: OpenLoop) -> OpenLoop:
        """Return the plant with the springs by which its logs were bent."""
        for spring in self.bending.springs:
            plant = keep_spring(plant, spring.name, (spring.stiffness, spring.damping))
        return plant

    @property
    def warnings(self) -> list[str]:
        """What a user must know of joints that nothing measured."""
        return [_said(self.bending.machine, spring) for spring in self.bending.springs]


def bent(machine: Machine, logs: Sequence[Log]) -> Bent:
    """Return the logs of a machine with the velocity of its passive joints, which none of them holds.

    Args:
        machine: with stiffness and damping of its passive joints in machine.yaml.
        logs: to identify it on.
    """
    logs = [bind(log, machine.columns) for log in logs]
    motions = [_motion(machine, log) for log in logs]
    first = Bending.stated(machine).moved(motions[0])
    shaken = [first.bend(*pair) for pair in zip(logs, motions, strict=True)]
    plant = open_loop(machine, fit_plant(machine, prepare(machine, shaken), consistent_inertia=False))
    rest = replace(motions[0], u=motions[0].u - _friction(plant, _motion(machine, shaken[0])))
    second = replace(first, beta=_beta(plant, first.beta, motions[0])).moved(rest)
    return Bent(second, tuple(second.bend(*pair) for pair in zip(logs, motions, strict=True)))


def _motion(machine: Machine, log: Log) -> Motion:
    return prepare(machine, log, decimate=1)


def _beta(plant: OpenLoop, cad: Floats, motion: Motion) -> Floats:
    """Return the base parameters that drive the joints: found where the motors' rows tell them, else the CAD's.

    Those that the motors feel only by what the joints do are the mean of both.
    """
    machine = plant.machine
    found = plant.coefficients("rigid_body")
    table = {p.name: p for p in plant.parameters}
    rows = [table[f"rigid_body.{label}"] for label in machine.base.labels]
    sure = np.array([p.determined and p.error < SURE * abs(p.value) for p in rows])
    motors = [axis.index for axis in machine.axes.values()]
    still = [x.copy() for x in (motion.q, motion.v, motion.a)]
    for x in still:
        x[:, [part.index for part in machine.passive.values()]] = 0.0
    size = np.abs(machine.base.regressor(machine.model, *still)[:, motors]).max(axis=(0, 1))
    by_joint = size <= FELT * size.max()
    return np.where(sure, np.where(by_joint, 0.5 * (cad + found), found), cad)


def _friction(plant: OpenLoop, motion: Motion) -> Floats:
    """Return what all but the bodies take of the effort, shape (n, nv)."""
    bodies = {"rigid_body", *(f"{name}.spring" for name in plant.machine.passive)}
    parts = plant.parts(motion)
    return np.sum([x for key, x in parts.items() if key not in bodies], axis=0) + np.zeros_like(motion.u)


def _said(machine: Machine, spring: PassiveSpring) -> str:
    part = machine.passive[spring.name]
    unit = "N·m/rad" if part.rotary else "N/m"
    return (
        f"{spring.name}: not in the log, so it moves as a spring of {spring.stiffness:.4g} {unit} has it on the CAD's "
        f"inertia (machine.yaml: {part.stiffness:.4g}); `pinotwin vibration` measures it"
    )
