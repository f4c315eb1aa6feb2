"""The ways to a deflection that the batch estimate has to beat, from the same data.

Naive integration of the gyro's difference to the encoders, the same high-passed, and the source's
chain (orientation filter, inertial alignment, mounting, Eq. 6.27) with the adaptive filter or VQF.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.imu import rotation as rot
from pinotwin.imu.align import inertial_alignment, mounting, mounting_from_rates
from pinotwin.imu.clock import ClockFit
from pinotwin.imu.noise import rest
from pinotwin.imu.orientation import Method, orientation
from pinotwin.imu.reconstruct import Deflection, high_passed, naive, reconstruct
from pinotwin.imu.runs import ImuRun, ServoRun


def baselines(
    servo: ServoRun, imu: ImuRun, clock: ClockFit, delay: float = 0.0, corner: float = 0.5
) -> dict[str, Deflection]:
    """Return deflections by "naive", "high-passed", "ekf" and "vqf", principal axis first.

    The near side of the joint is taken not to rotate (a linear axis carries it).

    Args:
        servo: the run as the machine saw it.
        imu: the run as the IMU saw it.
        clock: how its clock relates to the servo's.
        delay: group delay of the gyro's low-pass [s].
        corner: of the high-pass [Hz].
    """
    gyr, acc = _on_servo_clock(servo, imu, clock, delay)
    rate = 1.0 / float(servo.t[1] - servo.t[0])
    still = rest(gyr, acc, rate)
    bias = gyr[still].mean(axis=0) if still.any() else np.zeros(3)
    gyr = gyr - bias
    up = servo.R[:, 2]
    R_ST = mounting_from_rates(servo.w, gyr, (up, acc)).R
    world = np.einsum("nij,nj->ni", servo.R, gyr @ R_ST - servo.w)
    axis = np.mean(np.einsum("nij,nj->ni", servo.R, servo.axis), axis=0)
    frame = _frame_rows(axis)
    difference = world @ frame.T
    step = 1.0 / rate
    slope = np.gradient(difference, step, axis=0)
    integral = naive(servo.t, difference)
    out = {
        "naive": Deflection(servo.t, integral, difference, slope),
        "high-passed": Deflection(
            servo.t, high_passed(servo.t, integral, corner), difference, slope
        ),
    }
    methods: tuple[Method, ...] = ("ekf", "vqf")
    for method in methods:
        out[method] = _chain(servo, gyr, acc, rate, method, axis)
    return out


def _chain(
    servo: ServoRun, gyr: Floats, acc: Floats, rate: float, method: Method, axis: Floats
) -> Deflection:
    """Return the source's reconstruction with an orientation filter."""
    q = orientation(gyr, acc, rate, method)
    machine = np.einsum("nij,nj->ni", servo.R, servo.w)
    R_GM = inertial_alignment(machine, rot.rotate(q, gyr), np.array([0.0, 0.0, 1.0])).R
    R_ST = mounting(q, R_GM, servo.R).R
    return reconstruct(servo.t, q, R_GM, R_ST, servo.R, axis=axis)


def _on_servo_clock(
    servo: ServoRun, imu: ImuRun, clock: ClockFit, delay: float
) -> tuple[Floats, Floats]:
    at = clock.to_ref(imu.t) - delay
    ok = np.isfinite(at)
    order = np.argsort(at[ok])
    at = at[ok][order]
    gyr, acc = (
        np.stack([np.interp(servo.t, at, c) for c in x[ok][order].T], axis=1)
        for x in (imu.gyr, imu.acc)
    )
    return gyr, acc


def _frame_rows(axis: Floats) -> Floats:
    """Return the principal axis and two across it, as rows."""
    x = axis / np.linalg.norm(axis)
    y = np.cross(np.eye(3)[int(np.argmin(np.abs(x)))], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])
