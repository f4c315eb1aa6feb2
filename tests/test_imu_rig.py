"""A small analytic flexure rig (Y, passive delta, A, C) for the IMU tests, and tests of it.

Planar equations of the rig at small delta (thesis Eq. 5.4-5.5 in relative coordinates), numbers as
in DESIGN section 4. The truth (``Truth``) is kept apart from what an estimator may see
(``Servo``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation

from pinotwin.virtual.imu_sensor import LinkMotion

DEG = np.pi / 180
FINE = 4000.0
M_A, R_A, J_A, M_L, L_L, L = 10.3, 0.086, 0.12, 30.4, 0.29, 0.29
I_D, K_D, C_D, G = 3.754, 59280.0, 47.0, 9.81


@dataclass(frozen=True)
class Truth:
    delta: np.ndarray
    delta_v: np.ndarray
    delta_a: np.ndarray
    motion: LinkMotion


@dataclass(frozen=True)
class Servo:
    """What the encoders and the rigid model say, on the servo clock (400 Hz)."""

    t: np.ndarray
    R: np.ndarray
    w: np.ndarray
    a: np.ndarray
    axis: np.ndarray
    arm: np.ndarray
    load: np.ndarray


def s_curve(rng, t, speed, accel, jerk, reach, rest=1.0):
    """Random moves within +-reach and the limits: a ramp through three boxcars. Returns q, v, a."""
    h = t[1] - t[0]
    boxes = [max(1, round(x / h)) for x in (speed / accel, accel / jerk, 6e-3, 6e-3)]
    velocity, now, k = np.zeros(len(t)), 0.0, round(rest / h)
    while k < len(t) - round((rest + 1.0) / h):
        goal = rng.uniform(-reach, reach)
        n = max(1, round(abs(goal - now) / speed / h))
        velocity[k : k + n] = (goal - now) / (n * h)
        now = goal
        k += n + sum(boxes) + round(rng.uniform(0.0, 0.3) / h)
    velocity[-round((rest + 0.6) / h) :] = 0.0
    for box in boxes:
        c = np.cumsum(np.concatenate([np.zeros(box), velocity]))
        velocity = (c[box:] - c[:-box]) / box
    a = np.gradient(velocity, h)
    q = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * h])
    return q, velocity, a


@njit
def deflect(tau, inertia, h, k3, hyst, width):
    """Integrate M(q) d'' + c d' + k d + k3 d^3 + z = -tau with Dahl friction z (RK2)."""
    n = len(tau)
    out = np.zeros((n, 3))
    d = -tau[0] / 59280.0
    v, z = 0.0, 0.0
    for i in range(n):
        f0 = (-tau[i] - 47.0 * v - 59280.0 * d - k3 * d**3 - z) / inertia[i]
        out[i, 0], out[i, 1], out[i, 2] = d, v, f0
        if i == n - 1:
            break
        zd0 = hyst / width * (v - abs(v) * z / hyst) if hyst > 0 else 0.0
        dm, vm, zm = d + 0.5 * h * v, v + 0.5 * h * f0, z + 0.5 * h * zd0
        tm, im = 0.5 * (tau[i] + tau[i + 1]), 0.5 * (inertia[i] + inertia[i + 1])
        fm = (-tm - 47.0 * vm - 59280.0 * dm - k3 * dm**3 - zm) / im
        zdm = hyst / width * (vm - abs(vm) * zm / hyst) if hyst > 0 else 0.0
        d, v, z = d + h * vm, v + h * fm, z + h * zdm
    return out


def record(
    seed: int,
    seconds: float = 20.0,
    *,
    c_axis: bool = True,
    hysteresis: float = 0.0,
    hardening: float = 0.0,
    seed_noise: int = 0,
) -> tuple[Truth, Servo]:
    """One run: the truth on a fine clock, and the servo's view of it at 400 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * FINE)) / FINE
    _, _, ya = s_curve(rng, t, 0.277, 1.38, 106.0, 0.15)
    qa, va, aa = s_curve(rng, t, 110 * DEG, 1230 * DEG, 7.67e4 * DEG, 35 * DEG)
    qc, vc, ac = s_curve(rng, t, 67.6 * DEG, 270 * DEG, 2.7e3 * DEG, 60 * DEG)
    if not c_axis:
        qc, vc, ac = 0 * qc, 0 * vc, 0 * ac
    tau = rig_torque(qa, va, aa, ya)
    inertia = I_D - 2 * M_A * L * R_A * (np.cos(qa) - 1)
    peak = np.abs(tau / K_D).max()
    k3 = hardening * K_D / peak**2
    d, dv, da = deflect(tau, inertia, 1 / FINE, k3, hysteresis * np.abs(tau).max(), 0.2 * peak).T
    R = turn(d + qa, qc)
    truth = Truth(d, dv, da, LinkMotion(t, R.as_matrix(), *spin(qa, va + dv, qc, vc, ya, d, dv, da)))
    servo = view(t, qa, va, qc, vc, ya, tau, np.random.default_rng([seed, seed_noise]))
    return truth, servo


def rig_torque(q, v, a, ya):
    """Rigid-body torque at delta (inverse dynamics with delta = 0)."""
    inertia = J_A + M_A * R_A**2 - M_A * L * R_A * np.cos(q)
    linear = M_A * (R_A * np.cos(q) - L) - M_L * L_L
    return inertia * a + M_A * L * R_A * np.sin(q) * v**2 + linear * ya + M_A * G * R_A * np.sin(q)


def turn(x, z):
    return Rotation.from_euler("XZ", np.stack([x, z], axis=1))


def spin(qa, va, qc, vc, ya, d, dv, da):
    """Rate and acceleration of the table's origin in the table frame."""
    w = np.stack([np.cos(qc) * va, -np.sin(qc) * va, vc], axis=1)
    zero = 0 * qa
    a = np.stack(
        [zero, ya - L * np.cos(d) * da + L * np.sin(d) * dv**2, -L * np.sin(d) * da - L * np.cos(d) * dv**2],
        axis=1,
    )
    R = turn(d + qa, qc).inv()
    return w, R.apply(a)


def view(t, qa, va, qc, vc, ya, tau, rng):
    """The servo's arrays: delta taken as zero, rates and loads slightly noisy."""
    rows = slice(None, None, round(FINE / 400))
    n = len(t[rows])
    zero = np.zeros(n)
    va = va[rows] + rng.normal(0, 0.002 * DEG, n)
    vc = vc[rows] + rng.normal(0, 0.002 * DEG, n)
    ya = ya[rows] + rng.normal(0, 2e-3, n)
    qa, qc = qa[rows], qc[rows]
    R = turn(qa, qc)
    w, a = spin(qa, va, qc, vc, ya, zero, zero, zero)
    axis = R.inv().apply([1.0, 0, 0])
    arm = R.inv().apply([0.0, 0, L])
    load = -tau[rows] + rng.normal(0, 0.05, n)
    return Servo(t[rows], R.as_matrix(), w, a, axis, arm, load[:, None])


def test_rig_has_the_sizes_of_the_source() -> None:
    truth, servo = record(1)
    assert abs(np.sqrt(K_D / I_D) / (2 * np.pi) - 20.0) < 0.01
    assert np.std(truth.delta) / DEG == pytest.approx(0.0109, rel=0.05)
    assert np.abs(truth.delta).max() / DEG == pytest.approx(0.0318, rel=0.05)
    assert np.abs(servo.w).max() / DEG == pytest.approx(110.0, rel=0.02)


def test_rig_rate_is_the_derivative_of_its_rotation() -> None:
    truth, _ = record(2, 5.0)
    m = truth.motion
    R = Rotation.from_matrix(m.R)
    numeric = (R[:-2].inv() * R[2:]).as_rotvec() * FINE / 2
    np.testing.assert_allclose(numeric, m.w[1:-1], atol=2e-4)
