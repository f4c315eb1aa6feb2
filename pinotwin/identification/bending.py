"""Passive joints that no log holds, bent as the springs in machine.yaml have it.

The motors' rows show a joint's mode (k / I, c / I) and how strongly it pulls (lambda² / I); its inertia stays the
CAD's. Beside a deflection of lambda_0 a fit gives lambda² / lambda_0, so the mean of both is taken: putting the one in
the place of the other would swing for ever. Springs are moved twice, at first beside dry friction by sign, then with
friction and tables of a first plant off the effort. See also :mod:`pinotwin.analysis.deflection`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from pinotwin.analysis.deflection import PassiveSpring, load_of
from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import parameters
from pinotwin.identification.plant import fit_plant, open_loop
from pinotwin.identification.settings import USUAL, Settings
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin import OpenLoop

STIFFER, DAMPED = (0.4, 2.5), (0.2, 5.0)
"""Factors on the stiffness and damping of machine.yaml within which a spring is looked for."""


@dataclass(frozen=True)
class Bending:
    """How the passive joints of a machine bend along logs that do not hold them."""

    machine: Machine  # with stiffness and damping of its passive joints in machine.yaml
    beta: Floats  # base parameters that drive the joints, shape (b,)
    springs: tuple[PassiveSpring, ...]  # as they were moved

    @classmethod
    def stated(cls, machine: Machine) -> Bending:
        """Return that of the CAD's bodies and of the springs in machine.yaml."""
        springs = [
            PassiveSpring(p.name, p.index, float(p.stiffness or 0.0), float(p.damping or 0.0))
            for p in machine.passive.values()
        ]
        return cls(machine, machine.base.from_standard(parameters(machine.model)), tuple(springs))

    def moved(self, motion: Motion, most: int = 4000) -> Bending:
        """Return the same with the springs where ``most`` motors' rows, fitted by all that is linear, leave least.

        The motion is without the joints; its effort may lack what friction and tables take.
        """
        machine, n = self.machine, len(self.springs)
        loads = [load_of(machine, self.beta, motion, s.index) for s in self.springs]
        inside = np.r_[*motion.segments]
        rows = inside[:: max(1, len(inside) // most)]
        axes = [a.index for a in machine.axes.values() if np.isfinite(motion.u[rows, a.index]).all()]
        motors = [j for j in axes if np.ptp(motion.u[rows, j]) > 0.0 and np.ptp(motion.v[rows, j]) > 0.0]

        def at(x: Floats) -> Bending:
            pairs = zip(self.springs, np.exp(x).reshape(2, n).T, strict=True)
            moved = [replace(s, stiffness=s.stiffness * k, damping=s.damping * c) for s, (k, c) in pairs]
            return replace(self, springs=tuple(moved))

        def left(x: Floats) -> Floats:
            q, v, a = (y[rows].copy() for y in (motion.q, motion.v, motion.a))
            for spring, load in zip(at(x).springs, loads, strict=True):
                for y, response in zip((q, v, a), load.response(spring), strict=True):
                    y[:, spring.index] = response[rows]
            return _unexplained(machine.base.regressor(machine.model, q, v, a), v, motion.u[rows], motors)

        if not motors:
            return self
        low, high = np.log([*[STIFFER] * n, *[DAMPED] * n]).T
        best = scipy.optimize.least_squares(
            left, np.zeros(2 * n), bounds=(low, high), diff_step=0.02, max_nfev=12
        )
        return at(best.x)

    def bend(self, log: Log) -> Log:
        """Return a log with the velocity of the joints; one that holds a joint as it is."""
        if any(holds(log, spring.name) for spring in self.springs):
            return log
        motion = prepare(self.machine, log, decimate=1)
        channels = dict(log.channels)
        for spring in self.springs:
            v = load_of(self.machine, self.beta, motion, spring.index).response(spring)[1]
            channels[f"{spring.name}.v"] = np.interp(log.t, motion.t, v)
        return log.with_channels(channels)


def holds(log: Log, joint: str) -> bool:
    """Whether a log in the names of the contract holds a passive joint's position or velocity."""
    return f"{joint}.q" in log or f"{joint}.v" in log


def bends(machine: Machine, logs: Sequence[Log]) -> bool:
    """Whether springs of machine.yaml must stand for passive joints that no log holds."""
    parts = machine.passive.values()
    held = any(holds(log, p.name) for p in parts for log in logs)
    return bool(parts) and all(p.stiffness for p in parts) and not held and bool(logs)


def find_bending(machine: Machine, logs: Sequence[Log], settings: Settings = USUAL) -> Bending | None:
    """Return how passive joints bend that no log of the machine holds; None where there are none."""
    if not bends(machine, logs):
        return None
    motion = prepare(machine, logs[0], decimate=1)
    first = Bending.stated(machine).moved(motion)
    shaken = [first.bend(log) for log in logs]
    fit = fit_plant(machine, prepare(machine, shaken), settings)
    plant = open_loop(machine, fit)
    bodies = {"rigid_body", *(f"{name}.spring" for name in machine.passive)}
    parts = plant.parts(prepare(machine, shaken[0], decimate=1))
    rest = replace(motion, u=motion.u - sum(x for key, x in parts.items() if key not in bodies))
    return replace(first, beta=_beta(plant, first.beta, motion, settings.sure)).moved(rest)


def bend_all(bending: Bending | None, logs: Iterable[Log]) -> list[Log]:
    """Return logs with the velocity of the joints that bend; as they are where none does."""
    return list(logs) if bending is None else [bending.bend(log) for log in logs]


def _beta(plant: OpenLoop, cad: Floats, motion: Motion, sure: float) -> Floats:
    """Return the base parameters that drive the joints: the motors' where they tell them, else CAD's, else the mean."""
    machine = plant.machine
    found = plant.coefficients("rigid_body")
    table = {p.name: p for p in plant.parameters}
    rows = [table[f"rigid_body.{label}"] for label in machine.base.labels]
    told = np.array([p.determined and p.error < sure * abs(p.value) for p in rows])
    motors = [axis.index for axis in machine.axes.values()]
    still = [x.copy() for x in (motion.q, motion.v, motion.a)]
    for x in still:
        x[:, [part.index for part in machine.passive.values()]] = 0.0
    size = np.abs(machine.base.regressor(machine.model, *still)[:, motors]).max(axis=(0, 1))
    by_joint = size <= 1e-9 * size.max()
    return np.where(told, np.where(by_joint, 0.5 * (cad + found), found), cad)


def _unexplained(W: Floats, v: Floats, u: Floats, motors: Sequence[int]) -> Floats:
    """Return what bodies, viscous and dry friction and an offset leave of the motors' efforts, each over its size."""
    parts, efforts = [], []
    for k, j in enumerate(motors):
        block = np.zeros((len(u), len(motors), 3))
        block[:, k] = np.stack([v[:, j], np.sign(v[:, j]), np.ones(len(u))], axis=1)
        size = float(np.std(u[:, j]))
        parts.append(np.hstack([W[:, j], block.reshape(len(u), -1)]) / size)
        efforts.append(u[:, j] / size)
    X, y = np.concatenate(parts), np.concatenate(efforts)
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    return np.asarray(y - X @ (np.linalg.lstsq(X / scale, y, rcond=1e-9)[0] / scale))


def bending_warnings(bending: Bending | None) -> list[str]:
    """Return what a user must know of joints that nothing measured."""
    pairs = [] if bending is None else [(s, bending.machine.passive[s.name]) for s in bending.springs]
    return [
        f"{spring.name}: not in the log, so it moves as a spring of {spring.stiffness:.4g} "
        f"{'N·m/rad' if part.rotary else 'N/m'} has it on the CAD's inertia (machine.yaml: {part.stiffness:.4g}); "
        "`pinotwin vibration` measures it"
        for spring, part in pairs
    ]
