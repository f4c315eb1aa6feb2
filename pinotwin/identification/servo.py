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
USUAL = {
    "velocity_lag": (4e-4, 1.0),
    "output_lag": (2e-4, 1.0),
    "dead": (1.2e-4, 1.0),
    "notch1": (0.1, 0.5),
    "notch2": (0.6, 0.4),
}
"""Usual shapes of drives [s, -] and the standard deviation of their logarithms.

At 200 Hz a log tells lags of a millisecond and the flanks of a notch badly apart; what it leaves open is
better usual than anything.
"""
CORRELATED = 20.0
"""Rows of residual that tell as much as one independent row."""
PLANT = ("inertia", "viscous", "dry")
NAMED = ("kp", "kv", "rate", "ffv", "ffa")
STEPS, LONGEST = 12, 0.7
"""Most steps of a search, and the longest of them: shares of a gain, or of a shape's logarithm."""
ENOUGH = 1e-3
"""The search ends when a step brings less than this share."""
SIMPLER = 0.97
"""A law with fewer gains is kept if it costs less than this on held-out windows."""
BRIEF, REPOLISH = 4, 4
SLOW_INTEGRAL = 1.0
"""Integral action slower than this is doubted: the law without it is tried [1/s]."""
QUIET = 5e-4
"""Error of a signal, as a share of its RMS, that is no worse than none."""
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
        noise: share of it below which an error of e and u says nothing, shape (2,).
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
    noise: Floats = field(default_factory=lambda: np.ones(2))

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
        if extra != (1.0, 1.0, 1.0):
            return self.with_plant(extra).response(servo)
        tables = self.tables
        laws = coupled.servo_arrays([servo], [False], self.step / self.substeps)
        axis = Axis(
            self.inertia,
            self.viscous,
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

    def with_plant(self, factors: tuple[float, float, float]) -> AxisProblem:
        """Return the same axis with inertia, viscous and dry friction multiplied."""
        tables = self.tables._replace(dry=self.tables.dry * factors[2], slip=self.tables.slip * factors[2])
        inertia, viscous = self.inertia * factors[0], self.viscous * factors[1]
        return replace(self, inertia=inertia, viscous=viscous, tables=tables)

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
    kept: dict[str, list[int]] = {"proportional": [0, 2, 3, 5], "pid": [0, 1, 2, 3, 5], "cascade": []}
    return kept.get(form.form, [0, 1, 2, 3, 4, 5])


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
    """Return laws by least squares that keep the simulated axis on its command.

    One without a notch and one for each place of it; the velocity's filter from a few trials.
    """
    columns = _columns(p)
    found = []
    for notch in ((0.0, 0.0, 1.0), *((f, *NOTCH) for f in NOTCHES if f < 0.4 / FINE)):
        forms = [Servo((0.0,) * 6, lag, OUTPUT_LAG, notch, DEAD, step=p.step) for lag in LAGS]
        servo = min((_solved(p, form, columns) for form in forms), key=lambda x: x[0])[1]
        r = misfit(p, servo)
        found.append((np.inf if r is None else float(r @ r), servo))
    return [servo for cost, servo in found if np.isfinite(cost)]


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
        named: dict[str, float] = {}
        for name, value, scale in zip(self.names, x, self.scale, strict=True):
            if name.startswith("gain"):
                gains[int(name[4:])] = float(value * scale)
            elif name in NAMED:
                named[name] = float(value * scale)
            elif name.startswith("notch"):
                notch[int(name[5:])] *= float(np.exp(value))
            elif name in SHAPES:
                shapes[name] = float(scale * np.exp(value))
            elif name == "offset":
                shapes[name] = float(scale * value)
        if named:
            gains = list(Servo.of_cascade(**named).gains)
        return replace(self.start, gains=tuple(gains), notch=(notch[0], notch[1], notch[2]), **shapes)

    def doubt(self, x: Floats) -> Floats:
        """Return how far the shapes are from usual ones, in standard deviations of what drives have."""
        servo, out = self.servo(x), []
        for name in self.names:
            if name in USUAL:
                value = getattr(servo, name) if name in SHAPES else servo.notch[int(name[5:])]
                out.append(float(np.log(value / USUAL[name][0])) / USUAL[name][1])
        return np.array(out)

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
    if servo.form == "cascade":
        named = servo.cascade()
        names += NAMED
        scale += [abs(named[k]) or 1.0 for k in NAMED]
        x += [named[k] / (abs(named[k]) or 1.0) for k in NAMED]
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
    noise: Floats
    held_out: tuple[float, float] = (np.nan, np.nan)
    trial: Servo | None = None
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def errors(self) -> tuple[float, float]:
        """Errors of e and u on the windows that were fitted, each over its RMS."""
        e, u = np.sqrt(np.sum(self.residual.reshape(-1, 2) ** 2, axis=0)) * self.noise
        return float(e), float(u)


def misfit(
    p: AxisProblem, servo: Servo, extra: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Floats | None:
    """Return the residuals of e and u over their sizes, shape (2 rows,), or None."""
    y = p.response(servo, extra)
    if y is None or not np.isfinite(y).all():
        return None
    return ((y - p.measured()) / (p.sizes * p.noise)).ravel() / np.sqrt(len(y))


def find(
    p: AxisProblem,
    friction: tuple[str, ...] = (),
    allowed: Callable[[tuple[float, float, float]], bool] = lambda factors: True,
) -> Found | None:
    """Return the controller of an axis, or None if none keeps it on its command.

    Args:
        p: the axis.
        friction: which of viscous and dry friction may be refined beside the controller.
        allowed: whether factors on inertia, viscous and dry friction leave the plant's own fit as good.

    A notch is looked for where the law without one leaves something of e, and taken where it pays on
    windows that were not fitted.
    """
    train, judge = p.split()
    begun = starts(train)
    best = next((f for f in (polish(train, s) for s in begun if s.notch[0] == 0.0) if f is not None), None)
    notched = [servo for servo in begun if servo.notch[0] > 0.0]
    if best is not None:  # from here on every signal counts against its own error
        p, train, judge = (replace(x, noise=np.maximum(best.errors, QUIET)) for x in (p, train, judge))
        best = polish(train, best.servo, steps=BRIEF) or best
    if best is None or best.errors[0] > CLOSE:
        brief = [polish(train, servo, steps=BRIEF) for servo in notched]
        good = sorted((f for f in brief if f is not None), key=lambda f: f.cost)[:2]
        long = sorted((polish(train, f.servo) or f for f in good), key=lambda f: f.cost)
        best = better_of(judge, best, long, PAYS)
    if best is None:
        return None
    factors = (1.0, 1.0, 1.0)
    refined = polish(train, best.servo, friction, BRIEF + REPOLISH) if friction else None
    if refined is not None and better_of(judge, best, [refined], PAYS) is refined and allowed(refined.extra):
        factors, best = refined.extra, replace(refined, extra=factors)
        p, train, judge = (x.with_plant(factors) for x in (p, train, judge))
    others = (polish(train, servo) for servo in simpler(train, best.servo))
    best = better_of(judge, best, [f for f in others if f is not None], 1.0 / SIMPLER) or best
    last = polish(replace(p, fine=coupled.LONGEST), best.servo, steps=REPOLISH) or best
    return replace(last, held_out=_errors(judge, best), trial=best.servo, factors=factors)


def better_of(judge: AxisProblem, best: Found | None, others: Sequence[Found], pays: float) -> Found | None:
    """Return the first of the others whose held-out error is below this share of the best one's, or that."""
    for other in others:
        if best is None or error_of(judge, other) < pays * error_of(judge, best):
            return other
    return best


def error_of(p: AxisProblem, found: Found) -> float:
    """Return the error of a controller on a problem's windows: geometric mean of e's and u's."""
    e, u = _errors(p, found)
    return float(np.sqrt(max(e, QUIET) * max(u, QUIET)))


def _errors(p: AxisProblem, found: Found) -> tuple[float, float]:
    """Return the errors of e and u on a problem's windows, each over its RMS."""
    r = misfit(p, found.servo, found.extra)
    if r is None:
        return np.inf, np.inf
    e, u = np.sqrt(np.sum(r.reshape(-1, 2) ** 2, axis=0)) * p.noise
    return float(e), float(u)


def simpler(p: AxisProblem, servo: Servo) -> list[Servo]:
    """Return laws with fewer gains near one with six: the simplest that holds is kept."""
    g = servo.gains
    if g[1] < SLOW_INTEGRAL * abs(g[0]):
        return [proportional(p, servo)]
    found = [replace(servo, form="pid", gains=(*g[:4], 0.0, g[5]))]
    kv, product = g[2], g[1] / g[2]
    if kv > 0.0:
        ffv, middle = g[3] / kv, float(np.sqrt(product))
        rate = g[4] / (kv * (ffv - 1.0)) if ffv != 1.0 else middle
        rate = rate if 0.2 * middle < rate < 5.0 * middle else middle
        shapes = {k: getattr(servo, k) for k in (*SHAPES, "notch", "step")}
        found.insert(0, Servo.of_cascade(product / rate, kv, rate, ffv, g[5], **shapes))
    return found


def polish(p: AxisProblem, servo: Servo, plant: Sequence[str] = (), steps: int = STEPS) -> Found | None:
    """Return the controller that predicts e and u best, by Levenberg-Marquardt from a start."""
    search, x = search_of(servo, plant, float(p.sizes[1]))
    rows = sum(s.stop - s.start - p.skip for s in p.windows)
    doubt = np.sqrt(CORRELATED / max(rows, 1))

    def at(x: Floats) -> Floats | None:
        r = misfit(p, search.servo(x), search.extra(x))
        return None if r is None else np.concatenate([r, doubt * search.doubt(x)])

    r = at(x)
    if r is None:
        return None
    damping, cost = 1e-3, float(r @ r)
    J = _slopes(at, x, r)
    for _ in range(steps):
        A, g, trial, move = J.T @ J, J.T @ r, None, x
        for _ in range(9):
            full = np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-12), -g)
            move = np.asarray(full * min(1.0, LONGEST / max(float(np.abs(full).max()), 1e-300)), dtype=float)
            trial = at(x + move)
            if trial is not None and float(trial @ trial) < cost:
                break
            trial, damping = None, damping * 6.0
        if trial is None:
            break
        gain = 1.0 - float(trial @ trial) / cost
        x, r, cost = x + move, trial, float(trial @ trial)
        damping = max(damping / 30.0, 1e-9)
        if gain < ENOUGH:
            break
        J = _slopes(at, x, r)
    left = r[: 2 * rows]
    return Found(search.servo(x), cost, search.extra(x), x, J, left, search, p.noise)


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
