"""The ways to a deflection that the batch estimate has to beat, from the same data, and their table.

Naive integration of the gyro's difference to the encoders, the same high-passed, and the source's chain
(orientation filter, inertial alignment, mounting) with the adaptive filter or VQF. The chain takes angles from
orientations (thesis Eq. 6.26-6.28): the rigid chain from the machine to the link is ``R_link = R_base R_rest``, with
the passive joint between the two. The IMU's orientation gives the true one, so the joint's rotation is

    R_joint = R_base' R_GM' R_earth_sensor R_ST R_rest'

(transposed against Eq. 6.27, whose matrices turn coordinates), and its three angles about the axes of the joint frame
are the principal and the two parasitic deflections. Every scale error of the gyro is integrated with the motion.

No truth is at hand on a machine. The slow RMS of a method's angle shows its drift; with two IMUs the table also says
by how much their results differ, which is the source's own measure (0.0474 deg/s and 7.33 deg/s² after 22 repeats;
angles +-0.04 deg).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats, Mask
from pinotwin.imu import rotation as rot
from pinotwin.imu.align import fit_rotation, mounting_from_rates
from pinotwin.imu.clock import ClockFit
from pinotwin.imu.ekf import EkfSettings, ekf
from pinotwin.imu.filters import group_delay, high_passed
from pinotwin.imu.orientation import Method, orientation
from pinotwin.imu.result import joint_frame
from pinotwin.imu.runs import ImuRun, ServoRun
from pinotwin.imu.whiten import rest
from pinotwin.reconstruction.result import Sensor, SensorRun
from pinotwin.signals import rms

# The source's scheme, "only when the magnitude is about 9.8": a machine's table is never far from
# it, so the gate is narrow, and the bias was taken at rest.
_ON_A_TABLE = EkfSettings(gyro_noise=3e-4, accel_noise=0.3, gate=0.05, hold=0.1, bias=3e-4)


def baselines(servo: ServoRun, imu: ImuRun, clock: ClockFit, delay: float = 0.0) -> dict[str, Deflection]:
    """Return deflections by "naive", "high-passed", "ekf" and "vqf", principal axis first.

    The near side of the joint is taken not to rotate (a linear axis carries it).

    Args:
        servo: the run as the machine saw it.
        imu: the run as the IMU saw it.
        clock: how its clock relates to the servo's.
        delay: group delay of the gyro's low-pass [s].
    """
    gyr, acc, hole = _on_servo_clock(servo, imu, clock, delay)
    rate = 1.0 / float(servo.t[1] - servo.t[0])
    still = rest(imu.gyr, imu.acc, 1.0 / float(np.median(np.diff(imu.t))))
    bias = imu.gyr[still].mean(axis=0) if still.any() else np.zeros(3)
    gyr = gyr - bias
    up, kept = servo.R[:, 2], ~hole
    R_ST = mounting_from_rates(servo.w[kept], gyr[kept], (up[kept], acc[kept])).R
    gyr[hole] = servo.w[hole] @ R_ST.T  # the encoders carry each method through a hole
    world = np.einsum("nij,nj->ni", servo.R, gyr @ R_ST - servo.w)
    axis = np.mean(np.einsum("nij,nj->ni", servo.R, servo.axis), axis=0)
    difference = world @ joint_frame(axis)
    step = 1.0 / rate
    slope = np.gradient(difference, step, axis=0)
    integral = naive(servo.t, difference)
    out = {
        "naive": Deflection(servo.t, integral, difference, slope),
        "high-passed": Deflection(servo.t, high_passed(servo.t, integral, 0.5), difference, slope),
    }
    # In motion the source relies on the gyro alone; that the magnitude is near g does not show motion (1 m/s²
    # across gravity, a tilt of 6 deg, adds 0.05 m/s² to it), so the filter gets no force but at rest.
    at = clock.to_ref(imu.t) - delay
    known = np.isfinite(at)
    order = np.argsort(at[known])
    quiet = np.interp(servo.t, at[known][order], still[known][order].astype(float)) > 0.5
    quiet[: max(1, round(0.1 * rate))] = True  # where it starts
    resting = np.where(quiet[:, None], acc, 0.0)
    methods: tuple[Method, ...] = ("ekf", "vqf")
    for method in methods:
        out[method] = _chain(servo, gyr, resting if method == "ekf" else acc, rate, method, axis)
    return out


def _chain(
    servo: ServoRun, gyr: Floats, acc: Floats, rate: float, method: Method, axis: Floats
) -> Deflection:
    """Return the source's reconstruction with an orientation filter.

    On the servo's clock the samples are instantaneous rates, not means over the interval before them: a
    filter that takes them for means is half a sample late, 0.6 deg/s of a vibration at 20 Hz.
    """
    if method == "ekf":
        q = ekf(gyr, acc, rate, _ON_A_TABLE, rule="coning")[0]
    else:
        q = orientation(gyr, acc, rate, method, rule="coning")
    machine = np.einsum("nij,nj->ni", servo.R, servo.w)
    up = np.array([0.0, 0.0, 1.0])
    R_GM = fit_rotation(machine, rot.rotate(q, gyr), (up, up)).R
    R_ST = mounting(q, R_GM, servo.R)
    return reconstruct(servo.t, q, R_GM, R_ST, servo.R, axis=axis)


def mounting(q: Floats, R_GM: Floats, R_link: Floats) -> Floats:
    """Return R_S/T of the source (Eq. 6.20-6.25), (3, 3), as the mean over the samples.

    Args:
        q: the IMU's orientation, sensor to earth, (n, 4).
        R_GM: inertial alignment, machine to the IMU's earth frame, (3, 3).
        R_link: orientation of the link from the encoders, columns are its axes in the machine frame
            (the transpose of the source's R_T/M), (n, 3, 3).
    """
    each = np.swapaxes(rot.to_matrix(q), 1, 2) @ R_GM @ R_link
    return Rotation.from_matrix(each).mean().as_matrix()


def _on_servo_clock(
    servo: ServoRun, imu: ImuRun, clock: ClockFit, delay: float
) -> tuple[Floats, Floats, Mask]:
    """Return gyro and accelerometer at the servo's times, and where samples are missing."""
    at = clock.to_ref(imu.t) - delay
    ok = np.isfinite(at)
    order = np.argsort(at[ok])
    at = at[ok][order]
    gyr, acc = (
        np.stack([np.interp(servo.t, at, c) for c in x[ok][order].T], axis=1) for x in (imu.gyr, imu.acc)
    )
    k = np.clip(np.searchsorted(at, servo.t), 1, len(at) - 1)
    gap = at[k] - at[k - 1]
    outside = (servo.t < at[0]) | (servo.t > at[-1])
    return gyr, acc, (gap > 3.5 * np.median(np.diff(at))) | outside


@dataclass(frozen=True)
class Deflection:
    """Deflection about the three axes of a joint: principal first, then the two parasitic ones.

    Attributes:
        t: time [s], (n,).
        angle: (n, 3) [rad].
        velocity: (n, 3) [rad/s].
        acceleration: (n, 3) [rad/s²].
    """

    t: Floats
    angle: Floats
    velocity: Floats
    acceleration: Floats


def joint_angles(R_joint: Floats, axis: Floats | None = None) -> Floats:
    """Return (q_delta, q_theta, q_psi) [rad] of joint rotations (n, 3, 3), as in Eq. 6.28.

    Args:
        R_joint: rotation of the joint's far side against its near side, columns are axes.
        axis: the principal axis in the joint frame; x by default.
    """
    if axis is not None:
        A = joint_frame(axis)
        R_joint = A.T @ R_joint @ A
    # Eq. 6.28 turns coordinates by Rx Ry Rz; turning vectors it reads Rz Ry Rx
    return Rotation.from_matrix(R_joint).as_euler("ZYX")[:, ::-1]


def reconstruct(
    t: Floats,
    q: Floats,
    R_GM: Floats,
    R_ST: Floats,
    R_rest: Floats,
    axis: Floats | None = None,
) -> Deflection:
    """Return deflection angles and their derivatives from the IMU's orientation (Eq. 6.26-6.28).

    Args:
        t: common clock, uniform [s], (n,).
        q: the IMU's orientation, sensor to earth, (n, 4).
        R_GM: inertial alignment, machine to the IMU's earth, (3, 3).
        R_ST: mounting, link to sensor, (3, 3).
        R_rest: link axes in the joint's far frame from the encoders, (n, 3, 3).
        axis: principal axis in the joint frame; x by default.
    """
    near = R_GM.T @ rot.to_matrix(q) @ R_ST
    angle = joint_angles(near @ np.swapaxes(R_rest, 1, 2), axis)
    step = float(t[1] - t[0])
    velocity = np.gradient(angle, step, axis=0, edge_order=2)
    return Deflection(t, angle, velocity, np.gradient(velocity, step, axis=0, edge_order=2))


def naive(t: Floats, rate: Floats) -> Floats:
    """Return the running integral of rates (n, ...) from zero, by the trapezoidal rule."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t).reshape(-1, *([1] * (rate.ndim - 1)))
    return np.concatenate([np.zeros_like(rate[:1]), np.cumsum(steps, axis=0)])


@dataclass(frozen=True)
class MethodRow:
    """One method on the first run; RMS values, SI.

    Attributes:
        method: its name.
        slow: of the angle below 0.5 Hz [rad]: drift, where a method integrates.
        dynamic: of the angle above 0.5 Hz [rad].
        velocity: [rad/s]. acceleration: [rad/s²].
        differ: how much two IMUs differ in slow angle, dynamic angle, velocity, acceleration, (4,);
            NaN for one IMU.
    """

    method: str
    slow: float
    dynamic: float
    velocity: float
    acceleration: float
    differ: Floats


def methods(sensors: Sequence[Sensor], gyro_cutoff: float = 140.0) -> tuple[MethodRow, ...]:
    """Return the table for the first run; the corner [Hz] is that of the low-pass on the gyro."""
    each = [_signals(sensor.runs[0], gyro_cutoff) for sensor in sensors]
    out = []
    for name, first in each[0].items():
        differ = np.full(4, np.nan)
        if len(each) > 1 and first[0].shape == each[1][name][0].shape:
            differ = np.array([rms(a - b) for a, b in zip(first, each[1][name], strict=True)])
        slow, dynamic, velocity, acceleration = (rms(x) for x in first)
        out.append(MethodRow(name, slow, dynamic, velocity, acceleration, differ))
    return tuple(out)


def _signals(part: SensorRun, gyro_cutoff: float) -> Mapping[str, tuple[Floats, ...]]:
    """Return slow angle, dynamic angle, velocity and acceleration by method."""
    delay = group_delay(gyro_cutoff)
    found = baselines(part.piece.run, part.imu, part.found.clock, delay)
    t = part.piece.run.t
    out = {
        name: _split(t, d.angle[:, 0], d.velocity[:, 0], d.acceleration[:, 0]) for name, d in found.items()
    }
    best = part.found
    out["batch"] = _split(best.t, best.angle, best.velocity, best.acceleration)
    return out


def _split(t: Floats, q: Floats, v: Floats, a: Floats) -> tuple[Floats, ...]:
    fast = high_passed(t, q)
    return q - np.mean(q) - fast, fast, v, a
