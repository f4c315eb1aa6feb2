"""Orientation of a sensor whose place stays bounded: a smoother over the whole record.

A body that stays in the room cannot keep accelerating (VQF low-passes with 3 s: Laidig and Seel 2023, DOI
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

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot
from pinotwin.imu.ekf import ekf
from pinotwin.imu.kalman import LinearModel

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
        nominal = _correct(nominal, _smooth(turn, force, rate, nominal, b, m), m)
    return nominal.q[:n]


def _smooth(turn: Floats, acc: Floats, rate: float, nom: _Nominal, b: Bounds, m: int) -> Floats:
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
    bias = nom.bias + CubicSpline(at, x[:, _B])(k)
    last = x[-1]
    return _Nominal(
        rot.multiply(rot.exp(e), nom.q),
        bias,
        nom.K + last[_K].reshape(3, 3),
        nom.accel_bias + last[_A],
        nom.g + last[24],
    )
