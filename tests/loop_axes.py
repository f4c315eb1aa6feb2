"""Closed loops whose truth is written down by hand, for the tests of ``pinotwin.loop``.

Nothing here uses the package: the state matrices follow from the plant and the controller, the
responses come from scipy at ten times the sampling rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import integrate, signal

HERTZ = 2.0 * np.pi


@dataclass(frozen=True)
class Truth:
    """x' = A x + B (d..., vr, ar), y = C x + D (...); names of what goes in and out."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    disturbances: int = 1

    @cached_property
    def poles(self):
        return np.linalg.eigvals(self.A)

    def response(self, output, source, hertz):
        """Complex gain from a disturbance index or from "qr" at frequencies [Hz]."""
        s = 2j * np.pi * np.asarray(hertz)
        gains = []
        for x in s:
            G = self.C @ np.linalg.solve(x * np.eye(len(self.A)) - self.A, self.B) + self.D
            qr = G[output, -2] * x + G[output, -1] * x * x
            gains.append(qr if source == "qr" else G[output, source])
        return np.array(gains)

    def simulate(self, w, step):
        """Outputs to inputs (n, m), first-order hold, from rest."""
        system = (self.A, self.B, self.C, self.D)
        return signal.lsim(system, w, step * np.arange(len(w)))[1]


def cascade(M=25.0, C=60.0, kp=45.0, kv=2800.0, ti=0.05, ffv=0.9, ffa=22.0, ff=250.0):
    """Rigid axis, P-PI, feed-forward through two real poles at ``ff`` [Hz]: order 5.

    States: e, v, integral, filtered vr, its rate. Inputs d, vr, ar.
    """
    p = HERTZ * ff
    A, B = np.zeros((5, 5)), np.zeros((5, 3))
    e, v, i, f, g = np.eye(5)
    inner = kp * e - v + ffv * f
    u = kv * inner + kv / ti * i + ffa * g
    A[0], B[0, 1] = -v, 1.0
    A[1], B[1, 0] = (u - C * v) / M, -1.0 / M
    A[2] = inner
    A[3] = g
    A[4], B[4, 1] = -p * p * f - 2 * p * g, p * p
    return Truth(A, B, np.stack([e, u]), np.zeros((2, 3)))


def pid(M=12.0, C=30.0, kp=60e3, ki=9e5, kd=1.6e3, ffv=25.0, ffa=11.0):
    """Rigid axis, PID on the error, feed-forward without poles: order 3."""
    A, B, D = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((2, 3))
    e, v, i = np.eye(3)
    u = kp * e + ki * i - kd * v
    through = np.array([0.0, kd + ffv, ffa])
    A[0], B[0, 1] = -v, 1.0
    A[1], B[1] = (u - C * v) / M, through / M
    B[1, 0] -= 1.0 / M
    A[2] = e
    D[1] = through
    # x' with ar as input: the state v jumps with vr; written as it stands, ar enters v'.
    return Truth(A, B, np.stack([e, u]), D)


def ball_screw(hertz=29.0, zeta=0.03, M1=18.0, M2=9.0, kp=35.0, kv=1900.0, ti=0.06, ff=400.0):
    """Motor and load on a spring (thesis Eq. 5.1, encoder at the motor), P-PI: order 7."""
    reduced = M1 * M2 / (M1 + M2)
    w = HERTZ * hertz
    k, c = reduced * w * w, 2 * zeta * w * reduced
    p = HERTZ * ff
    A, B = np.zeros((7, 7)), np.zeros((7, 3))
    e, v, x, r, i, f, g = np.eye(7)  # x = load - motor, r = its rate
    inner = kp * e - v + 0.95 * f
    u = kv * inner + kv / ti * i + 25.0 * g
    force = k * x + c * r
    A[0], B[0, 1] = -v, 1.0
    A[1], B[1, 0] = (u - 40.0 * v + force) / M1, -1.0 / M1
    A[2] = r
    A[3], B[3, 0] = -force / M2 - A[1], 1.0 / M1
    A[4] = inner
    A[5] = g
    A[6], B[6, 1] = -p * p * f - 2 * p * g, p * p
    return Truth(A, B, np.stack([e, u]), np.zeros((2, 3)))


def flexure(I=3.754, k=59280.0, c=47.0, IA=0.9, b=2.0, kp=25.0, kv=110.0, ti=0.08, ff=1200.0):
    """Tilting axis on a flexible link (thesis Eq. 5.4): inputs dA, d-delta, vr.

    Outputs e, u, delta'. A is the table's absolute speed; the encoder reads it less the link's.
    """
    p = HERTZ * ff
    A, B = np.zeros((7, 7)), np.zeros((7, 4))
    e, a, x, r, i, f, g = np.eye(7)  # a = absolute speed of the table, x = delta, r = delta'
    v = a - r
    inner = kp * e - v + 0.9 * f
    u = kv * inner + kv / ti * i + 0.8 * g
    A[0], B[0, 2] = -v, 1.0
    A[1], B[1, 0] = (u - b * v) / IA, -1.0 / IA
    A[2] = r
    A[3], B[3, 1] = (-u - k * x - c * r + b * v) / I, -1.0 / I
    A[4] = inner
    A[5] = g
    A[6], B[6, 2] = -p * p * f - 2 * p * g, p * p
    return Truth(A, B, np.stack([e, u, r]), np.zeros((3, 4)), disturbances=2)


def command(seconds, step, rng, speed=0.4, acceleration=4.0):
    """Jerk-limited random moves with short rests: qr, vr, ar at ``step``."""
    n = round(seconds / step)
    ar = np.zeros(n)
    at = round(0.1 / step)
    while at < n:
        top, a = (
            speed * rng.uniform(0.3, 1.0) * rng.choice([-1, 1]),
            acceleration * rng.uniform(0.4, 1),
        )
        rise = max(round(abs(top) / a / step), 2)
        cruise = round(rng.uniform(0.02, 0.3) / step)
        for start, sign in ((at, 1.0), (at + rise + cruise, -1.0)):
            ar[start : start + rise] += sign * top / (rise * step)
        at += 2 * rise + cruise + round(rng.uniform(0.02, 0.2) / step)
    window = max(round(0.012 / step), 1)
    ar = np.convolve(ar, np.ones(window) / window)[:n]
    ar = np.convolve(ar, np.ones(window) / window)[:n]
    vr = integrate.cumulative_trapezoid(ar, dx=step, initial=0.0)
    return integrate.cumulative_trapezoid(vr, dx=step, initial=0.0), vr, ar


def disturbance(vr, qr, rng, step, size=12.0):
    """Friction, ripple and a slow coupling torque, starting from zero."""
    friction = np.tanh(vr / 0.004)
    ripple = 0.4 * np.sin(2 * np.pi * qr / 0.024)
    b, a = signal.butter(2, 12.0 * 2 * step)
    coupling = signal.lfilter(b, a, rng.standard_normal(len(vr))) * np.sqrt(0.02 / step)
    return size * (friction + ripple + coupling)


def record(truth, seed=0, seconds=8.0, step=1e-3, fine=10, straight=False):
    """Arrays of a noise-free log: qr, vr, ar, d (n, nd), y (n, ny) at ``step``.

    ``straight`` lets d and vr run straight between the samples of the log, as the model assumes.
    """
    rng = np.random.default_rng(seed)
    h = step / fine
    qr, vr, ar = command(seconds, h, rng)
    d = np.column_stack([disturbance(vr, qr + 0.005 * j, rng, h) for j in range(truth.disturbances)])
    w = np.column_stack([d, vr, ar])
    thin = slice(None, None, fine)
    if straight:
        t = np.arange(len(w))
        w = np.column_stack([np.interp(t, t[thin], x[thin]) for x in w.T])
    y = truth.simulate(w, h)
    return qr[thin], vr[thin], ar[thin], d[thin], y[thin]


def advance(modal, x, now, then):
    """Return the states one interval later, (k, 2), from inputs now and then, (m,)."""
    moved = np.einsum("kij,kj->ki", modal.A, x)
    return moved + modal.B0 * now[modal.input, None] + modal.B1 * then[modal.input, None]


def answers(modal, x, w):
    """Return the outputs at states x without the command's acceleration, (ny,)."""
    return np.einsum("yki,ki->y", modal.C, x) + modal.D @ w
