"""What an effort tells by itself: whether it is one, at which instant it acts, its sign, its size.

It is explained by the base parameters of the machine, whatever their values, and by friction of its own axis (both
linear). A jackknife over blocks of the log says how sure a lag, a sign, a size is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.logs.explained import BLOCKS, REACH, Course, Explained, basis_of, left_of
from pinotwin.logs.quality import Finding
from pinotwin.signals import autocorrelation
from pinotwin.solve.jackknife import jackknife

LATE = 0.012  # lag that no drive and no bus has [s]
_ROUNDS = 20  # of guessing the signs of a magnitude
_SURE = 3.0  # standard errors by which a sign must differ from zero, a lag from what a drive has
_GAIN = 0.2  # share of what is left of an effort that its best lag must take away
_EXPLAINED = 0.5  # share of an effort's power that must be explained before its sign or size means anything
_PLAIN = 0.005  # share of an effort's power below which a better fit is not worth a word,
_MOST = 0.6  # unless it takes away this share of what is left
_POOR = 0.3  # share of an effort's power left: the motion does not explain it
_RUBS = 0.8  # share of friction from which it is nearly all of an effort
_NEARLY_ALL = 0.85  # the same where the URDF's own masses decide
_STANDING = 0.1  # spread of an effort over its level below which it stands; a drive's noise is 0.01 to 0.03
_FACTOR = 6.0  # masses of a URDF are nominal, but not off by more than this


@dataclass(frozen=True)
class Fit:
    """An effort at its best lag.

    Attributes:
        late: samples that it is late by. part: the same between samples. error: its standard error.
        left_now: share of its power that is left at no lag. left: at the best one.
    """

    late: int
    part: float
    error: float
    left_now: float
    left: float


@dataclass(frozen=True)
class Examined:
    """The efforts of a log.

    Attributes:
        findings: which cannot be those of their axes, and why.
        at: rows of the motion.
        axes: the axes that move both ways, explained. fits: of those whose effort is one, at its best lag.
        reach: samples in which a lag is looked for.
    """

    findings: tuple[Finding, ...]
    at: Course
    axes: tuple[Explained, ...]
    fits: Mapping[str, Fit]
    reach: int

    @property
    def sound(self) -> list[Explained]:
        """The axes of which nothing was found."""
        named = {name for finding in self.findings for name in names_of(finding)}
        return [axis for axis in self.axes if axis.name not in named]


def names_of(finding: Finding) -> list[str]:
    """Return the axes that a finding is about."""
    return [channel.rpartition(".")[0] for channel in finding.channel.split(", ")]


def at_best(axis: Explained, basis: Floats, reach: int) -> Fit:
    """Return an effort at its best lag, looked for as far as ``reach`` samples."""
    shifts = np.unique(np.linspace(-reach, reach, min(2 * reach + 1, 61)).round().astype(int))
    left = np.array([left_of(axis.u[axis.rows + k], basis) for k in shifts])
    best = int(np.argmin(left))
    now = float(left[np.argmin(np.abs(shifts))])
    if best in (0, len(shifts) - 1):  # no minimum, only a slope: it says nothing about an instant
        return Fit(0, 0.0, np.inf, now, now)
    return Fit(int(shifts[best]), *_lowest(axis, basis, shifts), now, float(left[best]))


def _lowest(axis: Explained, basis: Floats, shifts: Ints) -> tuple[float, float]:
    """Return the best lag between samples and its standard error, by the jackknife over blocks of the log [samples]."""
    starts = np.linspace(0, len(axis.rows), BLOCKS + 1).astype(int)[:-1]
    power = np.empty((len(shifts), BLOCKS))
    for i, k in enumerate(shifts):
        y = axis.u[axis.rows + k]
        power[i] = np.add.reduceat((y - basis @ (basis.T @ y)) ** 2, starts)
    total = power.sum(axis=1)
    each = np.array([_bottom(shifts, total - power[:, k]) for k in range(BLOCKS)])
    return _bottom(shifts, total), float(np.sqrt(jackknife(each[:, None])[0, 0]))


def _bottom(x: Ints, y: Floats) -> float:
    """Return where the parabola through the lowest of even points and its neighbours is lowest."""
    k = int(np.clip(np.argmin(y), 1, len(y) - 2))
    bend = y[k - 1] - 2.0 * y[k] + y[k + 1]
    off = 0.5 * (y[k - 1] - y[k + 1]) / bend if bend > 0 else 0.0
    return float(x[k] + np.clip(off, -1.0, 1.0) * (x[k + 1] - x[k]))


def alone(axis: Explained, raw: Floats, reach: int) -> tuple[Finding | None, Fit]:
    """Return what is wrong with an effort whatever the others are, and its fit."""
    basis = basis_of(axis.columns)
    fit = at_best(axis, basis, reach)
    channel = f"{axis.name}.u"
    good = raw[np.isfinite(raw)]
    memory = np.abs(autocorrelation(good, 3)[1:]) if np.ptp(good) > 0 else np.ones(3)
    level = float(np.median(good)) if len(good) else 0.0
    if fit.left > 0.9 and _stands(good, level):
        unit = "N·m" if axis.rotary else "N"
        text = (
            f"stands at {level:.3g} {unit} while the axis moves both ways: a drive at its limit all along, or no "
            "effort of this axis"
        )
        return Finding("warning", channel, text, "effort_stands"), fit
    if fit.left > 0.9 and memory.max() < 0.2:
        text = "is noise: it has no memory and nothing of the motion in it; log the motor's effort"
        return Finding("warning", channel, text, "effort_noise"), fit
    if is_unsigned(axis, basis, good):
        text = (
            "never changes its sign, but fits the motion with a sign that changes where it touches zero: a "
            "magnitude was logged; log the signed effort"
        )
        return Finding("warning", channel, text, "effort_unsigned"), fit
    return None, fit


def _stands(raw: Floats, level: float) -> bool:
    """Whether an effort hardly varies about a level: friction alone turns it round with the motion."""
    return len(raw) > 0 and float(np.ptp(np.percentile(raw, [1.0, 99.0]))) < _STANDING * abs(level)


def is_unsigned(axis: Explained, basis: Floats, raw: Floats) -> bool:
    """Whether an effort that only touches zero fits far better with a sign that changes there."""
    low, high = np.percentile(raw, 0.5), np.percentile(raw, 99.5)
    if high <= 0 or low < -0.02 * high or low > 0.1 * high:  # a load that hangs never comes near zero
        return False
    size = axis.u[axis.rows]
    rubs = 0.5 * np.mean(size) * np.sign(axis.v)
    guesses = (np.sign(axis.v), np.sign(axis.rigid), np.sign(axis.rigid + rubs))
    signed = min((_signed(size, basis, guess) for guess in guesses), key=lambda y: _rest(y, basis))
    return _rest(signed, basis) < 0.5 * _rest(size, basis) and left_of(signed, basis) < _POOR


def _signed(size: Floats, basis: Floats, sign: Floats) -> Floats:
    """Return a magnitude with the sign of what explains it: guessed, fitted, taken from the fit, fitted again."""
    for _ in range(_ROUNDS):
        fitted = np.sign(basis @ (basis.T @ (size * sign)))
        if np.array_equal(fitted, sign):
            break
        sign = fitted
    return size * sign


def _rest(y: Floats, basis: Floats) -> float:
    return float(y @ y - np.sum((basis.T @ y) ** 2))


def late(axes: Sequence[Explained], fits: Mapping[str, Fit], step: float) -> Iterator[Finding]:
    """Name the efforts that come later or earlier than any drive lets them."""
    for axis in axes:
        fit = fits[axis.name]
        seconds, error = fit.part * step, fit.error * step
        told = _is_better(fit.left_now, fit.left) and fit.left < 1.0 - _EXPLAINED
        beyond = LATE + _SURE * error < abs(seconds) < 0.9 * REACH
        if beyond and told and _friction(axis, fit) < _RUBS:
            how = "late" if seconds > 0 else "early"
            yield Finding(
                "warning",
                f"{axis.name}.u",
                f"comes {1e3 * abs(seconds):.0f} ms {how} for the motion, more than any drive: the channels "
                "are not of one instant; log them together, or shift this column before use",
                "effort_late" if seconds > 0 else "effort_early",
            )


def _is_better(now: float, then: float) -> bool:
    """Whether what is left of an effort at its best lag is enough less than what is left now."""
    gain = now - then
    return gain > max(_GAIN * now, _PLAIN) or gain > _MOST * now


def _friction(axis: Explained, fit: Fit) -> float:
    """Return the share of friction in an effort. Presliding friction is late for the motion by itself."""
    y = axis.u[axis.rows + fit.late]
    theta = np.linalg.lstsq(axis.columns, y, rcond=1e-9)[0]
    return float(np.std(axis.columns[:, axis.friction] @ theta[axis.friction]) / np.std(y))


def _jackknife(columns: Floats, y: Floats, measure: Floats) -> tuple[float, float, Floats]:
    """Return ``measure @ theta`` of a least-squares fit, its standard error, and the fit's theta."""
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    scaled = columns / size
    whole = np.linalg.lstsq(scaled, y, rcond=1e-6)[0] / size
    bounds = np.linspace(0, len(y), BLOCKS + 1).astype(int)
    values = []
    for low, high in pairwise(bounds):
        keep = np.r_[0:low, high : len(y)]
        values.append(measure @ (np.linalg.lstsq(scaled[keep], y[keep], rcond=1e-6)[0] / size))
    error = float(np.sqrt(jackknife(np.array(values)[:, None])[0, 0]))
    return float(measure @ whole), error, whole


def turned_round(axes: Sequence[Explained], fits: Mapping[str, Fit]) -> Iterator[Finding]:
    """Name the axes whose friction would drive them: its power is taken out of a motion, always."""
    wrong = [axis.name for axis in axes if is_reversed(axis, fits[axis.name])]
    if not wrong:
        return
    whose = "of every axis" if len(wrong) == len(axes) > 1 else f"of {', '.join(wrong)}"
    yield Finding(
        "warning",
        ", ".join(f"{name}.u" for name in wrong),
        f"the effort {whose} has the wrong sign: friction would drive the motion; give its column in "
        "machine.yaml a negative factor (or those of the position, if that is what is reversed)",
        "effort_sign",
    )


def drives(axis: Explained) -> bool:
    """Whether the friction of an axis would drive it, or its weights pull the other way, at no lag."""
    left = left_of(axis.u[axis.rows], basis_of(axis.columns))
    return is_reversed(axis, Fit(0, 0.0, 0.0, left, left))


def is_reversed(axis: Explained, fit: Fit) -> bool:
    """Whether friction would drive an axis, or the weights of its links pull the other way."""
    if fit.left > 1.0 - _EXPLAINED:
        return False
    y = axis.u[axis.rows + fit.late]
    measure = np.zeros(axis.columns.shape[1])
    measure[axis.friction] = np.mean(axis.v**2), np.mean(np.abs(axis.v))  # power of each coefficient
    power, error, theta = _jackknife(axis.columns, y, measure)
    friction = axis.columns[:, axis.friction] @ theta[axis.friction]
    heard = np.std(friction) > 0.05 * np.std(y)
    pushes = power < -_SURE * error and heard
    brakes = power > _SURE * error and heard
    scale, sd, share = _scale(axis, y)
    against = scale < -_SURE * sd and share > _NEARLY_ALL
    along = scale > _SURE * sd and share > _EXPLAINED
    return bool((pushes and not along) or (against and not brakes))


def _scale(axis: Explained, y: Floats, rotor: bool = False) -> tuple[float, float, float]:
    """Return effort over that of the URDF, its standard error, and its share of what friction leaves.

    With ``rotor`` the axis' own acceleration is explained apart: a geared motor adds inertia that is in no URDF.
    """
    if not np.ptp(axis.rigid) > 0:
        return 1.0, np.inf, 0.0
    columns = np.column_stack([axis.rigid, axis.columns[:, -3:], *([axis.a] if rotor else [])])
    own = basis_of(columns[:, 1:])
    without = y - own @ (own.T @ y)
    scale, error, theta = _jackknife(columns, y, np.eye(columns.shape[1])[0])
    rest = y - columns @ theta
    return scale, error, 1.0 - float(rest @ rest) / max(float(without @ without), 1e-300)


def _is_beyond(scale: float, doubt: float) -> bool:
    """Whether a scale is larger or smaller than masses can be off, by more than its doubt."""
    return scale - doubt > _FACTOR or scale + doubt < 1.0 / _FACTOR


def scaled(axis: Explained, fit: Fit) -> Iterator[Finding]:
    """Name an effort that is many times what the URDF's masses ask for, or a small part of it."""
    y = axis.u[axis.rows + fit.late]
    scale, error, share = _scale(axis, y)
    if axis.rotary and abs(scale) > 1:
        scale, error, share = _scale(axis, y, rotor=True)
    if share < _EXPLAINED or not _is_beyond(abs(scale), _SURE * error):
        return
    size = abs(scale)
    times = f"{scale:.3g} times too large" if size > 1 else f"{1 / size:.3g} times too small"
    yield Finding(
        "warning",
        f"{axis.name}.u",
        f"is {times} for the URDF's masses. Check the masses, and unit and factor under columns in machine.yaml",
        "effort_scale",
    )
