"""The law of a controller by itself: the effort that it makes of a measured motion, and its slopes; no plant.

On a fine clock the measured motion is the simulated one moved by a spline: at 250 Hz a reversal lies between samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.identification.servo.output_error import Search
from pinotwin.identification.servo.problem import AxisProblem
from pinotwin.loop.servo import Servo
from pinotwin.signals.noise import burg
from pinotwin.simulation.law import LONGEST, biquad, substeps


class Clock(NamedTuple):
    """A fine clock: the log's step [s], how many steps it makes of one, and whether its low-pass holds its input."""

    step: float
    substeps: int
    held: bool = False

    @property
    def h(self) -> float:
        """Its own step [s]."""
        return self.step / self.substeps

    def refined(self, x: Floats, *orders: int) -> list[Floats]:
        """Return samples (n,) by a cubic spline on the fine clock, and its derivatives of some orders, (m,) each."""
        t = self.step * np.arange(len(x))
        fine = np.linspace(0.0, t[-1], (len(t) - 1) * self.substeps + 1)
        spline = scipy.interpolate.CubicSpline(t, x)
        return [np.asarray(spline(fine, k)) for k in (0, *orders)]

    def columns(self, qr: Floats, vr: Floats, ar: Floats, q: Floats) -> Floats:
        """Return e, its integral, -v, vr, its integral and ar, shape (6, m); integrals are as late as simulated."""
        e, late, h = qr - q, 0.5 * LONGEST, self.h
        wound = h * (np.cumsum(e) - 0.5 * (e + e[0]))
        return np.stack([e, wound - late * e, -np.gradient(q, h), vr, qr - late * vr, ar])

    def seen(self, X: Floats, servo: Servo) -> Floats:
        """Return the columns, shape (6, m), with the velocity as late as the law sees it."""
        return np.stack([*X[:2], self.low(X[2], servo.velocity_lag), *X[3:]])

    def out(self, X: Floats, servo: Servo) -> Floats:
        """Return signals (..., m) through notch and current loop, at the log's samples, shape (..., n)."""
        if servo.notch[0] > 0.0:
            b = biquad(servo.notch, self.h)
            X = scipy.signal.lfilter(b[:3], [1.0, b[3], b[4]], X - X[..., :1]) + X[..., :1]
        return self.low(X, servo.output_lag)[..., :: self.substeps]

    def low(self, x: Floats, lag: float) -> Floats:
        """Return x (..., m) through a first-order low-pass, by the bilinear map ``lag`` [s] late at low frequencies."""
        if lag <= (0.02 * self.h if self.held else 0.0):
            return x
        if self.held:
            pole = np.exp(-self.h / lag)
            b, a = [1.0 - pole], -pole
        else:
            b = [self.h / (2.0 * lag + self.h)] * 2
            a = (self.h - 2.0 * lag) / (2.0 * lag + self.h)
        return np.asarray(scipy.signal.lfilter(b, [1.0, a], x - x[..., :1]) + x[..., :1])


@dataclass(frozen=True)
class Stretch:
    """One window on a fine clock."""

    measured: Floats  # e, its integral, -v, vr, the integral of vr and ar, shape (6, m)
    simulated: Floats
    u: Floats  # effort at the log's samples, shape (n,)


@dataclass(frozen=True)
class LawAlone:
    """All windows of an axis."""

    stretches: tuple[Stretch, ...]  # its windows
    clock: Clock  # on which they are
    skip: int  # rows left out at the beginning of a window
    whitener: Floats  # 1, -a_1, ... of the effort's error

    @classmethod
    def of(cls, p: AxisProblem, servo: Servo, clock: float = 5e-4, memory: float = 0.06) -> LawAlone | None:
        """Return the windows of an axis, simulated under a controller; None where it runs away.

        Laws of drives are smooth over ``clock`` [s]; an autoregression of ``memory`` [s] whitens the effort's error.
        """
        fine = Clock(p.step, substeps(p.step, clock))
        stretches = []
        for s in p.windows:
            qr, vr, ar = fine.refined(p.qr[s], 1, 2)
            error = p.fine_error(servo, s, (qr, vr), fine.substeps)
            if error is None:
                return None
            simulated = qr - error
            (apart,) = fine.refined(p.q[s] - simulated[:: fine.substeps])
            measured, predicted = (fine.columns(qr, vr, ar, q) for q in (simulated + apart, simulated))
            stretches.append(Stretch(measured, predicted, p.u[s]))
        plain = cls(tuple(stretches), fine, p.skip, np.ones(1))
        rows = min(len(s.u) for s in stretches) - p.skip
        order = min(int(memory / p.step), rows // 10)
        if order <= 0:
            return plain
        left = [r - r.mean() for r in plain.residual(servo)]
        return replace(plain, whitener=np.concatenate([[1.0], -burg(left, order)[0]]))

    def residual(self, servo: Servo) -> list[Floats]:
        """Return what the law leaves of the measured effort of every window."""
        gains, clock = np.array(servo.gains), self.clock
        made = (clock.out(gains @ clock.seen(s.measured, servo), servo) for s in self.stretches)
        return [(s.u - u)[self.skip :] for s, u in zip(self.stretches, made, strict=True)]

    def left(self, servo: Servo) -> Floats:
        """Return the whitened error of all windows, shape (n,)."""
        return np.concatenate([self._clean(r) for r in self.residual(servo)])

    def instruments(self, search: Search, x: Floats) -> Floats:
        """Return the slopes of the law's effort on the simulated motion, whitened, shape (n, k)."""
        parts = [self._slopes(s.simulated, search, x)[:, self.skip :] for s in self.stretches]
        return np.concatenate([self._clean(part).T for part in parts])

    def _clean(self, rows: Floats) -> Floats:
        """Return whitened rows (..., n) less their mean: what the integral began with is not known."""
        order = len(self.whitener) - 1
        white = scipy.signal.lfilter(self.whitener, [1.0], rows)[..., order:]
        return np.asarray(white - white.mean(axis=-1, keepdims=True))

    def _slopes(self, X: Floats, search: Search, x: Floats, size: float = 1e-4) -> Floats:
        """Return the slopes of the law's effort over what is searched, shape (k, n), by differences of a size."""
        servo = search.servo(x)
        clock, gains = self.clock, np.array(servo.gains)
        seen = clock.seen(X, servo)
        columns, effort = clock.out(seen, servo), gains @ seen
        out = np.zeros((len(x), columns.shape[1]))
        for i, name in enumerate(search.names):
            step = size * np.eye(len(x))[i]
            ahead, behind = search.servo(x + step), search.servo(x - step)
            out[i] = (np.array(ahead.gains) - np.array(behind.gains)) @ columns
            if name == "velocity_lag":
                late = clock.low(X[2], ahead.velocity_lag) - clock.low(X[2], behind.velocity_lag)
                out[i] += clock.out(gains[2] * late, servo)
            elif name == "output_lag" or name.startswith("notch"):
                out[i] += clock.out(effort, ahead) - clock.out(effort, behind)
        return out / (2.0 * size)
