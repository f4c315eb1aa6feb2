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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.loop.roots import Roots
from pinotwin.loop.servo import DISTANCE, SHAPES, Servo
from pinotwin.simulation import axis_kernel, coupled
from pinotwin.simulation.axis_kernel import Axis, Course
from pinotwin.simulation.state import Lookup
from pinotwin.solve.sandwich import batch_means

FINE = 5e-4
"""Clock of the law's columns and of the simulated axis [s], or the log's where that is finer."""
SKIP = 0.25
"""Beginning of a window that is not compared: its state was measured, with noise [s]."""
WINDOW, MOST = 6.0, 24.0
"""Longest window and most of a log that is simulated at every evaluation [s]."""
TRAINED = 2.0 / 3.0
NOTCHES = (60.0, 75.0, 95.0, 120.0, 150.0, 190.0)
"""Frequencies at which a notch is looked for [Hz]."""
BEYOND = 1.5
"""Factor by which a notch may end outside of these: further off it stands for a lag, or for nothing."""
NOTCHED = 3
"""Most places of a notch that are searched: those whose start predicts best."""
NOTCH = (0.1, 0.6)
"""Damping ratios of its zeros and poles, to start with."""
LAGS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)
"""Time constants of the velocity's filter from which the search starts [s]."""
OUTPUT_LAG, DEAD = 2e-4, 1.2e-4
"""Lag of the current loop and dead time from which the search starts [s]."""
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
FORWARD = (-0.5, 1.5, 0.5)
"""Acceleration feed-forward that drives have, least and most, as shares of the axis' inertia, and the standard
deviation of what is beyond; any within is as usual as another.

A slow ramp does not tell it: without this one came out at eight times the inertia, and a faster command threw
the simulated axis off (random drives of the tests, seed 8).
"""
ALIKE = 0.2
"""Standard deviation of the logarithm of a shape among the axes of one control, at least."""
CORRELATED = 20.0
"""Rows of residual that tell as much as one independent row."""
PLANT = ("inertia", "viscous", "dry", "fading")
Factors = tuple[float, float, float, float]
"""On inertia, viscous friction, dry friction at speed, and the part of it that fades with speed."""
AS_FOUND: Factors = (1.0, 1.0, 1.0, 1.0)
NAMED = ("kp", "kv", "rate", "ffv", "ffa")
CLOCK = 1.5e-4
"""Doubt of when a drive adds up its integral, before or after it is used: half a control period of 2 to 8 kHz [s].

kp and 1/ti are nearly equal roots: 0.5 to 1 % of kv, which is what this makes, are 3 to 5 % of them.
"""
LAW_ERROR, FORWARD_ERROR = 1.5, 4.0
"""Standard error of a feedback gain and of the acceleration's feed-forward, as a share of itself, for each share
of the tracking error that the law misses on rows not fitted: a notch or a filter that it does not have bends its
gains, and no scatter of the rows shows that (from machines of another simulator, seeds 430 to 443)."""
SAME_GAIN = 0.02
"""Two searches whose kp differ by less found the same."""
AS_GOOD = 1.1
"""Cost, over the lowest, up to which another cascade counts as fitting as well.

Far more than the noise of a log would allow: what is wrong with the plant decides between the two as well.
"""
WEIGHT = 0.02
"""Error that a set-point weight may have: on known drives kp and 1/ti were found exchanged at less."""
PLANT_ERROR = {"inertia": 0.01, "viscous": 0.02, "dry": 0.02, "fading": 0.2}
"""Standard errors of the identified plant that its gains take up: friction scatters by 1 to 2 % from run to run."""
STEPS, LONGEST = 12, 0.7
"""Most steps of a search, and the longest of them: shares of a gain, or of a shape's logarithm."""
ENOUGH = 1e-3
"""The search ends when a step brings less than this share."""
SIMPLER = 0.97
"""A law with fewer gains is kept if it costs less than this on held-out windows."""
SPREAD = 0.1
"""Share by which kp and 1/ti of a double root are put apart to begin with."""
MISSED, FAR = 0.2, 3.0
"""Error of e, as a share of its RMS on windows not fitted, and distance of a shape from usual ones [standard
deviations], beyond which another start is tried."""
BANDWIDTHS = (3.0, 6.0, 12.0, 24.0)
"""Of the position loop [Hz], to start from."""
BRIEF, REPOLISH = 4, 4
FORMS = ("proportional", "cascade", "pid")
"""Simpler laws, in the order in which they are preferred."""
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
        q: measured position that is regulated, shape (n,); likewise its velocity ``v`` (smooth) and the effort ``u``.
        load: effort that helps the motor: less everything but inertia and own friction, shape (n,).
        inertia: M_D of the axis.
        viscous: C of the axis.
        tables: the axis' own friction.
        windows: rows to simulate.
        sizes: RMS of e and u over the windows, shape (2,).
        noise: share of it below which an error of e and u says nothing, shape (2,).
        usual: shapes that are usual, see :data:`USUAL`.
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
    usual: Mapping[str, tuple[float, float]] = field(default_factory=lambda: USUAL)

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

    def response(self, servo: Servo, extra: Factors = AS_FOUND) -> Floats | None:
        """Return simulated e and u on all windows, shape (rows, 2), or None if the axis runs away.

        Args:
            servo: the controller.
            extra: factors on the plant.
        """
        if extra != AS_FOUND:
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

    def with_plant(self, factors: Factors) -> AxisProblem:
        """Return the same axis with inertia, viscous and dry friction multiplied; see :data:`Factors`."""
        t, (inertia, viscous, dry, fading) = self.tables, factors
        lasting = t.dry[..., -1:]
        tables = t._replace(dry=dry * lasting + fading * (t.dry - lasting), slip=dry * t.slip)
        inertia, viscous = self.inertia * inertia, self.viscous * viscous
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
    plain, *notched = found
    likely = sorted(notched, key=lambda x: x[0])[:NOTCHED]
    return [servo for cost, servo in (plain, *likely) if np.isfinite(cost)]


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
            lag = shapes.get("velocity_lag", self.start.velocity_lag)
            gains = list(Servo.of_cascade(**named, velocity_lag=lag).gains)
        return replace(self.start, gains=tuple(gains), notch=(notch[0], notch[1], notch[2]), **shapes)

    def doubt(self, x: Floats, usual: Mapping[str, tuple[float, float]], inertia: float) -> Floats:
        """Return how far shapes and feed-forward are from usual ones, in standard deviations of what drives have."""
        servo = self.servo(x)
        share, (least, most, beyond) = servo.gains[5] / inertia, FORWARD
        out = [(share - min(max(share, least), most)) / beyond]
        for name in self.names:
            if name in usual:
                value = getattr(servo, name) if name in SHAPES else servo.notch[int(name[5:])]
                out.append(float(np.log(value / usual[name][0])) / usual[name][1])
        return np.array(out)

    def extra(self, x: Floats) -> Factors:
        """Return the factors on the plant at a point."""
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
    extra: Factors
    x: Floats
    jacobian: Floats
    residual: Floats
    search: Search
    noise: Floats
    held_out: tuple[float, float] = (np.nan, np.nan)
    trial: Servo | None = None
    factors: Factors = AS_FOUND

    @property
    def errors(self) -> tuple[float, float]:
        """Errors of e and u on the windows that were fitted, each over its RMS."""
        e, u = np.sqrt(np.sum(self.residual.reshape(-1, 2) ** 2, axis=0)) * self.noise
        return float(e), float(u)


def misfit(p: AxisProblem, servo: Servo, extra: Factors = AS_FOUND) -> Floats | None:
    """Return the residuals of e and u over their sizes, shape (2 rows,), or None."""
    y = p.response(servo, extra)
    if y is None or not np.isfinite(y).all():
        return None
    return ((y - p.measured()) / (p.sizes * p.noise)).ravel() / np.sqrt(len(y))


def find(
    p: AxisProblem,
    friction: tuple[str, ...] = (),
    allowed: Callable[[Factors], bool] = lambda factors: True,
) -> Found | None:
    """Return the controller of an axis, or None if none keeps it on its command: :func:`look`, :func:`settle`."""
    found = look(p, friction, allowed)
    return None if found is None else settle(p, found)


def look(
    p: AxisProblem,
    friction: tuple[str, ...] = (),
    allowed: Callable[[Factors], bool] = lambda factors: True,
) -> Found | None:
    """Return the form of an axis' controller with gains from its first windows, judged on the others.

    Args:
        p: the axis.
        friction: which friction of :data:`PLANT` may be refined beside the controller.
        allowed: whether such factors leave the plant's own fit as good.

    A notch is looked for where the law without one leaves something of e, and taken where it pays on
    windows that were not fitted.
    """
    train, judge = p.split()
    begun = starts(train)
    best = next((f for f in (polish(train, s) for s in begun if s.notch[0] == 0.0) if f is not None), None)
    notched = [servo for servo in begun if servo.notch[0] > 0.0]
    if best is not None:  # from here on every signal counts against its own error
        train, judge = (replace(x, noise=np.maximum(best.errors, QUIET)) for x in (train, judge))
        best = polish(train, best.servo, steps=BRIEF) or best
    if best is None or best.errors[0] > CLOSE:
        brief = [polish(train, servo, steps=BRIEF) for servo in notched]
        good = sorted((f for f in brief if f is not None), key=lambda f: f.cost)[:2]
        long = sorted((polish(train, f.servo) or f for f in good), key=lambda f: f.cost)
        long = [f for f in long if NOTCHES[0] / BEYOND < f.servo.notch[0] < NOTCHES[-1] * BEYOND]
        best = better_of(judge, best, long, PAYS)
    if best is None or doubtful(judge, best):
        best = better_of(judge, best, afresh(train), PAYS)
    if best is None:
        return None
    factors = AS_FOUND
    refined = polish(train, best.servo, friction, BRIEF + REPOLISH) if friction else None
    if refined is not None and better_of(judge, best, [refined], PAYS) is refined and allowed(refined.extra):
        factors, best = refined.extra, replace(refined, extra=AS_FOUND)
        train, judge = (x.with_plant(factors) for x in (train, judge))
    others = [polish(train, servo) for servo in simpler(train, best.servo)]
    forms = [f for f in others if f is not None]
    simple = [
        min(same, key=lambda f: f.cost) for k in FORMS if (same := [f for f in forms if f.servo.form == k])
    ]
    best = better_of(judge, best, simple, 1.0 / SIMPLER) or best
    return replace(best, held_out=_errors(judge, best), trial=best.servo, factors=factors)


def doubtful(judge: AxisProblem, found: Found) -> bool:
    """Whether an answer is a reason to search again: it misses e, or a shape is far from any that drives have."""
    odd = found.search.doubt(found.x, judge.usual, judge.inertia)
    return _errors(judge, found)[0] > MISSED or bool(np.any(np.abs(odd) > FAR))


def afresh(p: AxisProblem) -> list[Found]:
    """Return answers from usual tunings over the band, the best first: for where least squares start badly.

    Position loops of :data:`BANDWIDTHS` around the axis' inertia, as a cascade and as a PID, with and without
    feed-forward.
    """
    found = []
    for f in BANDWIDTHS:
        w, M = 2.0 * np.pi * f, p.inertia
        for ffv, ffa in ((1.0, M), (0.0, 0.0)):
            shapes: dict[str, Any] = {
                "velocity_lag": LAGS[2],
                "output_lag": OUTPUT_LAG,
                "dead": DEAD,
                "step": p.step,
            }
            cascade = Servo.of_cascade(0.7 * w, 2.0 * M * w, 0.5 * w, ffv, ffa, **shapes)
            gains = (2.0 * M * w**2, 0.7 * M * w**3, 2.0 * M * w, 2.0 * M * w * ffv, 0.0, ffa)
            found += [replace(cascade, form="general"), Servo(gains, **shapes)]
    brief = [polish(p, servo, steps=BRIEF) for servo in found]
    good = sorted((f for f in brief if f is not None), key=lambda f: f.cost)[:3]
    return sorted((polish(p, f.servo) or f for f in good), key=lambda f: f.cost)


def settle(p: AxisProblem, found: Found, usual: Mapping[str, tuple[float, float]] = USUAL) -> Found:
    """Return the controller with its gains from all windows, its intervals, and the cascade that fits as well.

    Args:
        p: the axis.
        found: what :func:`look` returned.
        usual: shapes to hold on to where the log tells nothing: what the other axes show, say.
    """
    p = replace(p.with_plant(found.factors), fine=coupled.LONGEST, noise=found.noise, usual=usual)
    last = polish(p, found.servo, steps=REPOLISH) or found
    rival = None
    if last.servo.form == "cascade":
        rivals = [polish(p, s) for s in simpler(p, last.servo) if s.form == "cascade"]
        both = sorted((f for f in [last, *rivals] if f is not None), key=lambda f: f.cost)
        last, rival = both[0], next((f for f in both[1:] if not same_gains(f.servo, both[0].servo)), None)
    servo = with_errors(p, last, rival, found.held_out[0])
    return replace(last, servo=servo, held_out=found.held_out, trial=found.trial, factors=found.factors)


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
    shapes = {k: getattr(servo, k) for k in (*SHAPES, "notch", "step")}
    found = [Servo.of_cascade(**tied, **shapes) for tied in _tied(servo)]
    return [*found, replace(servo, form="pid", gains=(*g[:4], 0.0, g[5]))]


def _tied(servo: Servo) -> list[dict[str, float]]:
    """Return cascades of set-point weight 1 near a law, kp and 1/ti either way round.

    What the search finds depends on which of the two is begun as the larger; the data tell, if anything does.
    """
    found = []
    for named in servo.cascades():
        product = named["kp"] * named["rate"]
        kp, rate = named["kp"], named["rate"]
        if not (product > 0.0 and 0.2 < rate / np.sqrt(product) < 5.0):
            continue
        if abs(kp - rate) < SPREAD * kp:  # a double root: begin on both sides of it
            kp, rate = kp * (1.0 + SPREAD), rate / (1.0 + SPREAD)
            found.append((rate, kp, named))
        found.append((kp, rate, named))
    ffv = servo.gains[3] / servo.gains[2] if servo.gains[2] > 0.0 else 1.0
    return [{"kp": kp, "kv": n["kv"], "rate": r, "ffv": ffv, "ffa": n["ffa"]} for kp, r, n in found]


def polish(p: AxisProblem, servo: Servo, plant: Sequence[str] = (), steps: int = STEPS) -> Found | None:
    """Return the controller that predicts e and u best, by Levenberg-Marquardt from a start."""
    search, x = search_of(servo, plant, float(p.sizes[1]))
    rows = sum(s.stop - s.start - p.skip for s in p.windows)
    doubt = np.sqrt(CORRELATED / max(rows, 1))

    def at(x: Floats) -> Floats | None:
        r = misfit(p, search.servo(x), search.extra(x))
        return None if r is None else np.concatenate([r, doubt * search.doubt(x, p.usual, p.inertia)])

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


# ------------------------------------------------------------------ how certain
def shared(found: Sequence[Found]) -> list[dict[str, tuple[float, float]]]:
    """Return usual shapes for every axis: what the other axes show, beside what drives have.

    The axes of one control mostly share its clock, its filters and its kind of current loop. Where an axis'
    own log tells nothing of a lag, the others' is a better guess than a usual one; where it does, that wins.
    """
    logs, told = {}, {}
    for k, f in enumerate(found):
        V = np.diag(np.linalg.pinv(f.jacobian.T @ f.jacobian, hermitian=True))
        rows = len(f.residual) // 2
        for i, name in enumerate(f.search.names):
            if name in SHAPES:
                variance = V[i] * CORRELATED / max(rows, 1) * f.cost / 2.0
                logs[k, name] = float(np.log(getattr(f.servo, name)))
                told[k, name] = max(1.0 / max(variance, 1e-12) - 1.0 / USUAL[name][1] ** 2, 0.0)
    out = []
    for k in range(len(found)):
        usual = dict(USUAL)
        for name in SHAPES:
            others = [key for key in logs if key[1] == name and key[0] != k]
            w, x = np.array([told[key] for key in others]), np.array([logs[key] for key in others])
            if w.sum() <= 0.0:
                continue
            mean = float(w @ x / w.sum())
            width = max(1.0 / w.sum() + float(w @ (x - mean) ** 2 / w.sum()), ALIKE**2)
            weights = 1.0 / USUAL[name][1] ** 2, 1.0 / width
            middle = (weights[0] * np.log(USUAL[name][0]) + weights[1] * mean) / sum(weights)
            usual[name] = (float(np.exp(middle)), float(np.sqrt(1.0 / sum(weights))))
        out.append(usual)
    return out


def same_gains(a: Servo, b: Servo) -> bool:
    """Whether two searches ended at one point: kp alike."""
    x, y = a.cascade()["kp"], b.cascade()["kp"]
    return abs(x - y) < SAME_GAIN * max(abs(x), abs(y))


def spread(p: AxisProblem, found: Found) -> Floats:
    """Return the covariance of what was searched, shape (k, k).

    From the scores of blocks of rows longer than their memory, the belief in usual shapes, errors of the
    size that counts as none (:data:`QUIET`; a law is never exact), and what is not known of the plant itself
    (:data:`PLANT_ERROR`), whose error the gains take up.
    """
    n, count = len(found.residual), len(found.x)
    J, left = found.jacobian[:n], found.residual
    own = found.jacobian[n:]
    scores = (J * left[:, None]).reshape(-1, 2, count).sum(axis=1)
    H = found.jacobian.T @ found.jacobian
    inverse = np.linalg.pinv(H, hermitian=True)
    share = CORRELATED / max(n // 2, 1)
    total = batch_means(H, scores, count, n)[0] + inverse @ (own.T @ own) @ inverse * share + inverse * share
    measured = misfit(p, found.servo)
    for name, error in PLANT_ERROR.items():
        factors = dict(zip(PLANT, AS_FOUND, strict=True)) | {name: 1.0 + error}
        moved = misfit(p, found.servo, tuple(factors[k] for k in PLANT))  # type: ignore[arg-type]
        if name not in found.search.names and moved is not None and measured is not None:
            gain = -inverse @ (J.T @ (moved - measured))
            total = total + np.outer(gain, gain)
    return np.asarray(total)


def with_errors(p: AxisProblem, found: Found, rival: Found | None, missed: float) -> Servo:
    """Return the controller with the standard errors of its gains and shapes, and the cascade as good.

    Args:
        p: the axis.
        found: its controller.
        rival: the same form, found from the other side of the double root.
        missed: error of e on rows not fitted, as a share of its RMS.
    """
    servo, cov = found.servo, spread(p, found)
    names = list(_told(servo))

    def at(x: Floats) -> Floats:
        told = _told(found.search.servo(x))
        return np.array([told[name] for name in names])

    G = np.stack([(at(found.x + d) - at(found.x - d)) / 2e-4 for d in 1e-4 * np.eye(len(found.x))], axis=1)
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", G, cov, G), 0.0))
    told = doubted(servo, dict(zip(names, errors.tolist(), strict=True)), missed)
    other: dict[str, float] = {}
    if servo.form == "general" and len(servo.cascades()) == 2:
        other = servo.cascades()[1]
    if rival is not None and rival.cost < AS_GOOD * found.cost:
        other = rival.servo.cascade()
    if (
        servo.form == "cascade" and not other
    ):  # the other way round, with a set-point weight no log tells from 1
        other = next((f for f in servo.cascades()[1:] if abs(f["weight"] - 1.0) < WEIGHT), {})
    return replace(servo, errors=told, other=other)


def _told(servo: Servo) -> dict[str, float]:
    """Return the values that get an error: smooth in the gains, a cascade's in the middle between its roots."""
    named, out = servo.named(), {k: getattr(servo, k) for k in SHAPES}
    if servo.form == "pid" or not servo.combined():
        return {**named, **servo.combined(), **out}
    roots = Roots.of(servo.gains, servo.velocity_lag)
    middle = servo.with_rate(roots.rate) or named
    if servo.form == "cascade":  # its weight was imposed
        middle = {k: x for k, x in middle.items() if k != "weight"}
    both = {"kp + rate": roots.kp + roots.rate, "kp * rate": roots.product, DISTANCE: roots.apart}
    return {**middle, **both, **out}


def doubted(servo: Servo, errors: Mapping[str, float], missed: float) -> dict[str, float]:
    """Return standard errors with those of the form of the law: its clock, and what it misses of e.

    Args:
        servo: the controller.
        errors: that its rows' scatter makes.
        missed: error of e on rows not fitted, as a share of its RMS.
    """
    found, moved = _told(servo), {}
    if servo.form != "pid":
        moved = _told(replace(servo, velocity_lag=servo.velocity_lag + CLOCK))
    A, B = (abs(servo.gains[i] / servo.gains[2]) if servo.gains[2] != 0.0 else 0.0 for i in (0, 1))
    size = {**{k: abs(x) for k, x in found.items()}, DISTANCE: float(np.hypot(2.0 * A**2, 4.0 * B))}
    out = dict(errors)
    for name in errors:
        if name in SHAPES:
            continue
        share = FORWARD_ERROR if name == "ffa" else LAW_ERROR
        clock = moved.get(name, found[name]) - found[name]
        law = share * min(missed, 1.0) * size[name] if np.isfinite(missed) else 0.0
        out[name] = float(np.sqrt(errors[name] ** 2 + clock**2 + law**2))
    return out
