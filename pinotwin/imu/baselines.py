"""The ways to a deflection that the batch estimate has to beat, from the same data.

Naive integration of the gyro's difference to the encoders, the same high-passed, and the source's
chain (orientation filter, inertial alignment, mounting, Eq. 6.27) with the adaptive filter or VQF.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.imu import rotation as rot
from pinotwin.imu.align import inertial_alignment, mounting, mounting_from_rates
from pinotwin.imu.clock import ClockFit
from pinotwin.imu.ekf import EkfSettings, ekf
from pinotwin.imu.noise import rest
from pinotwin.imu.orientation import Method, orientation
from pinotwin.imu.reconstruct import Deflection, high_passed, joint_frame, naive, reconstruct
from pinotwin.imu.runs import ImuRun, ServoRun

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
        q = ekf(gyr, acc, rate, _ON_A_TABLE, rule="coning").q
    else:
        q = orientation(gyr, acc, rate, method, rule="coning")
    machine = np.einsum("nij,nj->ni", servo.R, servo.w)
    R_GM = inertial_alignment(machine, rot.rotate(q, gyr), np.array([0.0, 0.0, 1.0])).R
    R_ST = mounting(q, R_GM, servo.R).R
    return reconstruct(servo.t, q, R_GM, R_ST, servo.R, axis=axis)


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
