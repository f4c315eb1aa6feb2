"""The machine's side of a reconstruction: what it is known by, and a servo log as an IMU would need it, by Pinocchio.

Positions are differentiated as cubic splines: central differences would lose 2 % of 20 Hz at 400 Hz. What a first pass
leaves out of the load are columns of a second one, each with a free gain: the inertia's dependence on the posture
(:func:`posture_column`), and of the angle q

    -(q / p)³             hardening,     p the largest deflection
    -z_w(q) / p           hysteresis,    z_w the stop operator of width w = 0.1, 0.2, 0.4 p

A sum of stops (Prandtl-Ishlinskii: Visintin 1994, ISBN 978-3-540-54793-1) follows any rate-independent hysteresis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin import dynamics
from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError, MachineError, require
from pinotwin.imu.filters import group_delay
from pinotwin.imu.result import BatchResult, RunResult
from pinotwin.imu.runs import Priors, ServoRun
from pinotwin.log import Log
from pinotwin.logs.channels import joint_positions
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import joined, low_pass
from pinotwin.system.kernels import compiled


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
    J = dynamics.jacobian(machine.model, chosen, machine.posture()[None])
    if np.linalg.norm(J[0, 3:, machine.passive[joint].index]) < 1e-9:
        raise DataError(
            f"{machine.name}: link {chosen!r} does not move with the passive joint {joint!r}; "
            "an IMU there cannot see the deflection"
        )
    return chosen


def priors(machine: Machine, joint: str, settings: Settings) -> Priors:
    """Return the priors of the batch estimate: the mode from machine.yaml, gravity, low-passes."""
    part = machine.passive[joint]
    inertia = float(dynamics.mass_matrix(machine.model, machine.posture()[None])[0, part.index, part.index])
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


@dataclass(frozen=True)
class Piece:
    """An unbroken stretch of a servo log."""

    rows: Ints  # rows of the log in it, shape (k,)
    t: Floats  # their stamps [s], (k,)
    joints: Motion  # the same stretch on a uniform clock, the passive joints at zero
    run: ServoRun  # what the batch estimate takes of it


def pieces(machine: Machine, log: Log, joint: str, link: str, cutoff: float) -> list[Piece]:
    """Return stretches of a bound log of 5 s or more, positions low-passed at ``cutoff`` [Hz]."""
    # The spline bridges so many samples; the shortest holds some periods of 0.5 Hz, where the dynamic band begins.
    bridged, shortest = 8.5, 5.0
    q = joint_positions(machine, log, "q")
    given = np.all([np.isfinite(log[f"{name}.q"]) for name in machine.axes], axis=0)
    rows = np.flatnonzero(given & np.isfinite(log.t))
    rows = rows[np.concatenate([[True], np.diff(np.maximum.accumulate(log.t[rows])) > 0])]
    if len(rows) < 50:
        raise DataError(f"{log.source}: only {len(rows)} usable rows; record longer")
    for part in machine.passive.values():
        q[:, part.index] = 0.0
    step = float(np.median(np.diff(log.t[rows])))
    unbroken = [rows[part] for part in joined(log.t[rows], bridged * step)]
    out = []
    for some in unbroken:
        if log.t[some[-1]] - log.t[some[0]] >= shortest:
            motion = _uniform(machine, log.t[some], q[some], step, cutoff)
            run = servo_run(machine, motion, joint, link)
            out.append(Piece(some, log.t[some], motion, run))
    if not out:
        length = max(float(log.t[s[-1]] - log.t[s[0]]) for s in unbroken)
        raise DataError(
            f"{log.source}: the longest stretch without a hole is {length:.3g} s, at least "
            f"{shortest:g} s are needed to tell a vibration from a drift; record longer"
        )
    return out


def _uniform(machine: Machine, t: Floats, q: Floats, step: float, cutoff: float) -> Motion:
    """Return positions (n, nv) and their derivatives on a uniform clock."""
    count = round(float(t[-1] - t[0]) / step)
    clock = np.linspace(t[0], t[-1], count + 1)
    rate = count / float(t[-1] - t[0])
    smooth = low_pass(CubicSpline(t, q)(clock), rate, min(cutoff, 0.4 * rate), 4)
    spline = CubicSpline(clock, smooth)
    joints = machine.names, machine.rotary
    return Motion.exact(joints, clock, smooth, spline(clock, 1), spline(clock, 2))


def servo_run(machine: Machine, motion: Motion, joint: str, link: str) -> ServoRun:
    """Return what encoders and kinematics say of a link, the passive joint undeflected."""
    model, index = machine.model, machine.passive[joint].index
    twist = dynamics.frame_velocity(model, link, motion.q, motion.v)
    acceleration = dynamics.frame_acceleration(model, link, motion.q, motion.v, motion.a)
    column = dynamics.jacobian(model, link, motion.q)[:, :, index]
    axis = column[:, 3:]
    return ServoRun(
        t=motion.t,
        R=dynamics.frame_rotation(model, link, motion.q),
        w=twist[:, 3:],
        a=acceleration[:, :3],
        axis=axis,
        arm=np.cross(column[:, :3], axis),  # the Jacobian's linear part is axis x arm
        load=load_columns(machine, motion, joint),
    )


def load_columns(machine: Machine, motion: Motion, joint: str, least: float = 1e-3) -> Floats:
    """Return minus the rigid-body torque at the joint, (n, k), a column for each base parameter above a share."""
    # CAD inertias are 10 to 20 % off: each column has its own gain, which its dynamic part fixes, and so the sag.
    index = machine.passive[joint].index
    beta = machine.base.from_standard(dynamics.parameters(machine.model))
    row = machine.base.regressor(machine.model, motion.q, motion.v, motion.a)[:, index]
    columns = -row * beta
    size = np.std(columns, axis=0)
    total = float(np.std(columns.sum(axis=1)))
    if not total > 0.0:
        raise DataError(
            f"{machine.name}: nothing in this log loads the passive joint {joint!r} (or the URDF "
            "has no inertias); move an axis that shakes it"
        )
    return columns[:, size > least * total]


def posture_column(machine: Machine, motion: Motion, joint: str, delta: Floats) -> Floats:
    """Return minus the change of rigid-body torque by ``delta``, (n, 3), without what the mode has already, (n,)."""
    j, model = machine.passive[joint].index, machine.model
    moved = [x.copy() for x in (motion.q, motion.v, motion.a)]
    for x, column in zip(moved, delta.T, strict=True):
        x[:, j] += column
    torque = dynamics.inverse(model, *moved) - dynamics.inverse(model, motion.q, motion.v, motion.a)
    mean = float(np.mean(dynamics.mass_matrix(model, motion.q[::20])[:, j, j]))
    return mean * delta[:, 2] - torque[:, j]


WIDTHS = (0.1, 0.2, 0.4)  # widths of the stop operators, as shares of the largest deflection


def needed(runs: Sequence[RunResult], unexplained: float = 0.01) -> bool:
    """Return whether a linear mode leaves more of the dynamic angle than a share of it."""
    left = np.sqrt(np.mean([r.remainder**2 for r in runs]))
    return bool(left > unexplained * np.sqrt(np.mean([np.var(r.dynamic) for r in runs])))


def with_posture(
    machine: Machine, joint: str, pieces: Sequence[Piece], found: Sequence[RunResult]
) -> list[ServoRun]:
    """Return the runs with the posture's column beside their load, unless it is below a thousandth of that."""
    columns = []
    for piece, result in zip(pieces, found, strict=True):
        delta = np.stack([result.angle, result.velocity, result.acceleration], axis=1)
        columns.append(posture_column(machine, piece.joints, joint, delta))
    runs = [piece.run for piece in pieces]
    size = float(np.sqrt(np.mean([np.var(c) for c in columns])))
    if size < 1e-3 * _load_size(runs):
        return runs
    return [replace(run, load=np.column_stack([run.load, c])) for run, c in zip(runs, columns, strict=True)]


def with_columns(servo: Sequence[ServoRun], found: Sequence[RunResult]) -> list[ServoRun]:
    """Return the runs with the columns of a nonlinear joint beside their load."""
    peak = _peak(found)
    size = _load_size(servo)
    out = []
    for run, result in zip(servo, found, strict=True):
        q = (result.angle - np.median(result.angle)) / peak
        extra = np.stack([-(q**3), *(-_stop(q, w) for w in WIDTHS)], axis=1)
        out.append(replace(run, load=np.hstack([run.load, size * extra])))
    return out


def shares(result: BatchResult, servo: Sequence[ServoRun], found: Sequence[RunResult]) -> tuple[float, float]:
    """Return hardening, hysteresis in a second pass, as shares of the spring's torque at the largest deflection."""
    gain, _ = result.shared("gain")
    wn = 2.0 * np.pi * result.frequency[0]
    own = gain[-1 - len(WIDTHS) :] * _load_size(servo) / (wn**2 * _peak(found))
    return float(own[0]), float(own[1:] @ np.array(WIDTHS))


def _peak(found: Sequence[RunResult]) -> float:
    """Return the largest deflection of all runs [rad], single samples aside."""
    return max(float(np.percentile(np.abs(r.angle - np.median(r.angle)), 99.5)) for r in found)


def _load_size(servo: Sequence[ServoRun]) -> float:
    return float(np.mean([np.std(r.load.sum(axis=1)) for r in servo]))


@compiled
def _stop(x, width):  # type: ignore[no-untyped-def]
    """Elastic up to ``width``, then it slips."""
    z = np.zeros(len(x))
    for i in range(1, len(x)):
        z[i] = min(width, max(-width, z[i - 1] + x[i] - x[i - 1]))
    return z
