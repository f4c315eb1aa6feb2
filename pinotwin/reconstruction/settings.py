"""What a user may say about a reconstruction, and what the machine says about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.dynamics import jacobian, mass_matrix
from pinotwin.errors import DataError, MachineError, require
from pinotwin.imu.filters import group_delay
from pinotwin.imu.runs import Priors
from pinotwin.machine import Machine


@dataclass(frozen=True)
class Settings:
    """How to reconstruct."""

    joint: str | None = None  # passive joint; may be left out where the machine has one
    links: tuple[str | None, ...] = (None, None)  # that carry each IMU; from machine.yaml where left out
    # corner of the low-pass inside the IMUs [Hz], second order; 0 for none. A wrong corner only shifts the
    # clock offset: the delays add up
    imu_cutoff: float = 140.0
    servo_cutoff: float = 100.0  # corner of the zero-phase low-pass on the encoders [Hz]
    delay_tolerance: float = 2e-3  # relative uncertainty of the low-pass' delay; goes into the clock's error


def passive_joint(machine: Machine, name: str | None) -> str:
    """Return the name of the passive joint that is meant; MachineError if it is none, not the only one, or slides."""
    known = list(machine.passive)
    if not known:
        raise MachineError(
            f"{machine.name}: no passive joint, so there is no deflection to reconstruct; "
            "add `passive: {NAME: {joint: JOINT}}` to machine.yaml"
        )
    if name is None and len(known) > 1:
        raise MachineError(f"{machine.name}: several passive joints ({', '.join(known)}); name one")
    chosen = known[0] if name is None else name
    require(chosen, known, f"{machine.name}: no passive joint", MachineError)
    if not machine.passive[chosen].rotary:
        raise MachineError(
            f"{machine.name}: passive joint {chosen!r} slides; only a turning one can be seen by a gyroscope"
        )
    return chosen


def imu_link(machine: Machine, joint: str, number: int, link: str | None) -> str:
    """Return the link of an IMU (0: the first), checked to lie beyond the passive joint."""
    stated = [imu.link for imu in machine.imus.values()]
    if link is None and not stated:
        raise MachineError(
            f"{machine.name}: no link is known for the IMU; add `imus: {{imu1: {{link: LINK}}}}` to "
            "machine.yaml, or name the link"
        )
    chosen = link if link is not None else stated[min(number, len(stated) - 1)]
    J = jacobian(machine.model, chosen, machine.posture()[None])
    if np.linalg.norm(J[0, 3:, machine.passive[joint].index]) < 1e-9:
        raise DataError(
            f"{machine.name}: link {chosen!r} does not move with the passive joint {joint!r}; "
            "an IMU there cannot see the deflection"
        )
    return chosen


def priors(machine: Machine, joint: str, settings: Settings) -> Priors:
    """Return the priors of the batch estimate: the mode from machine.yaml, gravity, low-passes."""
    part = machine.passive[joint]
    inertia = float(mass_matrix(machine.model, machine.posture()[None])[0, part.index, part.index])
    corner = settings.imu_cutoff if settings.imu_cutoff > 0.0 else np.inf
    frequency, damping, doubt = 20.0, 0.03, 0.7
    if part.stiffness and inertia > 0.0:
        wn = float(np.sqrt(part.stiffness / inertia))
        frequency, doubt = wn / (2.0 * np.pi), 0.3
        if part.damping:
            damping = float(np.clip(part.damping / (2.0 * inertia * wn), 0.003, 0.5))
    return Priors(
        frequency=frequency,
        damping=damping,
        log_frequency=doubt,
        gravity=np.array(machine.model.gravity.linear),
        gyro_cutoff=corner,
        accel_cutoff=corner,
        gyro_delay_sd=settings.delay_tolerance * group_delay(corner),
    )
