"""What an effort tells by itself: whether it is one, at which instant it acts, its sign, its size, by a jackknife.

It also tells whether the command was recorded late: a controller cannot answer to what has not been commanded yet. Its
effort is linear in error, integral, speed, dry friction and the command's derivatives. It fits best with a later
command only where the log has that late, by blocks of 1 s that were left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.logs.explained import Course, Explained, left_of
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import Settings
from pinotwin.motion import Motion
from pinotwin.signals import autocorrelation
from pinotwin.solve.jackknife import without_each
from pinotwin.solve.lead import Lag


@dataclass(frozen=True)
class Examined:
    """The efforts of a log."""

    findings: tuple[Finding, ...]  # which cannot be those of their axes, and why
    at: Course  # rows of the motion
    axes: tuple[Explained, ...]  # the axes that move both ways, explained

    @property
    def sound(self) -> list[Explained]:
        """The axes of which nothing was found."""
        return [axis for axis in self.axes if axis.name not in named(self.findings)]


def named(findings: Sequence[Finding]) -> set[str]:
    """Return the axes that findings are about."""
    return {name for one in findings for name in one.axis.split(", ")}


def alone(axis: Explained, raw: Floats, fit: Lag) -> Finding | None:
    """Return what is wrong with an effort, whatever others are: ``raw`` as logged [SI] (n,), ``fit`` at its lag."""
    channel = f"{axis.name}.u"
    good = raw[np.isfinite(raw)]
    memory = np.abs(autocorrelation(good, 3)[1:]) if np.ptp(good) > 0 else np.ones(3)
    level = float(np.median(good)) if len(good) else 0.0
    spread = float(np.ptp(np.percentile(good, [1.0, 99.0]))) if len(good) else np.inf
    if fit.left > 0.9 and spread < axis.settings.standing * abs(level):
        return finding("effort_stands", channel, level=level, unit="N·m" if axis.rotary else "N")
    if fit.left > 0.9 and memory.max() < 0.2:
        return finding("effort_noise", channel)
    return finding("effort_unsigned", channel) if is_unsigned(axis, good) else None


def is_strange(axis: Explained, fit: Lag, tries: int = 40, best: float = 0.2) -> bool:
    """Whether an effort (n,) fits its motion no better than when it is moved by many seconds, both ends joined.

    By what is left of its variance: of an axis that seldom moves, the weight it holds at other times is a constant.
    """
    n, now = len(axis.u), axis.u[axis.rows]
    moved = [np.roll(axis.u, k)[axis.rows] for k in np.linspace(0.1 * n, 0.9 * n, tries).astype(int)]
    left = fit.left * float(now @ now) / max(len(now) * float(np.var(now)), 1e-300)
    others = [left_of(y - y.mean(), axis.basis) for y in moved]
    return bool(left > max(np.quantile(others, best), axis.settings.poor))


def is_unsigned(axis: Explained, raw: Floats) -> bool:
    """Whether an effort that only touches zero fits far better with a sign that changes there."""
    low, high = np.percentile(raw, 0.5), np.percentile(raw, 99.5)
    hangs = low > 0.1 * high and np.any(axis.weight)  # then it never comes near zero
    if high <= 0 or low < -0.02 * high or hangs:
        return False
    size, basis = axis.u[axis.rows], axis.basis
    rubs = 0.5 * np.mean(size) * np.sign(axis.v)
    guesses = (np.sign(axis.v), np.sign(axis.rigid), np.sign(axis.rigid + rubs))
    signed = min((_signed(size, basis, guess) for guess in guesses), key=lambda y: _rest(y, basis))
    better = _rest(signed, basis) < 0.5 * _rest(size, basis)
    return better and left_of(signed, basis) < axis.settings.poor


def _signed(size: Floats, basis: Floats, sign: Floats, rounds: int = 20) -> Floats:
    """Return a magnitude with the sign of what explains it: guessed, fitted, taken from the fit, fitted again."""
    for _ in range(rounds):
        again = np.sign(basis @ (basis.T @ (size * sign)))
        if np.array_equal(again, sign):
            break
        sign = again
    return size * sign


def _rest(y: Floats, basis: Floats) -> float:
    return float(y @ y - np.sum((basis.T @ y) ** 2))


def late(axes: Sequence[Explained], fits: Mapping[str, Lag], step: float) -> Iterator[Finding]:
    """Name the efforts that come later or earlier than any drive lets them."""
    for axis in axes:
        fit, limit = fits[axis.name], axis.settings
        seconds, error = fit.part * step, fit.error * step
        gain = fit.left_now - fit.left
        better = gain > max(limit.gain * fit.left_now, limit.plain) or gain > limit.most * fit.left_now
        beyond = limit.late + limit.sure * error < abs(seconds) < 0.9 * limit.lag_reach
        if beyond and better and fit.left < 1.0 - limit.explained and _friction(axis, fit) < limit.rubs:
            code = "effort_late" if seconds > 0 else "effort_early"
            yield finding(code, f"{axis.name}.u", ms=1e3 * abs(seconds))


def _friction(axis: Explained, fit: Lag) -> float:
    """Return the share of friction in an effort. Presliding friction is late for the motion by itself."""
    y = axis.u[axis.rows + fit.late]
    theta = np.linalg.lstsq(axis.columns, y, rcond=1e-9)[0]
    return float(np.std(axis.columns[:, axis.friction] @ theta[axis.friction]) / np.std(y))


def turned_round(axes: Sequence[Explained], fits: Mapping[str, Lag]) -> Iterator[Finding]:
    """Name the axes whose friction would drive them: its power is taken out of a motion, always."""
    wrong = [axis.name for axis in axes if is_reversed(axis, fits[axis.name])]
    if wrong:
        whose = "of every axis" if len(wrong) == len(axes) > 1 else f"of {', '.join(wrong)}"
        yield finding("effort_sign", ", ".join(f"{name}.u" for name in wrong), whose=whose)


def is_reversed(axis: Explained, fit: Lag | None = None) -> bool:
    """Whether friction would drive an axis, or the weights of its links pull the other way; without a fit at no lag."""
    limit, fit = axis.settings, fit or Lag(0, 0.0, 0.0, axis.left, axis.left)
    if fit.left > 1.0 - limit.explained:
        return False
    y = axis.u[axis.rows + fit.late]
    power, error, theta = axis.rubbed(y)
    friction = axis.columns[:, axis.friction] @ theta[axis.friction]
    heard = np.std(friction) > 0.05 * np.std(y)
    pushes = power < -limit.sure * error and heard
    brakes = power > limit.sure * error and heard
    scale, sd, share = axis.scale(y)
    against = scale < -limit.sure * sd and share > limit.nearly_all
    along = scale > limit.sure * sd and share > limit.explained
    return bool((pushes and not along) or (against and not brakes))


def weightless(axes: Sequence[Explained], least: float = 0.2, seen: float = 0.05) -> Iterator[Finding]:
    """Name the efforts without weight, where no axis holds any; looked for from so much weight [-] on."""
    light = []
    for axis in axes:
        y = axis.u[axis.rows]
        if np.sqrt(np.mean(axis.weight**2)) < seen * np.std(y):
            continue
        share, error = axis.weighed(y)
        doubt = axis.settings.sure * error
        if share - doubt > least:
            return
        light += [axis.name] if abs(share) + doubt < least else []
    if light:
        yield finding("effort_weightless", ", ".join(f"{name}.u" for name in light))


def frictionless(axes: Sequence[Explained], least: float = 0.01) -> Iterator[Finding]:
    """Name the efforts that hold no friction, in power over that of effort and speed [-]: a model, or a sensor."""
    free = []
    for axis in axes:
        y = axis.u[axis.rows]
        power, error, _ = axis.rubbed(y)
        whole = np.std(y) * np.sqrt(np.mean(axis.v**2))
        free += [axis.name] if abs(power) + axis.settings.sure * error < least * whole else []
    if free:
        yield finding("effort_frictionless", ", ".join(f"{name}.u" for name in free))


def scaled(axis: Explained, fit: Lag) -> Iterator[Finding]:
    """Name an effort that is many times what the URDF's masses ask for, or a small part of it."""
    y, limit = axis.u[axis.rows + fit.late], axis.settings
    scale, error, share = axis.scale(y)
    if axis.rotary and abs(scale) > 1:
        scale, error, share = axis.scale(y, rotor=True)
    size, doubt = abs(scale), limit.sure * error
    if share >= limit.explained and (size - doubt > limit.factor or size + doubt < 1.0 / limit.factor):
        times = f"{scale:.3g} times too large" if size > 1 else f"{1 / size:.3g} times too small"
        yield finding("effort_scale", f"{axis.name}.u", times=times)


def command_findings(motion: Motion, settings: Settings) -> Iterator[Finding]:
    """Name the axes whose command was recorded late, and by how much."""
    for j, name in enumerate(motion.names):
        late = late_by(motion, j, settings)
        if late:
            yield finding("command_late", f"{name}.qr", ms=1e3 * late * motion.step, rows=late)


def untold(motion: Motion, j: int, settings: Settings, late: float = 0.02) -> bool:
    """Whether a command of a joint that came late [s] would not be seen on this motion."""
    if motion.qr is None:
        return False
    qr, rows = motion.qr.copy(), max(1, round(late / motion.step))
    qr[:, j] = np.roll(qr[:, j], rows)
    return not late_by(replace(motion, qr=qr), j, settings)


def late_by(motion: Motion, j: int, settings: Settings, most: int = 40_000) -> int:
    """Return by how many rows the command of a joint comes late, by the first so many; 0 where that is not sure."""
    reach = min(round(settings.lag_reach / motion.step), 16)
    inside = [np.arange(s.start + reach + 1, s.stop - reach - 1) for s in motion.segments]
    rows = np.concatenate(inside)[:most] if inside else np.zeros(0, dtype=int)
    slow = motion.step > 1.0 / settings.slow_rate  # what a controller does falls between the samples
    if motion.qr is None or slow or len(rows) * motion.step < 4.0:
        return 0
    channels = motion.qr[rows, j], motion.u[rows, j]
    if not all(np.isfinite(x).all() and np.ptp(x) > 0.0 for x in channels):
        return 0
    motion = motion.cut(0, int(rows[-1]) + reach + 1)
    edges = np.flatnonzero(np.diff((motion.t[rows] - motion.t[0]) // 1.0)) + 1
    lags = np.arange(-reach, reach + 1)
    left = np.array([_left(motion, j, rows, edges, int(k), ()) for k in lags])
    best = int(np.argmin(left.sum(axis=1)))
    gain = np.log(left[reach] / np.maximum(left[best], 1e-300))
    error = float(np.std(gain)) / np.sqrt(len(gain))
    foretold = left[best].sum() < settings.poor * float(np.var(motion.u[rows, j])) * len(rows)
    worth = left[best].sum() < (1.0 - settings.lead_gain) * left[reach].sum()
    sure = foretold and worth and lags[best] > 0 and gain.mean() > settings.sure * error
    if not sure:
        return 0
    turn = 0.003, 0.01, 0.03, 0.1  # of the top speed, over which friction turns
    beside = [_left(motion, j, rows, edges, int(k), turn).sum() for k in lags]
    return int(lags[best]) if lags[np.argmin(beside)] > 0 else 0


def _left(motion: Motion, j: int, rows: Ints, edges: Ints, lag: int, turn: Sequence[float]) -> Floats:
    """Return the squared error of every block, foretold from others: command so many rows on, friction beside."""
    assert motion.qr is not None
    qr = np.roll(motion.qr[:, j], -lag)
    e, v, vr = qr - motion.q[:, j], motion.v[:, j], np.gradient(qr, motion.step)
    law = [e, np.cumsum(e) * motion.step, v, vr, np.gradient(vr, motion.step), np.ones(len(e))]
    law += [np.tanh(v / (share * np.abs(v[rows]).max())) for share in turn]
    X, y = np.column_stack(law)[rows], motion.u[rows, j]
    X = X / np.maximum(np.abs(X).max(axis=0), 1e-300)
    blocks = [slice(a, b) for a, b in pairwise([0, *edges.tolist(), len(rows)])]
    others = without_each(X, y, blocks, ridge=1e-10)[:-1]
    return np.array([np.sum((y[b] - X[b] @ c) ** 2) for b, c in zip(blocks, others, strict=True)]) + 1e-300
