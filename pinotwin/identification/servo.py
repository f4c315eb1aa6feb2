"""The controller of one axis, found through the closed loop that it makes with the identified plant.

Effort, error and command are all logged and the law is linear in its gains, so least squares give a first
answer (the law's columns through its own filters, on a fine clock). Its error carries the encoder's noise
and the law is fed back, so that answer is biased: it only starts the search. The gains are then those with
which the *simulated* axis (controller, inertia, friction, and the disturbance that the other axes made)
shows the error and the effort of the log (output error, Ljung 1999, 7.2), by Gauss-Newton on windows that
begin in the measured state. Every structure (with and without lag of the current loop, notch, the ties of
a cascade or a PID) goes the same way; the one that predicts held-out windows best is kept, a larger one
only where it pays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.loop.servo import Servo
from pinotwin.simulation import axis_kernel, coupled
from pinotwin.simulation.axis_kernel import Axis, Course
from pinotwin.simulation.state import Lookup

FINE = 5e-4
"""Clock of the law's columns and of the simulated axis [s], or the log's where that is finer."""
SKIP = 0.25
"""Beginning of a window that is not compared: its state was measured, with noise [s]."""
WINDOW, MOST = 6.0, 24.0
"""Longest window and most of a log that is simulated at every evaluation [s]."""
TRAINED = 2.0 / 3.0
NOTCHES = (60.0, 75.0, 95.0, 120.0, 150.0, 190.0)
"""Frequencies at which a notch is looked for [Hz]."""
NOTCH = (0.1, 0.6)
"""Damping ratios of its zeros and poles, to start with."""
LAGS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)
"""Time constants of the velocity's filter from which the search starts [s]."""
OUTPUT_LAG, DEAD = 2e-4, 1.2e-4
"""Lag of the current loop and dead time from which the search starts [s]."""
SHAPES = ("velocity_lag", "output_lag", "dead")
PLANT = ("inertia", "viscous", "dry")
STEPS = 12
BRIEF, REPOLISH = 4, 4
SLOW_INTEGRAL = 1.0
"""Integral action slower than this is doubted: the law without it is tried [1/s]."""
CLOSE = 0.005
"""Error of e, as a share of its RMS, below which no notch is looked for."""
PAYS = 0.98
"""A larger structure must bring the held-out error below this share of the smaller one's."""


@dataclass(frozen=True)
class AxisProblem:
    """One axis alone: its command, what was measured, and what the plant says of it.

    Attributes:
        step: sampling interval [s].
        qr: command, shape (n,); likewise its velocity ``vr``.
        q: measured position, shape (n,); likewise its velocity ``v`` (smooth) and the effort ``u``.
        load: effort that helps the motor: less everything but inertia and own friction, shape (n,).
        inertia: M_D of the axis.
        viscous: C of the axis.
        tables: the axis' own friction.
        windows: rows to simulate.
        sizes: RMS of e and u over the windows, shape (2,).
    """

    step: float
    qr: Floats
    vr: Floats
    q: Floats
    v: Floats
    u: Floats
    load: Floats
    inertia: float
    viscous: float
    tables: Lookup
    windows: tuple[slice, ...]
    fine: float = FINE
    sizes: Floats = field(default_factory=lambda: np.ones(2))

    @property
    def substeps(self) -> int:
        """Internal steps a sample."""
        return max(1, int(np.ceil(self.step / self.fine - 1e-9)))

    @property
    def skip(self) -> int:
        """Rows at the beginning of a window that are not compared."""
        return int(SKIP / self.step)

    def within(self, windows: Sequence[slice]) -> AxisProblem:
        """Return the same axis with other windows."""
        return replace(self, windows=tuple(windows))

    def response(self, servo: Servo, extra: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Floats | None:
        """Return simulated e and u on all windows, shape (rows, 2), or None if the axis runs away.

        Args:
            servo: the controller.
            extra: factors on inertia, viscous and dry friction.
        """
        laws = coupled.servo_arrays([servo], [False], self.step / self.substeps)
        axis = Axis(
            self.inertia * extra[0],
            self.viscous * extra[1],
            laws.gains[0],
            float(laws.see[0]),
            float(laws.lag[0]),
            int(laws.notched[0]),
            laws.notch[0],
            int(laws.whole[0]),
            float(laws.part[0]),
            float(laws.limit[0]),
            float(laws.offset[0]),
        )
        tables = self.tables
        if extra[2] != 1.0:
            tables = tables._replace(dry=tables.dry * extra[2], slip=tables.slip * extra[2])
        limit, out = 0.2 * float(np.ptp(self.qr)) + 1e-9, []
        for s in self.windows:
            qr, vr, load = (np.ascontiguousarray(x[s]) for x in (self.qr, self.vr, self.load))
            course = Course(qr, vr, load, self.step, self.substeps, limit)
            memory = axis_kernel.room(axis.whole, len(tables.slips), tables.give.shape[1])
            effort = float(np.mean(self.u[s.start : s.start + 3]))
            start = np.array([self.q[s.start], self.v[s.start], effort])
            y = np.empty((s.stop - s.start, 2))
            if axis_kernel.run(axis, tables, course, memory, start, y) >= 0:
                return None
            out.append(y[self.skip :])
        return np.concatenate(out)

    def split(self) -> tuple[AxisProblem, AxisProblem]:
        """Return the part that structures are fitted to, and the part that judges them."""
        cut = max(1, round(TRAINED * len(self.windows)))
        return self.within(self.windows[:cut]), self.within(self.windows[cut:] or self.windows[-1:])

    def measured(self) -> Floats:
        """Return e and u on all windows, shape (rows, 2)."""
        parts = [slice(s.start + self.skip, s.stop) for s in self.windows]
        return np.concatenate([np.column_stack([(self.qr - self.q)[s], self.u[s]]) for s in parts])


# ------------------------------------------------------------------ first answer by least squares
def _columns(p: AxisProblem) -> list[tuple[Floats, Floats]]:
    """Return e, ∫e, -v, vr, ∫vr, ar on the fine clock, unfiltered, (n, 6), and u of every window."""
    h, out = p.step / p.substeps, []
    for s in p.windows:
        t = p.step * np.arange(s.stop - s.start)
        fine = np.linspace(0.0, t[-1], (len(t) - 1) * p.substeps + 1)
        command, position = CubicSpline(t, p.qr[s]), CubicSpline(t, p.q[s])
        qr = command(fine)
        e = qr - position(fine)
        parts = (e, h * np.cumsum(e), -position(fine, 1), command(fine, 1), qr - qr[0], command(fine, 2))
        out.append((np.stack(parts), p.u[s]))
    return out


def _solved(p: AxisProblem, form: Servo, columns: list[tuple[Floats, Floats]]) -> tuple[float, Servo]:
    """Return the gains of a form by least squares; each window's constant is projected out."""
    h = p.step / p.substeps
    rows, efforts = [], []
    for fine, u in columns:
        x = fine.copy()
        x[2] = _low(x[2], form.velocity_lag, h)
        if form.notch[0] > 0.0:
            b = coupled.biquad(form.notch, h)
            x = lfilter(b[:3], [1.0, b[3], b[4]], x - x[:, :1]) + x[:, :1]
        if form.output_lag > 0.0:
            x = _low(x, form.output_lag, h)
        picked, y = x[:, :: p.substeps][:, p.skip :], u[p.skip :]
        rows.append(picked - picked.mean(axis=1, keepdims=True))
        efforts.append(y - y.mean())
    X, y = np.concatenate(rows, axis=1).T, np.concatenate(efforts)
    kept = _kept(form)
    size = np.maximum(np.sqrt(np.mean(X[:, kept] ** 2, axis=0)), 1e-300)
    gains = np.zeros(6)
    gains[kept] = np.linalg.lstsq(X[:, kept] / size, y, rcond=1e-9)[0] / size
    left = y - X @ gains
    return float(left @ left), replace(form, gains=tuple(gains.tolist()))


def _kept(form: Servo) -> list[int]:
    """Return which of the six gains a form has."""
    return [0, 2, 3, 5] if form.form == "proportional" else [0, 1, 2, 3, 4, 5]


def _low(x: Floats, lag: float, h: float) -> Floats:
    if lag <= 0.02 * h:
        return x
    pole = np.exp(-h / lag)
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], x - x[..., :1]) + x[..., :1])


def proportional(p: AxisProblem, near: Servo) -> Servo:
    """Return the law without an integral by least squares, with the filters of another."""
    columns = _columns(p)
    servo = _solved(p, replace(near, form="proportional"), columns)[1]
    parts = [u[p.skip :] - np.array(servo.gains) @ x[:, :: p.substeps][:, p.skip :] for x, u in columns]
    return replace(servo, offset=float(np.mean(np.concatenate(parts))))


def starts(p: AxisProblem) -> list[Servo]:
    """Return laws by least squares that keep the simulated axis on its command: best first.

    One for each place of a notch, the first without one; the velocity's filter from a few trials.
    """
    columns = _columns(p)
    found = []
    for notch in ((0.0, 0.0, 1.0), *((f, *NOTCH) for f in NOTCHES if f < 0.4 / FINE)):
        forms = [Servo((0.0,) * 6, lag, OUTPUT_LAG, notch, DEAD, step=p.step) for lag in LAGS]
        servo = min((_solved(p, form, columns) for form in forms), key=lambda x: x[0])[1]
        r = misfit(p, servo)
        found.append((np.inf if r is None else float(r @ r), servo))
    plain, notched = found[0], sorted(found[1:], key=lambda x: x[0])[:2]
    return [servo for cost, servo in (plain, *notched) if np.isfinite(cost)]


# ------------------------------------------------------------------ output error
@dataclass(frozen=True)
class Search:
    """What is searched: the gains in their own sizes, the shapes by logarithm."""

    start: Servo
    names: tuple[str, ...]
    scale: Floats

    def servo(self, x: Floats) -> Servo:
        """Return the controller at a point."""
        gains, notch = list(self.start.gains), list(self.start.notch)
        shapes: dict[str, Any] = {}
        for name, value, scale in zip(self.names, x, self.scale, strict=True):
            if name.startswith("gain"):
                gains[int(name[4:])] = float(value * scale)
            elif name.startswith("notch"):
                notch[int(name[5:])] *= float(np.exp(value))
            elif name in SHAPES:
                shapes[name] = float(scale * np.exp(value))
            elif name == "offset":
                shapes[name] = float(scale * value)
        return replace(self.start, gains=tuple(gains), notch=(notch[0], notch[1], notch[2]), **shapes)

    def extra(self, x: Floats) -> tuple[float, float, float]:
        """Return the factors on inertia, viscous and dry friction at a point."""
        given = dict(zip(self.names, x, strict=True))
        return tuple(float(np.exp(given.get(k, 0.0))) for k in PLANT)  # type: ignore[return-value]


def search_of(servo: Servo, plant: Sequence[str] = (), offset_scale: float = 1.0) -> tuple[Search, Floats]:
    """Return the search and its start for the form of a controller."""
    kept = _kept(servo)
    names = [f"gain{i}" for i in kept]
    g = np.array(servo.gains)
    typical = np.maximum(np.abs(g), 1e-12)
    typical[4] = max(abs(g[4]), 0.05 * abs(g[1]) * abs(g[2]) / max(abs(g[0]), 1e-12))
    scale = [typical[i] for i in kept]
    x = [g[i] / typical[i] for i in kept]
    if servo.form == "proportional":
        names.append("offset")
        scale.append(offset_scale)
        x.append(servo.offset / offset_scale)
    for name in SHAPES:
        value = getattr(servo, name)
        if value > 0.0:
            names.append(name)
            scale.append(value)
            x.append(0.0)
    if servo.notch[0] > 0.0:
        names += ["notch0", "notch1", "notch2"]
        scale += [1.0] * 3
        x += [0.0] * 3
    for name in plant:
        names.append(name)
        scale.append(1.0)
        x.append(0.0)
    return Search(servo, tuple(names), np.array(scale)), np.array(x)


@dataclass(frozen=True)
class Found:
    """A controller with its error on the windows it was fitted to."""

    servo: Servo
    cost: float
    extra: tuple[float, float, float]
    x: Floats
    jacobian: Floats
    residual: Floats
    search: Search
    held_out: float = np.nan
    trial: Servo | None = None


def misfit(
    p: AxisProblem, servo: Servo, extra: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Floats | None:
    """Return the residuals of e and u over their sizes, shape (2 rows,), or None."""
    y = p.response(servo, extra)
    if y is None or not np.isfinite(y).all():
        return None
    return ((y - p.measured()) / p.sizes).ravel() / np.sqrt(len(y))


def find(p: AxisProblem) -> Found | None:
    """Return the controller of an axis, or None if none keeps it on its command.

    A notch is looked for where the law without one leaves something of e, and taken where it pays on
    windows that were not fitted.
    """
    train, judge = p.split()
    begun = starts(train)
    plain = next((f for f in (polish(train, s) for s in begun if s.notch[0] == 0.0) if f is not None), None)
    tried = [] if plain is None else [plain]
    if plain is None or float(np.sqrt(np.sum(plain.residual[::2] ** 2))) > CLOSE:
        brief = [polish(train, servo, steps=BRIEF) for servo in begun if servo.notch[0] > 0.0]
        good = sorted((f for f in brief if f is not None), key=lambda f: f.cost)[:1]
        tried += [polish(train, f.servo) or f for f in good]
    scored = [(error_of(judge, f), f) for f in tried]
    if not scored:
        return None
    best = scored[0]
    if scored[-1][0] < PAYS * best[0]:
        best = scored[-1]
    g = best[1].servo.gains
    if g[1] < SLOW_INTEGRAL * abs(g[0]):
        simple = polish(train, proportional(train, best[1].servo))
        error = np.inf if simple is None else error_of(judge, simple)
        if simple is not None and error * PAYS < best[0]:
            best = error, simple
    last = polish(p, best[1].servo, steps=REPOLISH) or best[1]
    return replace(last, held_out=best[0], trial=best[1].servo)


def error_of(p: AxisProblem, found: Found) -> float:
    """Return the error of a controller on a problem's windows: RMS over e and u, each over its size."""
    r = misfit(p, found.servo, found.extra)
    return np.inf if r is None else float(np.sqrt(r @ r))


def polish(p: AxisProblem, servo: Servo, plant: Sequence[str] = (), steps: int = STEPS) -> Found | None:
    """Return the controller that predicts e and u best, by Levenberg-Marquardt from a start."""
    search, x = search_of(servo, plant, float(p.sizes[1]))

    def at(x: Floats) -> Floats | None:
        return misfit(p, search.servo(x), search.extra(x))

    r = at(x)
    if r is None:
        return None
    damping, cost = 1e-3, float(r @ r)
    J = _slopes(at, x, r)
    for _ in range(steps):
        A, g, trial, move = J.T @ J, J.T @ r, None, x
        for _ in range(6):
            move = np.clip(-np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-12), g), -0.7, 0.7)
            trial = at(x + move)
            if trial is not None and float(trial @ trial) < cost:
                break
            trial, damping = None, damping * 8.0
        if trial is None:
            break
        gain = 1.0 - float(trial @ trial) / cost
        x, r, cost = x + move, trial, float(trial @ trial)
        damping = max(damping / 8.0, 1e-9)
        if gain < 2e-3:
            break
        J = _slopes(at, x, r)
    return Found(search.servo(x), cost, search.extra(x), x, J, r, search)


def _slopes(at: Callable[[Floats], Floats | None], x: Floats, r: Floats) -> Floats:
    J = np.zeros((len(r), len(x)))
    for i in range(len(x)):
        for step in (1e-3, -1e-3):
            moved = x.copy()
            moved[i] += step
            there = at(moved)
            if there is not None:
                J[:, i] = (there - r) / step
                break
    return J
