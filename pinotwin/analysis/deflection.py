r"""The deflection of passive joints that a twin predicts from the motion of the axes (thesis Eq. 5.4).

With the posture nearly that of the undeflected machine, a passive joint is a mode that its own load drives:

    M_pp(q) q_d'' + c q_d' + k q_d = -h_p(q, v, a),        h: the rigid body's effort without q_d

The mean inertia makes the mode, and what the posture adds to it goes with the load. A twin that was
identified with its springs is diagnosed with the joints bent so, or as they were measured. Of a machine whose logs do
not hold its passive joints, they are bent as its spring has it: stiffness and damping start at those of machine.yaml
and are moved to where the motors' own rows leave least (:class:`Bending`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import parameters
from pinotwin.imu.mode import respond
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin import Twin

PASSES = 3  # in which the inertia's change with the posture settles


@dataclass(frozen=True)
class PassiveSpring:
    """A passive joint of a twin.

    Attributes:
        name: of the joint.
        index: its column in the machine's arrays.
        stiffness: [N/m or N·m/rad].
        damping: [N·s/m or N·m·s/rad].
    """

    name: str
    index: int
    stiffness: float
    damping: float

    def mode(self, inertia: float) -> tuple[float, float]:
        """Return the natural frequency [rad/s] and the damping ratio with an inertia on it."""
        wn = np.sqrt(self.stiffness / inertia)
        return float(wn), float(0.5 * self.damping / np.sqrt(self.stiffness * inertia))


@dataclass(frozen=True)
class Load:
    """What drives a passive joint along a motion.

    Attributes:
        torque: effort that the axes' motion puts on it, shape (n,) [N or N·m].
        inertia: M_pp, shape (n,).
        motion: along which.
    """

    torque: Floats
    inertia: Floats
    motion: Motion

    def response(self, spring: PassiveSpring) -> tuple[Floats, Floats, Floats]:
        """Return deflection, velocity and acceleration of the joint, shape (n,) each."""
        mean = float(self.inertia.mean())
        wn, zeta = spring.mode(mean)
        x, v, a = np.zeros((3, len(self.torque)))
        for part in self.motion.segments:
            for _ in range(PASSES):
                load = (self.torque[part] + (mean - self.inertia[part]) * a[part]) / mean
                found = respond(load[:, None], self.motion.step, wn, zeta)
                x[part], v[part], a[part] = found.x[:, 0], found.v[:, 0], found.a[:, 0]
        return x, v, a


def springs(twin: Twin) -> tuple[PassiveSpring, ...]:
    """Return the passive joints of a twin whose stiffness it knows."""
    out = []
    for name, part in twin.machine.passive.items():
        key = f"{name}.spring"
        if key in twin.keys:
            k, c = (float(x) for x in twin.theta[twin.slices[twin.keys.index(key)]])
            if k > 0.0:
                out.append(PassiveSpring(name, part.index, k, c))
    return tuple(out)


def load_on(twin: Twin, motion: Motion, joint: int) -> Load:
    """Return what the axes' motion puts on a passive joint that does not move itself."""
    return _load(twin.machine, twin.theta[twin.slices[twin.keys.index("rigid_body")]], motion, joint)


def _load(machine: Machine, beta: Floats, motion: Motion, joint: int) -> Load:
    """Return the same of a machine with base parameters ``beta``."""
    still = [x.copy() for x in (motion.q, motion.v, motion.a)]
    for x in still:
        x[:, joint] = 0.0
    torque = machine.base.regressor(machine.model, *still)[:, joint] @ beta
    alone = [still[0], np.zeros_like(still[1]), np.zeros_like(still[2])]
    weight = machine.base.regressor(machine.model, *alone)[:, joint] @ beta
    alone[2][:, joint] = 1.0
    inertia = machine.base.regressor(machine.model, *alone)[:, joint] @ beta - weight
    return Load(-torque, inertia, motion)


def bent(twin: Twin, motion: Motion, measured: Motion) -> Motion:
    """Return the motion with its passive joints as they were measured, else as the twin predicts.

    Args:
        twin: with its springs.
        motion: of the axes.
        measured: the same log with whatever it holds of the passive joints.
    """
    q, v, a = (x.copy() for x in (motion.q, motion.v, motion.a))
    for spring in springs(twin):
        p = spring.index
        q[:, p], v[:, p], a[:, p] = load_on(twin, motion, p).response(spring)
        if is_measured(measured, p):
            v[:, p], a[:, p] = measured.v[:, p], measured.a[:, p]
    return replace(motion, q=q, v=v, a=a)


def is_measured(motion: Motion, joint: int) -> bool:
    """Whether a log holds the velocity of a passive joint."""
    return bool(np.ptp(motion.v[:, joint]) > 0.0)


STIFFER, DAMPED = (0.4, 2.5), (0.2, 5.0)
"""Factors on the stiffness and damping of machine.yaml within which a spring is looked for."""
ROWS = 4000
"""Rows of a log that a spring is moved by."""


@dataclass(frozen=True)
class Bending:
    """How the passive joints of a machine bend along logs that do not hold them.

    Attributes:
        machine: with stiffness and damping of its passive joints in machine.yaml.
        beta: base parameters that drive the joints, shape (b,).
        springs: as they were moved.
    """

    machine: Machine
    beta: Floats
    springs: tuple[PassiveSpring, ...]

    @classmethod
    def stated(cls, machine: Machine) -> Bending:
        """Return that of the CAD's bodies and of the springs in machine.yaml."""
        springs = [
            PassiveSpring(p.name, p.index, float(p.stiffness or 0.0), float(p.damping or 0.0))
            for p in machine.passive.values()
        ]
        return cls(machine, machine.base.from_standard(parameters(machine.model)), tuple(springs))

    def moved(self, motion: Motion) -> Bending:
        """Return the same with the springs where the motors' rows, fitted by all that is linear, leave least.

        Args:
            motion: without the joints; its effort may lack what friction and tables take of it.
        """
        return replace(self, springs=tuple(_moved(self.machine, self.beta, motion, self.springs)))

    def bend(self, log: Log, motion: Motion) -> Log:
        """Return a log with the velocity of the joints.

        Args:
            log: in the names of the contract.
            motion: of the axes along it.
        """
        channels = dict(log.channels)
        for spring in self.springs:
            v = _load(self.machine, self.beta, motion, spring.index).response(spring)[1]
            channels[f"{spring.name}.v"] = np.interp(log.t, motion.t, v)
        return log.with_channels(channels)


def holds(log: Log, joint: str) -> bool:
    """Whether a log in the names of the contract holds a passive joint's position or velocity."""
    return f"{joint}.q" in log or f"{joint}.v" in log


def bends(machine: Machine, logs: Sequence[Log]) -> bool:
    """Whether springs of machine.yaml must stand for passive joints that no log holds.

    Args:
        machine: with or without passive joints.
        logs: in the names of the contract.
    """
    parts = machine.passive.values()
    held = any(holds(log, p.name) for p in parts for log in logs)
    return bool(parts) and all(p.stiffness for p in parts) and not held and bool(logs)


def with_deflections(machine: Machine, logs: Sequence[Log]) -> list[Log]:
    """Return the logs of a machine with the velocity of its passive joints, as its springs have it.

    Logs that hold it, and machines whose springs are not given, are returned as they are.

    Args:
        machine: with stiffness and damping of its passive joints in machine.yaml.
        logs: in the names of the contract.
    """
    if not bends(machine, logs):
        return list(logs)
    motions = [prepare(machine, log, decimate=1) for log in logs]
    bending = Bending.stated(machine).moved(motions[0])
    return [bending.bend(log, m) for log, m in zip(logs, motions, strict=True)]


def _moved(
    machine: Machine, beta: Floats, motion: Motion, springs: Sequence[PassiveSpring]
) -> list[PassiveSpring]:
    """Return the springs where the motors' rows, fitted by all that is linear, leave least."""
    loads = [_load(machine, beta, motion, s.index) for s in springs]
    inside = np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])
    rows = inside[:: max(1, len(inside) // ROWS)]
    motors = [a.index for a in machine.axes.values() if np.isfinite(motion.u[rows, a.index]).all()]
    motors = [j for j in motors if np.ptp(motion.u[rows, j]) > 0.0 and np.ptp(motion.v[rows, j]) > 0.0]

    def at(x: Floats) -> list[PassiveSpring]:
        k, c = np.exp(x[: len(springs)]), np.exp(x[len(springs) :])
        return [
            replace(s, stiffness=s.stiffness * a, damping=s.damping * b)
            for s, a, b in zip(springs, k, c, strict=True)
        ]

    def left(x: Floats) -> Floats:
        q, v, a = (y[rows].copy() for y in (motion.q, motion.v, motion.a))
        for spring, load in zip(at(x), loads, strict=True):
            q[:, spring.index], v[:, spring.index], a[:, spring.index] = (
                y[rows] for y in load.response(spring)
            )
        W = machine.base.regressor(machine.model, q, v, a)
        parts, efforts = [], []
        for j in motors:
            own = np.stack([v[:, j], np.sign(v[:, j]), np.ones(len(rows))], axis=1)
            block = np.zeros((len(rows), 3 * len(motors)))
            block[:, 3 * motors.index(j) : 3 * motors.index(j) + 3] = own
            size = float(np.std(motion.u[rows, j]))
            parts.append(np.hstack([W[:, j], block]) / size)
            efforts.append(motion.u[rows, j] / size)
        X, y = np.concatenate(parts), np.concatenate(efforts)
        scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        return np.asarray(y - X @ (np.linalg.lstsq(X / scale, y, rcond=1e-9)[0] / scale))

    n = len(springs)
    bounds = np.log([*[STIFFER] * n, *[DAMPED] * n]).T
    if not motors:
        return list(springs)
    found = least_squares(left, np.zeros(2 * n), bounds=(bounds[0], bounds[1]), diff_step=0.02, max_nfev=12)
    return at(found.x)
