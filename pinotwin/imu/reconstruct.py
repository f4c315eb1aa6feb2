"""Deflection angles from orientations, as the source does it (thesis Eq. 6.26-6.28).

The rigid chain from the machine to the link is ``R_link = R_base R_rest``, with the passive joint
between the two. The IMU's orientation gives the true one, so the joint's rotation is

    R_joint = R_base' R_GM' R_earth_sensor R_ST R_rest'

(transposed against Eq. 6.27, whose matrices turn coordinates), and its three angles about the axes
of the joint frame are the principal and the two parasitic deflections. This is the baseline: every
scale error of the gyro is integrated with the motion. ``pinotwin.imu.batch`` is the remedy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot


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


def high_passed(t: Floats, angle: Floats, corner: float) -> Floats:
    """Return angles (n, ...) without what is slower than ``corner`` [Hz], zero phase, fourth order.

    Raises:
        DataError: the record is too short for that corner.
    """
    step = float(np.median(np.diff(t)))
    if len(t) * step * corner < 2.0:
        raise DataError(f"a record of {len(t) * step:.2g} s is too short for a {corner} Hz corner")
    sos = butter(2, corner, "highpass", fs=1.0 / step, output="sos")
    pad = min(len(t) - 1, round(1.0 / (corner * step)))
    return sosfiltfilt(sos, angle - np.mean(angle, axis=0), axis=0, padlen=pad)


def joint_frame(axis: Floats) -> Floats:
    """Return a right-handed frame (columns) whose first axis is ``axis``."""
    x = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(helper, x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)
