"""An adaptive extended Kalman filter for orientation, with body-acceleration rejection.

After Sabatini 2006 (DOI 10.1109/TBME.2006.875664; thesis Fig. 6-5), without magnetometer; states: quaternion (sensor
to earth) and gyro bias. The accelerometer corrects where its magnitude has been within ``gate`` of g for ``hold``.

    q[k+1] = q[k] exp((y - b) h)        y_acc = R(q)' (0, 0, g) + noise
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot
from pinotwin.system.kernels import compiled


@dataclass(frozen=True)
class EkfSettings:
    """Noise levels and the gate; SI."""

    gyro_noise: float = 1e-3  # density of the gyro's noise, with room for unmodelled errors [rad/s/sqrt(Hz)]
    accel_noise: float = 1.0  # standard deviation of an accepted accelerometer sample about gravity [m/s²]
    gate: float = 0.4  # accept a sample when its magnitude is this near to g [m/s²]
    hold: float = 0.1  # and has been for so long [s]
    bias: float = 0.01  # first gyro bias [rad/s]
    bias_walk: float = 2e-5  # its random walk [rad/s/sqrt(s)]
    g: float = 9.81  # gravity [m/s²]


@compiled
def transition(x, gyr, h):  # type: ignore[no-untyped-def]
    """Return the next state (7,) and its Jacobian (7, 7): rate ``gyr`` [rad/s] over h [s]."""
    F = np.eye(7)
    phi = (gyr - x[4:7]) * h
    angle = np.sqrt(phi @ phi)
    c = np.cos(0.5 * angle)
    small = angle < 1e-4
    s = 0.5 - angle**2 / 48.0 if small else np.sin(0.5 * angle) / angle  # exp = (c, s phi)
    ds = -1.0 / 24.0 if small else (0.5 * c - s) / angle**2  # (ds/d angle) / angle
    w, a, b, d = c, s * phi[0], s * phi[1], s * phi[2]
    right = np.array([[w, -a, -b, -d], [a, w, d, -b], [b, -d, w, a], [d, b, -a, w]])
    q = x[:4]
    left = np.array(
        [
            [q[0], -q[1], -q[2], -q[3]],
            [q[1], q[0], -q[3], q[2]],
            [q[2], q[3], q[0], -q[1]],
            [q[3], -q[2], q[1], q[0]],
        ]
    )
    D = np.empty((4, 3))  # d exp / d phi
    for j in range(3):
        D[0, j] = -0.5 * s * phi[j]
        for i in range(3):
            D[i + 1, j] = ds * phi[i] * phi[j] + (s if i == j else 0.0)
    F[:4, :4] = right
    F[:4, 4:7] = -h * (left @ D)
    y = x.copy()
    y[:4] = right @ np.ascontiguousarray(q)
    return y, F


@compiled
def gravity_rows(x, g):  # type: ignore[no-untyped-def]
    """Return the predicted specific force (3,) at rest and its Jacobian (3, 7)."""
    w, a, b, c = x[0], x[1], x[2], x[3]
    z = np.array([2 * (a * c - w * b), 2 * (b * c + w * a), w * w - a * a - b * b + c * c])
    H = np.zeros((3, 7))
    H[0, :4] = np.array([-b, c, -w, a]) * (2 * g)
    H[1, :4] = np.array([a, w, c, b]) * (2 * g)
    H[2, :4] = np.array([w, -a, -b, c]) * (2 * g)
    return g * z, H


@compiled
def _forward(turn, acc, h, x0, P0, noise, s):  # type: ignore[no-untyped-def]
    """Return predicted and filtered states, covariances; ``turn`` rates (n - 1, 3), squared ``noise``, ``s``."""
    n = len(acc)
    xp, xf = np.empty((n, 7)), np.empty((n, 7))
    Pp, Pf = np.empty((n, 7, 7)), np.empty((n, 7, 7))
    x, P, run = x0.copy(), P0.copy(), 0
    for k in range(n):
        if k > 0:
            x, F = transition(x, turn[k - 1], h)
            P = F @ P @ F.T
            B = np.ascontiguousarray(F[:4, 4:7])
            P[:4, :4] += (noise[0] / h) * (B @ B.T)
            for i in range(3):
                P[4 + i, 4 + i] += noise[1] * h
        xp[k], Pp[k] = x, P
        near = abs(np.sqrt(acc[k] @ acc[k]) - s[2]) < s[1]
        run = run + 1 if near else 0
        if run > 0 and (run >= s[3] or run == k + 1):
            z, H = gravity_rows(x, s[2])
            PH = P @ H.T
            S = H @ PH + s[0] * np.eye(3)
            gain = np.ascontiguousarray(np.linalg.solve(S, np.ascontiguousarray(PH.T)).T)
            x = x + gain @ (acc[k] - z)
            P = P - gain @ PH.T
            P = 0.5 * (P + P.T)
            x[:4] /= np.sqrt(x[:4] @ x[:4])
        xf[k], Pf[k] = x, P
    return xp, Pp, xf, Pf


@compiled
def _smooth(turn, h, xp, Pp, xf, Pf):  # type: ignore[no-untyped-def]
    n = len(xf)
    x = xf.copy()
    for k in range(n - 2, -1, -1):
        _, F = transition(xf[k], turn[k], h)
        ridge = Pp[k + 1] + 1e-18 * np.eye(7)
        C = np.ascontiguousarray(np.linalg.solve(ridge, F @ Pf[k]).T)
        x[k] = xf[k] + C @ (x[k + 1] - xp[k + 1])
        x[k, :4] /= np.sqrt(x[k, :4] @ x[k, :4])
    return x


def ekf(
    gyr: Floats,
    acc: Floats,
    rate: float,
    settings: EkfSettings | None = None,
    *,
    smooth: bool = False,
    rule: rot.Rule = "mean",
) -> tuple[Floats, Floats]:
    """Return quaternions (n, 4), sensor to earth, and gyro biases [rad/s], (n, 3); arguments as of ``orientation``."""
    s = EkfSettings() if settings is None else settings
    gyr, acc = np.ascontiguousarray(gyr, dtype=float), np.ascontiguousarray(acc, dtype=float)
    if gyr.shape != acc.shape or gyr.ndim != 2 or gyr.shape[1] != 3 or len(gyr) < 2:
        raise DataError(f"gyr {gyr.shape} and acc {acc.shape} must both be (n, 3) with n >= 2")
    head = acc[: max(1, round(0.1 * rate))].mean(axis=0)
    level = Rotation.align_vectors([0.0, 0.0, 1.0], head)[0].as_quat(scalar_first=True)
    x0 = np.concatenate([level, np.zeros(3)])
    P0 = np.diag(np.repeat([2.5e-3, s.bias**2], [4, 3]))
    noise = np.array([0.5 * s.gyro_noise**2, s.bias_walk**2])
    gate = np.array([s.accel_noise**2, s.gate, s.g, s.hold * rate])
    turn = rot.increments(gyr, 1.0 / rate, rule) * rate
    xp, Pp, x, P = _forward(turn, acc, 1.0 / rate, x0, P0, noise, gate)
    if smooth:
        x = _smooth(turn, 1.0 / rate, xp, Pp, x, P)
    return x[:, :4], x[:, 4:7]
