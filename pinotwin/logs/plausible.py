"""Whether the efforts of a log can be those of the machine: sign, axis, instant, unit.

Nothing is fitted for its own sake here. Each effort is explained by the base parameters of the machine, whatever
their values, and by friction of its own axis (both linear), and the tests only use what no machine can break:
friction takes power out of a motion, an effort acts at once, on its own axis, and with the size that the
URDF's masses ask for, give or take a few times. A jackknife over blocks of the log says how sure a sign is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.log import Log
from pinotwin.logs.exchanged import exchanged
from pinotwin.logs.explained import BLOCKS, REACH, Explained, basis_of, course, explained, left_of
from pinotwin.logs.quality import Finding
from pinotwin.logs.quality.sampling import SLOW
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import autocorrelation
from pinotwin.solve.jackknife import jackknife
from pinotwin.system.threads import one_blas_thread
from pinotwin.units import ELECTRICAL, si_factor

LATE = 0.012  # lag that no drive and no bus has [s]
_ROUNDS = 20  # of guessing the signs of a magnitude
_SURE = 3.0  # standard errors by which a sign must differ from zero, a lag from what a drive has
_GAIN = 0.2  # share of what is left of an effort that its best lag must take away
_EXPLAINED = 0.5  # share of an effort's power that must be explained before its sign or size means anything
_PLAIN = 0.005  # share of an effort's power below which a better fit is not worth a word
_POOR = 0.3  # share of an effort's power left: the motion does not explain it
_RUBS = 0.8  # share of friction from which it is nearly all of an effort
_NEARLY_ALL = 0.85  # the same where the URDF's own masses decide
_FACTOR = 6.0  # masses of a URDF are nominal, but not off by more than this


@dataclass(frozen=True)
class _Fit:
    """An effort at its best lag: samples it is late by, their error, shares of its power left at 0 and there."""

    late: int
    error: float
    left_now: float
    left: float


@one_blas_thread
def effort_findings(machine: Machine, motion: Motion, log: Log) -> list[Finding]:
    """Say which efforts of a log cannot be those of its axes, and why.

    Args:
        machine: the machine.
        motion: the log, prepared.
        log: the same, bound (SI), as the file has it.
    """
    if motion.step > 1.0 / SLOW:
        return []  # accelerations, and when a motion turns, fall between the samples
    reach = int(np.ceil(REACH / motion.step))
    at = course(motion, reach)
    if at is None:
        return []
    axes = list(explained(machine, motion.u, at))
    out = []
    fits: dict[str, _Fit] = {}
    for axis in axes:
        raw = log.channels.get(f"{axis.name}.u", axis.u)
        found, fit = _alone(axis, raw, motion.step, reach)
        if found is None:
            fits[axis.name] = fit
        else:
            out.append(found)
    clear = [axis for axis in axes if axis.name in fits]
    swapped = list(exchanged(machine, motion.u, at, clear))
    out += swapped
    named = {name for finding in swapped for name in _names(finding)}
    rest = [axis for axis in clear if axis.name not in named]
    out += _late(rest, fits, motion.step)
    out += _reversed(rest, fits)
    reverse = {name for finding in out if finding.code == "effort_sign" for name in _names(finding)}
    for axis in rest:
        if axis.name not in reverse:
            out += _scaled(axis, fits[axis.name])
    return out


def unit_findings(log: Log) -> list[Finding]:
    """Say which efforts are still a drive's current or share: N and N·m are printed for them all the same.

    Args:
        log: bound (SI), with the unit of each channel and what it was scaled by.
    """
    of: dict[str, list[str]] = {}
    for name, unit in log.units.items():
        electrical = name.endswith(".u") and unit in ELECTRICAL
        if electrical and abs(log.scale.get(name, (0.0, 0.0))[0]) == si_factor(unit):
            of.setdefault(ELECTRICAL[unit], []).append(name)
    return [
        Finding(
            "warning",
            ", ".join(names),
            f"in {unit}, as columns gives no factor: where N or N·m is printed, it is {unit}; what couples axes, "
            "as gravity and payload, needs the factor (torque constant x gear)",
            "effort_unit",
        )
        for unit, names in of.items()
    ]


def _names(finding: Finding) -> list[str]:
    return [channel.rpartition(".")[0] for channel in finding.channel.split(", ")]


def _at_best(axis: Explained, basis: Floats, reach: int) -> _Fit:
    shifts = np.unique(np.linspace(-reach, reach, min(2 * reach + 1, 61)).round().astype(int))
    left = np.array([left_of(axis.u[axis.rows + k], basis) for k in shifts])
    best = int(np.argmin(left))
    now = float(left[np.argmin(np.abs(shifts))])
    if best in (0, len(shifts) - 1):  # no minimum, only a slope: it says nothing about an instant
        return _Fit(0, np.inf, now, now)
    return _Fit(int(shifts[best]), _spread(axis, basis, shifts), now, float(left[best]))


def _spread(axis: Explained, basis: Floats, shifts: Ints) -> float:
    """Return the standard error of the best lag, by the jackknife over blocks of the log [samples]."""
    starts = np.linspace(0, len(axis.rows), BLOCKS + 1).astype(int)[:-1]
    power = np.empty((len(shifts), BLOCKS))
    for i, k in enumerate(shifts):
        y = axis.u[axis.rows + k]
        power[i] = np.add.reduceat((y - basis @ (basis.T @ y)) ** 2, starts)
    best = shifts[np.argmin(power.sum(axis=1)[:, None] - power, axis=0)]
    return float(np.sqrt(jackknife(best[:, None].astype(float))[0, 0]))


def _alone(axis: Explained, raw: Floats, step: float, reach: int) -> tuple[Finding | None, _Fit]:
    """Return what is wrong with an effort whatever the others are, and its fit."""
    basis = basis_of(axis.columns)
    fit = _at_best(axis, basis, reach)
    channel = f"{axis.name}.u"
    good = raw[np.isfinite(raw)]
    memory = np.abs(autocorrelation(good, 3)[1:]) if np.ptp(good) > 0 else np.ones(3)
    if fit.left > 0.9 and memory.max() < 0.2:
        text = "is noise: it has no memory and nothing of the motion in it; log the motor's effort"
        return Finding("warning", channel, text, "effort_noise"), fit
    if _is_unsigned(axis, basis, good):
        text = (
            "never changes its sign, but fits the motion with a sign that changes where it touches zero: a "
            "magnitude was logged; log the signed effort"
        )
        return Finding("warning", channel, text, "effort_unsigned"), fit
    return None, fit


def _is_unsigned(axis: Explained, basis: Floats, raw: Floats) -> bool:
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


def _late(axes: Sequence[Explained], fits: dict[str, _Fit], step: float) -> Iterator[Finding]:
    for axis in axes:
        fit = fits[axis.name]
        seconds, error = fit.late * step, fit.error * step
        gain = fit.left_now - fit.left
        told = gain > max(_GAIN * fit.left_now, _PLAIN) and fit.left < 1.0 - _EXPLAINED
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


def _friction(axis: Explained, fit: _Fit) -> float:
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
    spread = np.array(values)
    error = float(np.sqrt((BLOCKS - 1) * np.mean((spread - spread.mean()) ** 2)))
    return float(measure @ whole), error, whole


def _reversed(axes: Sequence[Explained], fits: dict[str, _Fit]) -> Iterator[Finding]:
    """Name the axes whose friction would drive them: its power is taken out of a motion, always."""
    wrong = [axis.name for axis in axes if _is_reversed(axis, fits[axis.name])]
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


def _is_reversed(axis: Explained, fit: _Fit) -> bool:
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


def _scaled(axis: Explained, fit: _Fit) -> Iterator[Finding]:
    y = axis.u[axis.rows + fit.late]
    scale, error, share = _scale(axis, y)
    if axis.rotary and abs(scale) > 1:
        scale, error, share = _scale(axis, y, rotor=True)
    if share < _EXPLAINED or error > 0.2 * abs(scale) or 1 / _FACTOR < abs(scale) < _FACTOR:
        return
    times = f"{scale:.3g} times" if abs(scale) > 1 else f"1/{1 / abs(scale):.3g} of"
    yield Finding(
        "warning",
        f"{axis.name}.u",
        f"is {times} the effort that the URDF's masses ask for: another unit of effort or position, or other "
        "masses? set unit or factor under columns in machine.yaml",
        "effort_scale",
    )
