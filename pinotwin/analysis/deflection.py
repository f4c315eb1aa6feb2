r"""The deflection of passive joints that a twin predicts from the motion of the axes (thesis Eq. 5.4).

A passive joint is a mode that its own load drives, near the posture of the undeflected machine:

    M_pp(q) q_d'' + c q_d' + k q_d = -h_p(q, v, a),        h: the rigid body's effort without q_d

The mean inertia makes the mode, and what the posture adds to it goes with the load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.imu.mode import respond
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin import Twin


@dataclass(frozen=True)
class PassiveSpring:
    """A passive joint of a twin."""

    name: str  # of the joint
    index: int  # its column in the machine's arrays
    stiffness: float  # [N/m or N·m/rad]
    damping: float  # [N·s/m or N·m·s/rad]

    def mode(self, inertia: float) -> tuple[float, float]:
        """Return the natural frequency [rad/s] and the damping ratio with an inertia on it."""
        wn = np.sqrt(self.stiffness / inertia)
        return float(wn), float(0.5 * self.damping / np.sqrt(self.stiffness * inertia))


@dataclass(frozen=True)
class Load:
    """What drives a passive joint along a motion."""

    torque: Floats  # effort that the axes' motion puts on it, shape (n,) [N or N·m]
    inertia: Floats  # M_pp, shape (n,)
    motion: Motion  # along which

    def response(self, spring: PassiveSpring, passes: int = 3) -> tuple[Floats, Floats, Floats]:
        """Return deflection, velocity and acceleration of the joint, (n,) each; the inertia settles in passes."""
        mean = float(self.inertia.mean())
        wn, zeta = spring.mode(mean)
        x, v, a = np.zeros((3, len(self.torque)))
        for part in self.motion.segments:
            for _ in range(passes):
                load = (self.torque[part] + (mean - self.inertia[part]) * a[part]) / mean
                found = respond(load[:, None], self.motion.step, wn, zeta)
                x[part], v[part], a[part] = (y[:, 0] for y in found)
        return x, v, a


def springs(twin: Twin) -> tuple[PassiveSpring, ...]:
    """Return the passive joints of a twin whose stiffness it knows."""
    out = []
    told = {row.name: row.determined for row in twin.parameters}
    for name, part in twin.machine.passive.items():
        key = f"{name}.spring"
        if key in twin.keys and told.get(f"{key}.k", True):  # else its number is rounding, of either sign
            k, c = (float(x) for x in twin.theta[twin.slices[twin.keys.index(key)]])
            if k > 0.0:
                out.append(PassiveSpring(name, part.index, k, c))
    return tuple(out)


def load_of(machine: Machine, beta: Floats, motion: Motion, joint: int) -> Load:
    """Return what the axes' motion puts on a passive joint that does not move itself; base parameters (b,)."""
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
    """Return the motion with its passive joints as ``measured`` holds them, else as the twin's springs predict."""
    q, v, a = (x.copy() for x in (motion.q, motion.v, motion.a))
    for spring in springs(twin):
        p = spring.index
        load = load_of(twin.machine, twin.coefficients("rigid_body"), motion, p)
        q[:, p], v[:, p], a[:, p] = load.response(spring)
        if is_measured(measured, p):
            v[:, p], a[:, p] = measured.v[:, p], measured.a[:, p]
    return replace(motion, q=q, v=v, a=a)


def is_measured(motion: Motion, joint: int) -> bool:
    """Whether a log holds the velocity of a passive joint."""
    return bool(np.ptp(motion.v[:, joint]) > 0.0)
