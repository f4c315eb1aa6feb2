"""An unbroken stretch of a log as columns on an even clock, after one zero-phase low-pass.

What is linear before the low-pass is linear after it, so the columns of a cause can be added to those of a healthy day.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects.family import FRICTION
from pinotwin.motion import Motion
from pinotwin.twin import Twin

Columns = Mapping[str, Floats]


@dataclass(frozen=True, eq=False)
class Stretch:
    """Columns of every axis, of shape (n,) each.

    Attributes:
        t: time since the stretch begins [s], shape (n,). step: of it [s]. cycle: of the log [s].
        log: number of the log. start: row of it at which the stretch begins.
        cell: number of the cell that each row is in, shape (n,).
        axes: axis -> channel -> column.
        motion: the stretch as prepared, with the channels of the twin's effort. rows: those of it that are kept.
    """

    t: Floats
    step: float
    cycle: float
    log: int
    start: int
    cell: Ints
    axes: Mapping[str, Columns]
    motion: Motion
    rows: Ints

    def thirds(self) -> list[Stretch]:
        """Return three parts of the stretch as logs of their own."""
        n, out = len(self.t), []
        for k in range(3):
            part = slice(k * n // 3, (k + 1) * n // 3)
            axes = {
                a: {c: x[part] if len(x) == n else x for c, x in row.items()} for a, row in self.axes.items()
            }
            t, cell, rows = self.t[part], self.cell[part], self.rows[part]
            out.append(replace(self, log=3 * self.log + k, t=t, cell=cell, rows=rows, axes=axes))
        return out

    def scaled(self, factors: Mapping[str, float]) -> Stretch:
        """Return the stretch with the efforts of some axes multiplied by factors [1]."""
        axes = dict(self.axes)
        for name, x in factors.items():
            c = axes[name]
            axes[name] = {**c, "u": c["u"] * x, "du": c["du"] * x, "left": c["left"] + (x - 1.0) * c["u"]}
        return replace(self, axes=axes)

    def low(self, x: Floats) -> Floats:
        """Return columns (n,) or (n, k) of this clock after the low-pass."""
        return np.asarray(filtfilt(*_low(min(2.0 * corner(1.0 / self.cycle) * self.step, 0.9)), x, axis=0))

    def taken(self, x: Floats) -> Floats:
        """Return columns of shape (m,) or (m, k) on the log's clock after the low-pass, on the rows that are kept."""
        return smooth(x, self.cycle)[self.rows]


def combined(x: Floats, numbers: Floats) -> Floats:
    """Return columns of shape (n,) or (n, p) times their numbers (p,), shape (n,)."""
    return np.asarray(x.reshape(len(x), -1) @ numbers)


def corner(rate: float) -> float:
    """Return the corner of the low-pass at a sampling rate [Hz]."""
    return min(SETTINGS.corner, 0.2 * rate)


def smooth(x: Floats, cycle: float) -> Floats:
    """Return columns (n,) or (n, k) sampled every ``cycle`` [s] after the low-pass."""
    return np.asarray(filtfilt(*_low(2.0 * corner(1.0 / cycle) * cycle), x, axis=0))


@cache
def _low(share: float) -> tuple[Floats, Floats]:
    """Return numerator and denominator of the low-pass with its corner at a share of half the rate."""
    return butter(3, share)


def stretches(
    twin: Twin, motion: Motion, left: Floats, log: int, axes: Sequence[str], top: Mapping[str, float]
) -> list[Stretch]:
    """Return the unbroken stretches of a prepared log, of a number, that are long enough to be judged.

    ``left``: measured effort less the twin's, shape (n, nv) [N or N·m]; ``top``: axis -> its highest speed in the
    twin's own logs [m/s or rad/s], by which standstill is told.
    """
    least = 4.0 * SETTINGS.cell / motion.step
    rate, out = 1.0 / motion.step, list[Stretch]()
    edge, every = int(0.3 * rate), max(1, int(rate / (5.0 * corner(rate))))
    for part in [s for s in motion.segments if s.stop - s.start > least]:
        m, rest = motion.cut(part.start, part.stop), left[part.start : part.stop]
        rows, found = np.arange(edge, len(m) - edge, every), dict[str, dict[str, Floats]]()
        parts, guesses = effort_parts(twin, m), twin.effort_errors(m.at(rows))
        for name in axes:
            j = m.names.index(name)
            columns = _axis(m, j, top.get(name)) | {k: smooth(x[:, j], m.step) for k, x in parts.items()}
            columns["left"] = smooth(np.nan_to_num(rest[:, j]), m.step)
            servo = twin.servos.get(name)
            columns["clear"] = _clear(columns, m.step, servo.encoder[0] if servo else 0.0)
            found[name] = {k: x[rows] for k, x in columns.items()}
            noise = float(np.std(m.u[:, j] - columns["u"])) / max(float(np.std(m.u[:, j])), 1e-300)
            q, v = found[name]["q"], np.abs(found[name]["v"])
            reach = np.array([q.min(), q.max(), np.quantile(v, 0.99)])
            found[name] |= {"raw": np.array([noise]), "unsure": guesses[:, j], "reach": reach}
        t = m.t[rows] - m.t[0]
        cell = (t / SETTINGS.cell).astype(np.intp)
        out.append(Stretch(t, every * m.step, m.step, log, part.start, cell, found, m, rows))
    return out


def _axis(m: Motion, j: int, top: float | None) -> dict[str, Floats]:
    """Return the channels of an axis on every row, each of shape (n,)."""
    t, q, u, rate = m.t - m.t[0], m.q[:, j], np.nan_to_num(m.u[:, j]), 1.0 / m.step
    spline = {k: CubicSpline(t, smooth(x, m.step)) for k, x in (("q", q), ("u", u))}
    v, a = spline["q"](t, 1), spline["q"](t, 2)
    top = float(np.quantile(np.abs(v), 0.99)) if top is None else top
    goes = np.abs(v) > 0.003 * top
    reach = np.ones(max(1, int(0.5 * rate / corner(rate))))
    near = np.convolve(np.abs(v) < 0.015 * top, reach, "same") > 0
    last = np.maximum.accumulate(np.where(goes, np.arange(len(t)), 0))
    sign = np.sign(v) * goes
    out = {
        "q": spline["q"](t),
        "v": v,
        "a": a,
        "j": spline["q"](t, 3),
        "s": CubicSpline(t, a)(t, 2),
        "sg": smooth(sign, m.step),
        "memory": smooth(np.sign(v[last]), m.step),
        "u": spline["u"](t),
        "du": spline["u"](t, 1),
        "one": np.ones(len(t)),
        "moving": (~near & m.use[:, j]).astype(float),
        "going": ((np.convolve(goes, reach, "same") > 0) & m.use[:, j]).astype(float),
    }
    gap = None if m.ql is None else m.ql[:, j] - q
    if gap is not None and np.isfinite(gap).all():
        out["gap"] = smooth(gap, m.step)
    if m.qr is not None and np.isfinite(m.qr[:, j]).all():
        command = CubicSpline(t, smooth(m.qr[:, j], m.step))
        error = smooth(m.error[:, j], m.step)
        out |= {"e": error, "ie": np.cumsum(error) * m.step, "qr": command(t)}
        out |= {k: command(t, n) for n, k in enumerate(("vr", "ar", "jr"), 1)}
        # A velocity loop integrates the motor, also where the position loop is closed on the load.
        watched = bool(m.on_load) and m.on_load[j]
        out["lead"] = out["gap"] if watched and "gap" in out else np.zeros(len(t))
    return out


def _clear(c: Columns, cycle: float, step: float) -> Floats:
    """Return 0 on rows at which sampled steps of an encoder come and go slowly, not as the controller's, else 1."""
    if not step or "vr" not in c:
        return np.ones(len(c["q"]))
    passes, often = 2.0 * corner(1.0 / cycle), np.abs(c["vr"]) / step  # [Hz]
    # An accelerated axis has left such a speed before the low-pass lets anything through.
    slowly = np.abs(often - np.round(often * cycle) / cycle) < passes
    return np.asarray(1.0 - slowly * (often > 0.5 / cycle) * (np.abs(c["ar"]) / step < passes**2))


VISCOUS = ("viscous", "viscous_asymmetric", "viscous_thermal", "quadratic_drag")


def effort_parts(twin: Twin, m: Motion) -> dict[str, Floats]:
    """Return the twin's effort by part on every row, shape (n, nv) each: dry and viscous friction, the rest."""
    scene, nv = twin.scene(m), twin.machine.nv
    out = {k: np.zeros((len(m), nv)) for k in ("dry", "viscous", "rest")}
    for effect, theta in twin.pairs:
        rubs = effect.family is FRICTION
        part = "rest" if not rubs else "viscous" if effect.name in VISCOUS else "dry"
        out[part] += effect.columns(scene).effort(theta, nv)
    return out
