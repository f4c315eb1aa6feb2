"""Orientation by an adaptive extended Kalman filter, and by a smoother over the whole record of a bounded sensor.

The filter is that of Sabatini 2006 (DOI 10.1109/TBME.2006.875664; thesis Fig. 6-5) without magnetometer; states:
quaternion (sensor to earth) and gyro bias. It rejects body accelerations: the accelerometer corrects where its size
has been within ``gate`` of g for ``hold``.

    q[k+1] = q[k] exp((y - b) h)        y_acc = R(q)' (0, 0, g) + noise

The smoother: a body that stays in the room cannot keep accelerating (VQF low-passes with 3 s: Laidig and Seel 2023, DOI
10.1016/j.inffus.2022.10.014): a tilt error e is a position error g e T²/2, 8.6 m for 1 deg over 10 s. States: error e
(earth frame), velocity, position, biases of gyro and accelerometer, gyro matrix, deviation of g:

    e' = -R (db + dK y)        v' = R f + e x (R f) - R da - dg z        p' = v

measured: position 0 +- sigma_p, velocity 0 +- sigma_v of correlation time tau; smoothed in blocks, relinearised.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot
from pinotwin.imu.kalman import LinearModel, backward, update
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
    D[0] = -0.5 * s * phi
    D[1:] = np.outer(ds * phi, phi) + s * np.eye(3)
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
    """Return Jacobians, predicted and filtered states and covariances; ``turn`` rates (n - 1, 3), squared ``noise``."""
    n = len(acc)
    Fs = np.empty((n - 1, 7, 7))
    xp, xf = np.empty((n, 7)), np.empty((n, 7))
    Pp, Pf = np.empty((n, 7, 7)), np.empty((n, 7, 7))
    x, P, run = x0.copy(), P0.copy(), 0
    for k in range(n):
        if k > 0:
            x, F = transition(x, turn[k - 1], h)
            Fs[k - 1] = F
            P = F @ P @ F.T
            B = np.ascontiguousarray(F[:4, 4:7])
            P[:4, :4] += (noise[0] / h) * (B @ B.T)
            P[4:, 4:] += noise[1] * h * np.eye(3)
        xp[k], Pp[k] = x, P
        near = abs(np.sqrt(acc[k] @ acc[k]) - s[2]) < s[1]
        run = run + 1 if near else 0
        if run > 0 and (run >= s[3] or run == k + 1):
            z, H = gravity_rows(x, s[2])
            y = acc[k] - z + H @ x
            for i in range(3):
                update(x, P, H[i], y[i], s[0])
            P = 0.5 * (P + P.T)
            x[:4] /= np.sqrt(x[:4] @ x[:4])
        xf[k], Pf[k] = x, P
    return Fs, xp, Pp, xf, Pf


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
    found = _forward(turn, acc, 1.0 / rate, x0, P0, noise, gate)
    x = backward(*found)[0] if smooth else found[3]
    return x[:, :4] / np.linalg.norm(x[:, :4], axis=1, keepdims=True), x[:, 4:7]


# places of the states
_E, _V, _P, _B, _K, _A, _G = (slice(*x) for x in pairwise((0, 3, 6, 9, 12, 21, 24, 25)))
_SIZE = 25


@dataclass(frozen=True)
class Bounds:
    """What is known beforehand; standard deviations, SI. One set serves all motions."""

    position: float = 0.5  # how far the sensor strays from its mean place [m]
    velocity: float = 1.0  # how fast it moves [m/s]
    tau: float = 1.0  # correlation time of both [s]
    gyro_noise: float = 5e-4  # density of noise and unmodelled errors [rad/s/sqrt(Hz)]
    accel_noise: float = 0.02  # likewise of the accelerometer [m/s²/sqrt(Hz)]
    bias: float = 0.02  # first gyro bias [rad/s]
    bias_walk: float = 2e-4  # its random walk [rad/s/sqrt(s)]
    gyro_matrix: float = 3e-3  # scale and misalignment of the gyro [-]
    accel_bias: float = 5e-3  # [m/s²]; small: only a sensor that turns tells it from a tilt
    g: float = 9.81  # gravity [m/s²]
    gravity: float = 0.05  # its deviation
    block: float = 0.03  # length of the blocks that the smoother steps over [s]
    iterations: int = 4  # rounds of relinearisation


@dataclass(frozen=True)
class _Nominal:
    """What is linearised about: orientation (any), gyro bias and matrix, accel bias, g."""

    q: Floats  # (n, 4)
    bias: Floats  # (n, 3)
    K: Floats
    accel_bias: Floats
    g: float


def offline_orientation(gyr: Floats, acc: Floats, rate: float, rule: rot.Rule = "mean") -> Floats:
    """Return quaternions (n, 4), sensor to earth, heading as at the start; arguments as of ``orientation``."""
    b = Bounds()
    m = max(1, round(b.block * rate))
    if len(gyr) < 3 * m:
        raise DataError(f"{len(gyr)} samples at {rate:.0f} Hz are too short for an orientation")
    pad = -(len(gyr) - 1) % m  # whole blocks: repeat the last sample
    n = len(gyr)
    gyr, acc = (np.concatenate([x, np.repeat(x[-1:], pad, axis=0)]) for x in (gyr, acc))
    q, bias = ekf(gyr, acc, rate, smooth=True, rule=rule)
    turn = rot.increments(gyr, 1.0 / rate, rule)
    force = 0.5 * (acc[1:] + acc[:-1])
    nominal = _Nominal(q, bias, np.zeros((3, 3)), np.zeros(3), b.g)
    for _ in range(b.iterations):
        nominal = _correct(nominal, _deviations(turn, force, rate, nominal, b, m), m)
    return nominal.q[:n]


def _deviations(turn: Floats, acc: Floats, rate: float, nom: _Nominal, b: Bounds, m: int) -> Floats:
    """Return smoothed deviations at block boundaries, (k, 25); ``turn``, ``acc`` are of the steps between samples."""
    n = len(turn) // m
    F, u = _transitions(turn * rate, acc, rate, nom, m)
    u[:, _E] = _mismatch(turn, rate, nom, m)
    dt = m / rate
    Q = np.zeros((1, _SIZE, _SIZE))
    density = np.repeat([b.gyro_noise**2, b.accel_noise**2, 0.0, 2.0 * b.bias_walk**2], 3)
    Q[0, :12, :12] = 0.5 * dt * np.diag(density)
    H = np.zeros((1, 6, _SIZE))
    H[0, :3, _P], H[0, 3:, _V] = np.eye(3), np.eye(3)
    variance = np.repeat([b.position**2, b.velocity**2], 3) * b.tau / dt
    sd = np.repeat(
        [0.2, b.velocity, b.position, b.bias, b.gyro_matrix, b.accel_bias, b.gravity], [3, 3, 3, 3, 9, 3, 1]
    )
    sd[2] = 1e-4  # heading is free: keep the start's
    x0 = np.zeros(_SIZE)  # the priors are on the whole, the states on what is left of it
    x0[_B], x0[_K], x0[_A] = -nom.bias[0], -nom.K.ravel(), -nom.accel_bias
    x0[_G] = b.g - nom.g
    model = LinearModel(F, u, Q, H, x0, np.diag(sd**2))
    return model.smooth(np.zeros((n + 1, 6)), np.broadcast_to(variance, (n + 1, 6)))[0]


def _transitions(gyr: Floats, acc: Floats, rate: float, nom: _Nominal, m: int) -> tuple[Floats, Floats]:
    """Return F (n, 25, 25) and u (n, 25) of the blocks, but for the rotation's share of u."""
    n, h, dt = len(gyr) // m, 1.0 / rate, m / rate
    q = nom.q[:-1] + nom.q[1:] * np.sign(np.sum(nom.q[:-1] * nom.q[1:], axis=1))[:, None]
    R = rot.to_matrix(q)  # halfway through each step
    force = np.einsum("nij,nj->ni", R, acc - nom.accel_bias)
    a = force - np.array([0.0, 0.0, nom.g])

    def mean(x: Floats) -> Floats:
        return x.reshape(n, m, *x.shape[1:]).mean(axis=1)

    Rm, cross = mean(R), -rot.skew(mean(force))
    F = np.tile(np.eye(_SIZE), (n, 1, 1))
    F[:, _E, _B] = -dt * Rm
    F[:, _E, _K] = -dt * mean(np.einsum("nij,nk->nijk", R, gyr)).reshape(n, 3, 9)
    F[:, _V, _E], F[:, _P, _E] = dt * cross, 0.5 * dt**2 * cross
    F[:, _V, _A], F[:, _P, _A] = -dt * Rm, -0.5 * dt**2 * Rm
    F[:, _P, _V] = dt * np.eye(3)
    F[:, 5, 24], F[:, 8, 24] = -dt, -0.5 * dt**2
    u = np.zeros((n, _SIZE))
    left = (m - 0.5 - np.arange(m))[:, None] * h  # time left in the block: the second integral
    u[:, _V], u[:, _P] = dt * mean(a), h * (a.reshape(n, m, 3) * left).sum(axis=1)
    return F, u


def _mismatch(turn: Floats, rate: float, nom: _Nominal, m: int) -> Floats:
    """Return by how much the corrected gyro turns further than the nominal orientation, (n, 3)."""
    path = rot.chain(turn - nom.bias[1:] / rate - turn @ nom.K.T)
    turned = rot.multiply(nom.q, rot.conjugate(path))  # constant where the two agree
    ends = turned[::m]
    return rot.log(rot.multiply(ends[:-1], rot.conjugate(ends[1:])))


def _correct(nom: _Nominal, x: Floats, m: int) -> _Nominal:
    """Return the nominal solution with the smoothed deviations added."""
    at, k = np.arange(len(x)) * m, np.arange(len(nom.q))
    e = CubicSpline(at, x[:, _E])(k)
    last = x[-1]
    return _Nominal(
        rot.multiply(rot.exp(e), nom.q),
        nom.bias + CubicSpline(at, x[:, _B])(k),
        nom.K + last[_K].reshape(3, 3),
        nom.accel_bias + last[_A],
        nom.g + last[24],
    )
