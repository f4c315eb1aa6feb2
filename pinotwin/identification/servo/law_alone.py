"""The law of a controller by itself: the effort that it makes of a measured motion, and its slopes; no plant.

Two motions go through it on a fine clock: the simulated one, and the measured one, which between two samples is the
simulated one moved by a spline onto the measured ones: at 250 Hz a reversal lies between samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.identification.servo.output_error import Search
from pinotwin.identification.servo.problem import AxisProblem
from pinotwin.loop.servo import Servo
from pinotwin.signals.noise import burg
from pinotwin.simulation.law import LONGEST, biquad


@dataclass(frozen=True)
class Stretch:
    """One window on a fine clock.

    Attributes:
        measured: e, its integral, -v, vr, the integral of vr and ar, shape (6, m); likewise ``simulated``.
        u: effort at the log's samples, shape (n,).
    """

    measured: Floats
    simulated: Floats
    u: Floats


@dataclass(frozen=True)
class LawAlone:
    """All windows of an axis.

    Attributes:
        stretches: its windows.
        h: internal step [s]. substeps: internal steps a sample.
        skip: rows left out at the beginning of a window.
        whitener: 1, -a_1, ... of the effort's error.
    """

    stretches: tuple[Stretch, ...]
    h: float
    substeps: int
    skip: int
    whitener: Floats

    @classmethod
    def of(cls, p: AxisProblem, servo: Servo, clock: float = 5e-4, memory: float = 0.06) -> LawAlone | None:
        """Return the windows of an axis, simulated under a controller; None where it runs away.

        Args:
            p: the axis.
            servo: the controller.
            clock: longest internal step [s]: the laws of drives are smooth over it, whose fastest parts are lags of
                a few of them.
            memory: of the autoregression that whitens the effort's error [s].
        """
        substeps = max(1, int(np.ceil(p.step / clock - 1e-9)))
        stretches = [made for s in p.windows if (made := _stretch(p, servo, s, substeps)) is not None]
        if len(stretches) < len(p.windows):
            return None
        plain = cls(tuple(stretches), p.step / substeps, substeps, p.skip, np.ones(1))
        rows = min(len(s.u) for s in stretches) - p.skip
        order = min(int(memory / p.step), rows // 10)
        if order <= 0:
            return plain
        left = [r - r.mean() for r in plain.residual(servo)]
        return replace(plain, whitener=np.concatenate([[1.0], -burg(left, order)[0]]))

    def residual(self, servo: Servo) -> list[Floats]:
        """Return what the law leaves of the measured effort of every window."""
        return [(s.u - self._effort(s.measured, servo))[self.skip :] for s in self.stretches]

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

    def _effort(self, X: Floats, servo: Servo) -> Floats:
        """Return the law's effort at the log's samples, (n,)."""
        return self._out(np.array(servo.gains) @ self._seen(X, servo), servo)

    def _seen(self, X: Floats, servo: Servo) -> Floats:
        X = X.copy()
        X[2] = _low(X[2], servo.velocity_lag, self.h)
        return X

    def _out(self, X: Floats, servo: Servo) -> Floats:
        """Return columns through notch and current loop, at the log's samples."""
        if servo.notch[0] > 0.0:
            b = biquad(servo.notch, self.h)
            X = scipy.signal.lfilter(b[:3], [1.0, b[3], b[4]], X - X[..., :1]) + X[..., :1]
        return _low(X, servo.output_lag, self.h)[..., :: self.substeps]

    def _slopes(self, X: Floats, search: Search, x: Floats, size: float = 1e-4) -> Floats:
        """Return the slopes of the law's effort over what is searched, shape (k, n), by differences of a size."""
        servo = search.servo(x)
        seen, gains = self._seen(X, servo), np.array(servo.gains)
        columns, effort = self._out(seen, servo), gains @ seen
        out = np.zeros((len(x), columns.shape[1]))
        for i, name in enumerate(search.names):
            step = size * np.eye(len(x))[i]
            ahead, behind = search.servo(x + step), search.servo(x - step)
            out[i] = (np.array(ahead.gains) - np.array(behind.gains)) @ columns
            if name == "velocity_lag":
                late = _low(X[2], ahead.velocity_lag, self.h) - _low(X[2], behind.velocity_lag, self.h)
                out[i] += self._out(gains[2] * late, servo)
            elif name == "output_lag" or name.startswith("notch"):
                out[i] += self._out(effort, ahead) - self._out(effort, behind)
        return out / (2.0 * size)


def _stretch(p: AxisProblem, servo: Servo, s: slice, substeps: int) -> Stretch | None:
    t = p.step * np.arange(s.stop - s.start)
    fine = np.linspace(0.0, t[-1], (len(t) - 1) * substeps + 1)
    command = scipy.interpolate.CubicSpline(t, p.qr[s])
    qr, vr, ar = (command(fine, k) for k in range(3))
    error = p.fine_error(servo, s, (qr, vr), substeps)
    if error is None:
        return None
    simulated = qr - error
    measured = simulated + scipy.interpolate.CubicSpline(t, p.q[s] - simulated[::substeps])(fine)
    channels = [_channels(qr, vr, ar, q, p.step / substeps) for q in (measured, simulated)]
    return Stretch(channels[0], channels[1], p.u[s])


def _channels(qr: Floats, vr: Floats, ar: Floats, q: Floats, h: float) -> Floats:
    """Return e, its integral, -v, vr, its integral and ar; integrals are as late as the simulation adds them up."""
    e, late = qr - q, 0.5 * LONGEST
    wound = h * (np.cumsum(e) - 0.5 * (e + e[0]))
    return np.stack([e, wound - late * e, -np.gradient(q, h), vr, qr - late * vr, ar])


def _low(x: Floats, lag: float, h: float) -> Floats:
    """Return x (..., n) through a first-order low-pass by the bilinear map: it is ``lag`` late at low frequencies."""
    if lag <= 0.0:
        return x
    b, a = h / (2.0 * lag + h), (h - 2.0 * lag) / (2.0 * lag + h)
    return np.asarray(scipy.signal.lfilter([b, b], [1.0, a], x - x[..., :1]) + x[..., :1])
