"""A servo log as an IMU would need it: rotation, rate and acceleration of the link, by Pinocchio.

Positions are differentiated as cubic splines: central differences would lose 2 % of 20 Hz at 400 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin import dynamics
from pinotwin.arrays import Floats, Ints
from pinotwin.columns import bind
from pinotwin.errors import DataError
from pinotwin.imu.runs import ServoRun
from pinotwin.log import Log
from pinotwin.logs.channels import joint_positions, usable
from pinotwin.machine import Machine
from pinotwin.signals import low_pass


@dataclass(frozen=True)
class Joints:
    """Motion of all joints on a uniform clock, the passive ones at zero; (n,) and (n, nv)."""

    t: Floats
    q: Floats
    v: Floats
    a: Floats


@dataclass(frozen=True)
class Piece:
    """An unbroken stretch of a servo log."""

    rows: Ints  # rows of the log in it, shape (k,)
    t: Floats  # their stamps [s], (k,)
    joints: Joints  # the same stretch on a uniform clock
    run: ServoRun  # what the batch estimate takes of it


def bound(machine: Machine, log: Log) -> Log:
    """Return the log in SI and in the names of the contract; infinite values count as missing."""
    return usable(machine, bind(log, machine.columns))


def pieces(
    machine: Machine,
    log: Log,
    joint: str,
    link: str,
    cutoff: float,
    *,
    bridged: float = 8.5,
    shortest: float = 5.0,
) -> list[Piece]:
    """Return stretches of a bound log of ``shortest`` [s] or more, positions low-passed at ``cutoff`` [Hz]."""
    # The spline bridges so many samples; the shortest holds some periods of 0.5 Hz, where the dynamic band begins.
    q = joint_positions(machine, log, "q")
    given = np.all([np.isfinite(log[f"{name}.q"]) for name in machine.axes], axis=0)
    rows = np.flatnonzero(given & np.isfinite(log.t))
    rows = rows[np.concatenate([[True], np.diff(np.maximum.accumulate(log.t[rows])) > 0])]
    if len(rows) < 50:
        raise DataError(f"{log.source}: only {len(rows)} usable rows; record longer")
    for part in machine.passive.values():
        q[:, part.index] = 0.0
    step = float(np.median(np.diff(log.t[rows])))
    cuts = np.flatnonzero(np.diff(log.t[rows]) > bridged * step) + 1
    out = []
    for some in np.split(rows, cuts):
        if log.t[some[-1]] - log.t[some[0]] >= shortest:
            motion = _uniform(log.t[some], q[some], step, cutoff)
            run = servo_run(machine, motion, joint, link)
            out.append(Piece(some, log.t[some], motion, run))
    if not out:
        length = max(float(log.t[s[-1]] - log.t[s[0]]) for s in np.split(rows, cuts))
        raise DataError(
            f"{log.source}: the longest stretch without a hole is {length:.3g} s, at least "
            f"{shortest:g} s are needed to tell a vibration from a drift; record longer"
        )
    return out


def _uniform(t: Floats, q: Floats, step: float, cutoff: float) -> Joints:
    """Return positions (n, nv) and their derivatives on a uniform clock."""
    count = round(float(t[-1] - t[0]) / step)
    clock = np.linspace(t[0], t[-1], count + 1)
    rate = count / float(t[-1] - t[0])
    smooth = low_pass(CubicSpline(t, q)(clock), rate, min(cutoff, 0.4 * rate), 4)
    spline = CubicSpline(clock, smooth)
    return Joints(clock, smooth, spline(clock, 1), spline(clock, 2))


def servo_run(machine: Machine, motion: Joints, joint: str, link: str) -> ServoRun:
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


def load_columns(machine: Machine, motion: Joints, joint: str, least: float = 1e-3) -> Floats:
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


def posture_column(machine: Machine, motion: Joints, joint: str, delta: Floats) -> Floats:
    """Return minus the change of rigid-body torque by ``delta``, (n, 3), without what the mode has already, (n,)."""
    j, model = machine.passive[joint].index, machine.model
    moved = [x.copy() for x in (motion.q, motion.v, motion.a)]
    for x, column in zip(moved, delta.T, strict=True):
        x[:, j] += column
    torque = dynamics.inverse(model, *moved) - dynamics.inverse(model, motion.q, motion.v, motion.a)
    mean = float(np.mean(dynamics.mass_matrix(model, motion.q[::20])[:, j, j]))
    return mean * delta[:, 2] - torque[:, j]
