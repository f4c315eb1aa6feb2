"""The search for the law of one axis: its notch, its form, and the simplest that predicts unseen windows as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.identification.servo.certainty import same_gains, with_errors
from pinotwin.identification.servo.law_alone import Clock
from pinotwin.identification.servo.moments import beside_moments, by_moments
from pinotwin.identification.servo.output_error import Found, free_gains, misfit, polish
from pinotwin.identification.servo.problem import AS_FOUND, DRIVES, AxisProblem, Check, Usual
from pinotwin.identification.settings import USUAL, Settings
from pinotwin.loop.servo import SHAPES, Servo
from pinotwin.simulation.law import LONGEST

BANDWIDTHS = (3.0, 6.0, 12.0, 24.0)  # Of the position loop [Hz], to start from
BRIEF, REPOLISH = 4, 4  # Steps of a search that only looks, and of one that goes on
FORMS = ("proportional", "cascade", "pid")  # Simpler laws, in the order in which they are preferred
STANDSTILL = ("fading", "distance")
"""Friction that shows about standstill, where an effort along a measured position tells it worst."""


def look(
    p: AxisProblem, friction: Sequence[str], allowed: Check, settings: Settings = USUAL, fits: float = 4.0
) -> Found | None:
    """Return the form of an axis' controller with gains from its first windows, judged on the others.

    A notch is taken where it pays on windows that were not fitted, a law with fewer gains where its cost is below
    ``fits`` times the others'. A law that does not hold the axis is none. Friction is refined where the plant's fit
    stays as good.
    """
    train, judge = p.split()
    begun = starts(train)
    best = next((f for f in (polish(train, s) for s in begun if s.notch[0] == 0.0) if f is not None), None)
    notched = [servo for servo in begun if servo.notch[0] > 0.0]
    if best is not None:  # from here on every signal counts against its own error
        train, judge = (replace(x, noise=np.maximum(best.errors, p.quiet)) for x in (train, judge))
        best = polish(train, best.servo, steps=BRIEF) or best
    if best is None or best.errors[0] > 0.005:
        brief = [polish(train, servo, steps=BRIEF) for servo in notched]
        good = sorted((f for f in brief if f is not None), key=lambda f: f.cost)[:2]
        long = sorted((polish(train, f.servo) or f for f in good), key=lambda f: f.cost)
        long = [f for f in long if NOTCHES[0] / 1.5 < f.servo.notch[0] < NOTCHES[-1] * 1.5]
        best = better_of(judge, best, long, settings.law_pays)
    if best is None or doubtful(judge, best, settings):
        best = better_of(judge, best, afresh(train), settings.law_pays)
    if best is None:
        return None
    factors = AS_FOUND
    refined = _with_friction(train, judge, best, friction, allowed, settings.law_pays)
    if refined is not None:
        factors, best = refined.extra, replace(refined, extra=AS_FOUND)
        train, judge = (x.with_plant(factors) for x in (train, judge))
    others = [polish(train, servo) for servo in simpler(train, best.servo)]
    forms = [f for f in others if f is not None and f.cost < fits * best.cost]
    simple = [
        min(same, key=lambda f: f.cost) for k in FORMS if (same := [f for f in forms if f.servo.form == k])
    ]
    best = better_of(judge, best, simple, 1.0 / settings.simpler_law) or best
    if not judge.holds(best.servo):
        tamed = [f for f in (*forms, *afresh(train)) if judge.holds(f.servo)]
        best = min(tamed, key=lambda f: error_of(judge, f), default=None)
        if best is None:
            return None
    return replace(best, held_out=errors_of(judge, best), trial=best.servo, factors=factors)


def _with_friction(
    train: AxisProblem, judge: AxisProblem, best: Found, friction: Sequence[str], allowed: Check, pays: float
) -> Found | None:
    """Return the law beside friction that predicts windows not fitted better; None where no refinement does."""
    slow = tuple(name for name in friction if name in STANDSTILL)
    for names in dict.fromkeys((tuple(friction), slow)):
        refined = polish(train, best.servo, names, BRIEF + REPOLISH) if names else None
        if refined is None:
            continue
        if better_of(judge, best, [refined], pays) is refined and allowed(refined.extra):
            return refined
    return None


def doubtful(judge: AxisProblem, found: Found, settings: Settings = USUAL, far: float = 3.0) -> bool:
    """Whether to search again: an answer misses e, or a shape is ``far`` standard deviations from what drives have."""
    odd = found.search.doubt(found.x, judge.usual, judge.inertia)
    return errors_of(judge, found)[0] > settings.missed or bool(np.any(np.abs(odd) > far))


def afresh(p: AxisProblem) -> list[Found]:
    """Return answers from usual tunings over the band of :data:`BANDWIDTHS`, the best first."""
    found, lag = [], LAGS[2]
    for f in BANDWIDTHS:
        w, M = 2.0 * np.pi * f, p.inertia
        for ffv, ffa in ((1.0, M), (0.0, 0.0)):
            cascade = Servo.of_cascade(0.7 * w, 2.0 * M * w, 0.5 * w, ffv, ffa, velocity_lag=lag).gains
            pid = (2.0 * M * w**2, 0.7 * M * w**3, 2.0 * M * w, 2.0 * M * w * ffv, 0.0, ffa)
            found += [Servo(gains, lag, OUTPUT_LAG, dead=DEAD, step=p.step) for gains in (cascade, pid)]
    brief = [polish(p, servo, steps=BRIEF) for servo in found]
    good = sorted((f for f in brief if f is not None), key=lambda f: f.cost)[:3]
    return sorted((polish(p, f.servo) or f for f in good), key=lambda f: f.cost)


def settle(p: AxisProblem, found: Found, usual: Usual = DRIVES, settings: Settings = USUAL) -> Found:
    """Return the controller with gains and shapes from all windows, intervals, and the cascade that fits as well."""
    p = replace(p.with_plant(found.factors), fine=LONGEST, noise=found.noise, usual=usual)
    last = polish(p, found.servo, steps=REPOLISH) or found
    last = last if p.holds(last.servo) else found
    told = _from_moments(p, found, last, settings.moments_worse)
    if told is not None:
        return told
    rivals: list[Found] = []
    if last.servo.form == "cascade":  # the better way round of kp and 1/ti
        others = [polish(p, s) for s in simpler(p, last.servo) if s.form == "cascade"]
        last, *rest = sorted((f for f in [last, *others] if f is not None), key=lambda f: f.cost)
        rivals = [f for f in rest if not same_gains(f.servo, last.servo)][:1]
    servo = with_errors(p, last, rivals, found.held_out[0])
    return replace(last, servo=servo, held_out=found.held_out, trial=found.trial, factors=found.factors)


def _from_moments(
    p: AxisProblem, found: Found, last: Found, no_worse: float, little: float = 0.002
) -> Found | None:
    """Return the controller that its own signals speak for; None where it predicts unseen windows worse."""
    told = by_moments(p, last.servo)
    if not told:
        return None
    train, judge = p.split()
    tried = by_moments(train, told[0].servo)
    if not tried:
        return None
    before, after = errors_of(judge, found), errors_of(judge, tried[0])
    if any(b > max(no_worse * a, a + little) for a, b in zip(before, after, strict=True)):
        return None
    servo = with_errors(beside_moments(p), told[0], told[1:], None)
    return replace(told[0], servo=servo, held_out=after, trial=tried[0].servo, factors=found.factors)


def better_of(judge: AxisProblem, best: Found | None, others: Sequence[Found], pays: float) -> Found | None:
    """Return the first of the others whose held-out error is below this share of the best one's, or that."""
    for other in others:
        if best is None or error_of(judge, other) < pays * error_of(judge, best):
            return other
    return best


def error_of(p: AxisProblem, found: Found) -> float:
    """Return the error of a controller on a problem's windows: geometric mean of e's and u's."""
    e, u = errors_of(p, found)
    return float(np.sqrt(max(e, p.quiet) * max(u, p.quiet)))


def errors_of(p: AxisProblem, found: Found) -> tuple[float, float]:
    """Return the errors of e and u on a problem's windows, each over its RMS."""
    r = misfit(p, found.servo, found.extra)
    if r is None:
        return np.inf, np.inf
    e, u = np.sqrt(np.sum(r.reshape(-1, 2) ** 2, axis=0)) * p.noise
    return float(e), float(u)


def simpler(p: AxisProblem, servo: Servo, slow: float = 1.0, spread: float = 0.1) -> list[Servo]:
    """Return laws with fewer gains near one with six; that without an integral for one slower than ``slow`` [1/s].

    Of cascades of set-point weight 1, kp and 1/ti are taken either way round, at least the share ``spread`` apart.
    """
    g = servo.gains
    if g[1] < slow * abs(g[0]):
        return [proportional(p, servo)]
    shapes = {k: getattr(servo, k) for k in (*SHAPES, "notch", "step")}
    ffv, found = g[3] / g[2] if g[2] > 0.0 else 1.0, []
    for named in servo.cascades():
        kp, rate = named["kp"], named["rate"]
        product = kp * rate
        if not (product > 0.0 and 0.2 < rate / np.sqrt(product) < 5.0):
            continue
        ways = [(kp, rate)]
        if abs(kp - rate) < spread * kp:  # a double root: begin on both sides of it
            kp, rate = kp * (1.0 + spread), rate / (1.0 + spread)
            ways = [(rate, kp), (kp, rate)]
        found += [Servo.of_cascade(a, named["kv"], b, ffv, named["ffa"], **shapes) for a, b in ways]
    return [*found, replace(servo, form="pid", gains=(*g[:4], 0.0, g[5]))]


NOTCHES = (60.0, 75.0, 95.0, 120.0, 150.0, 190.0)  # Frequencies at which a notch is looked for [Hz]
NOTCH = (0.1, 0.6)  # Damping ratios of its zeros and poles, to start with
LAGS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)
"""Time constants of the velocity's filter from which the search starts [s]."""
OUTPUT_LAG, DEAD = 2e-4, 1.2e-4  # Lag of the current loop and dead time from which the search starts [s]


def _columns(p: AxisProblem) -> list[tuple[Floats, Floats]]:
    """Return the law's columns on the fine clock, unfiltered, (6, m), and u of every window."""
    clock, out = Clock(p.step, p.substeps), []
    for s in p.windows:
        qr, vr, ar = clock.refined(p.qr[s], 1, 2)
        q, v = clock.refined(p.q[s], 1)
        e = qr - q
        out.append((np.stack([e, clock.h * np.cumsum(e), -v, vr, qr - qr[0], ar]), p.u[s]))
    return out


def _solved(p: AxisProblem, form: Servo, columns: list[tuple[Floats, Floats]]) -> tuple[float, Servo]:
    """Return the gains of a form by least squares; each window's constant is projected out."""
    clock = Clock(p.step, p.substeps, held=True)
    rows, efforts = [], []
    for fine, u in columns:
        picked, y = clock.out(clock.seen(fine, form), form)[:, p.skip :], u[p.skip :]
        rows.append(picked - picked.mean(axis=1, keepdims=True))
        efforts.append(y - y.mean())
    X, y = np.concatenate(rows, axis=1).T, np.concatenate(efforts)
    kept = free_gains(form)
    size = np.maximum(np.sqrt(np.mean(X[:, kept] ** 2, axis=0)), 1e-300)
    gains = np.zeros(6)
    gains[kept] = np.linalg.lstsq(X[:, kept] / size, y, rcond=1e-9)[0] / size
    left = y - X @ gains
    return float(left @ left), replace(form, gains=tuple(gains.tolist()))


def proportional(p: AxisProblem, near: Servo) -> Servo:
    """Return the law without an integral by least squares, with the filters of another."""
    columns = _columns(p)
    servo = _solved(p, replace(near, form="proportional"), columns)[1]
    parts = [u[p.skip :] - np.array(servo.gains) @ x[:, :: p.substeps][:, p.skip :] for x, u in columns]
    return replace(servo, offset=float(np.mean(np.concatenate(parts))))


def starts(p: AxisProblem, places: int = 3) -> list[Servo]:
    """Return laws by least squares that keep the simulated axis on its command, with and without a notch.

    The columns go through their own filters on a fine clock; encoder noise that is fed back biases this answer.
    """
    columns = _columns(p)
    found = []
    for notch in ((0.0, 0.0, 1.0), *((f, *NOTCH) for f in NOTCHES)):
        forms = [Servo((0.0,) * 6, lag, OUTPUT_LAG, notch, DEAD, step=p.step) for lag in LAGS]
        servo = min((_solved(p, form, columns) for form in forms), key=lambda x: x[0])[1]
        r = misfit(p, servo)
        found.append((np.inf if r is None else float(r @ r), servo))
    plain, *notched = found
    likely = sorted(notched, key=lambda x: x[0])[:places]
    return [servo for cost, servo in (plain, *likely) if np.isfinite(cost)]
