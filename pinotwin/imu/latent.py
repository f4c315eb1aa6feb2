"""What the mode does not explain: hysteresis, hardening, forces from outside.

The remainder e of the deflection is the response of the mode to an unknown force f, a Gauss-Markov process whose size
follows by maximum likelihood; the spring keeps e from being an integral of the gyro's errors:

    e'' + 2 zeta wn e' + wn² e = f,   f' = -f / tau + noise        z_g = e' + b,   z_a = c e''
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.imu import rotation as rot
from pinotwin.imu.kalman import LinearModel
from pinotwin.imu.predict import Layout, RunModel
from pinotwin.imu.runs import interpolate
from pinotwin.imu.whiten import Whitener


@dataclass(frozen=True)
class Remainder:
    """The remainder at the sensor's times."""

    t: Floats  # reference time [s], (m,)
    x: Floats  # e, e', e'' [rad, rad/s, rad/s²], (m, 3)
    sd: Floats  # their standard deviations, (m, 3)
    force: float  # standard deviation of the unknown force [rad/s²]
    seen_t: Floats  # reference times of the samples themselves [s], (k,)
    seen_rate: Floats  # what the fitted model leaves of the gyro, in the link frame [rad/s], (k, 3)


def remainder(m: RunModel, theta: Floats, lay: Layout, R_ST: Floats, whitener: Whitener) -> Remainder:
    """Return the smoothed remainder of one run for fitted parameters."""
    seen_t, seen_rate, *seen = _observations(m, theta, lay, R_ST, whitener)
    t, z, C, r = _filled(m.interval, seen_t, *seen)
    wn, zeta = np.exp(theta[lay["mode"]])
    sizes = wn**2 * np.geomspace(1e-8, 3e-4, 11)
    scores = [_model(len(t), m.interval, wn, zeta, s, C).log_likelihood(z, r) for s in sizes]
    best = float(sizes[int(np.argmax(np.nan_to_num(scores, nan=-np.inf)))])
    x, P = _model(len(t), m.interval, wn, zeta, best, C).smooth(z, r)
    out = np.zeros((3, 4))
    out[0, 0], out[1, 1], out[2, :3] = 1.0, 1.0, [-(wn**2), -2.0 * zeta * wn, 1.0]
    var = np.einsum("ai,nij,aj->na", out, P, out)
    return Remainder(t, x @ out.T, np.sqrt(np.maximum(var, 0.0)), best, seen_t, seen_rate)


def _observations(
    m: RunModel, theta: Floats, lay: Layout, R_ST: Floats, whitener: Whitener
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return times, gyro residuals in the link frame, their projections, rows and variances."""
    wn, zeta = np.exp(theta[lay["mode"]])
    e = m.read - m.predict(theta, lay, R_ST)[0]
    variance = _variance(whitener)
    R = rot.to_matrix(rot.exp(theta[lay["turn"]])) @ R_ST
    clock = theta[lay["clock"]]
    t = m.base + clock[0] + clock[1] * m.centred - m.delay
    at = (t - m.fine.t[0]) / m.fine.step
    axis, _ = interpolate(m.fine.axis, at)
    arm, _ = interpolate(m.fine.arm, at)
    lever = np.cross(axis, arm + theta[lay["position"]]) @ R.T
    axis = axis @ R.T
    z, r = np.empty((len(t), 2)), np.empty((len(t), 2))
    for k, (rows, v) in enumerate(((axis, variance[:3]), (lever, variance[3:]))):
        information = np.maximum(np.sum(rows**2 / v, axis=1), 1e-12)
        z[:, k] = np.sum(rows * e[:, 3 * k : 3 * k + 3] / v, axis=1) / information
        r[:, k] = 1.0 / information
    z = z - np.median(z, axis=0)
    C = np.zeros((1, 2, 4))
    C[0, 0, 1] = C[0, 0, 3] = 1.0
    C[0, 1, :3] = [-(wn**2), -2.0 * zeta * wn, 1.0]
    return t, e[:, :3] @ R, z, C, r


def _variance(whitener: Whitener) -> Floats:
    """Return the variance of each channel's noise: innovations through the autoregression."""
    impulse = np.zeros(400)
    impulse[0] = 1.0
    gains = [np.sum(lfilter([1.0], taps, impulse) ** 2) for taps in whitener.taps]
    return whitener.sigma**2 * np.array(gains)


def _filled(
    interval: float, t: Floats, z: Floats, C: Floats, r: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the same on an unbroken clock: the variance of missing samples is infinite, the smoother bridges them."""
    at = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(t) / interval)))]).astype(int)
    n = at[-1] + 1
    times = np.interp(np.arange(n), at, t)
    full, variance = np.zeros((n, z.shape[1])), np.full((n, z.shape[1]), np.inf)
    full[at], variance[at] = z, r
    return times, full, C, variance


def _model(n: int, interval: float, wn: float, zeta: float, size: float, C: Floats) -> LinearModel:
    """Return the state-space model of (e, e', f, b) over n samples."""
    A = np.zeros((4, 4))
    A[0, 1], A[1, :3], A[2, 2] = 1.0, [-(wn**2), -2.0 * zeta * wn, 1.0], -wn
    noise = np.diag([0.0, 0.0, 2.0 * wn * size**2, (1e-5) ** 2])
    van_loan = expm(np.block([[-A, noise], [np.zeros((4, 4)), A.T]]) * interval)
    Phi = van_loan[4:, 4:].T
    P0 = np.diag([(size / wn**2) ** 2, (size / wn) ** 2, size**2, (2e-4) ** 2])
    Q = Phi @ van_loan[:4, 4:]
    return LinearModel(Phi[None], np.zeros((n - 1, 4)), Q[None], C, np.zeros(4), P0)
