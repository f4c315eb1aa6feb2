"""The recording as a suspect: a transform of the log, scored again by the same equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.days.evidence import Spoilt, cells
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import ALL, Row
from pinotwin.diagnosis.days.rows import Asked, positive, spread
from pinotwin.diagnosis.days.score import Cells, opened, score
from pinotwin.diagnosis.days.settings import SETTINGS
from pinotwin.diagnosis.days.stretch import Columns, Stretch
from pinotwin.effects.scene import with_model_effort
from pinotwin.signals import runs

POWERS = {"v": -1, "a": -2, "j": -3, "s": -4, "du": -1, "vr": -1, "ar": -2, "jr": -3, "ie": 1}
"""Channel -> power of the clock's scale that it has."""


def recording_rows(asked: Asked) -> list[Row]:
    """Return the rows of what may have become of the log: effort of another run, frozen, late command, odd clock."""
    r, out = asked.r, []
    for name in r.axes:
        if (name, "law") in asked.q.left[0]:
            out += [*_without_effort(asked, name), *_late(asked, name)]
    return [*out, *_clock(asked)]


def _without_effort(asked: Asked, name: str) -> list[Row]:
    """Return the rows of an effort that is none: of another run, or frozen for a while."""
    q, out = asked.q, []
    still = [_frozen(s, name) for s in q.logs]
    whole = [np.ones(len(s.t), dtype=bool) for s in q.logs]
    for cause, rows in (("effort_of_another_run", whole), ("effort_frozen", still)):
        if any(x.any() for x in rows):
            c = cells(asked.r, q.logs, q.left, name, spoilt=Spoilt(rows))
            out.append(_again(asked, cause, name, {name: c}, float("nan"), 5.0))
    return out


def _frozen(s: Stretch, name: str) -> Mask:
    """Return where the effort stands still for a tenth of a second and more, (n,)."""
    u = s.motion.u[:, s.motion.names.index(name)]
    t = s.motion.t - s.motion.t[0]
    out = np.zeros(len(s.t), dtype=bool)
    for x in runs(np.diff(u) == 0.0):
        begin, end = t[x.start + 1], t[min(x.stop + 1, len(t) - 1)]
        if end - begin > 0.1:
            out |= (s.t > begin - 0.06) & (s.t < end + 0.06)
    return out


def limit_rows(asked: Asked) -> list[Row]:
    """Return the rows of drives at their limit: the effort stays behind what the law asks, and its integral stands."""
    out = []
    for name in asked.r.axes:
        if (name, "law") not in asked.q.left[0]:
            continue
        each = [
            _limited(asked.r, s, x[name, "law"], name)
            for s, x in zip(asked.q.logs, asked.q.left, strict=True)
        ]
        if not any(x is not None and x[1].any() for x in each):
            continue
        left, rows, events = [], [], 0
        for x, found in zip(asked.q.left, each, strict=True):
            rest, at = found or (x[name, "law"], np.zeros(len(x[name, "law"]), dtype=bool))
            left.append({**x, (name, "law"): rest})
            rows.append(at)
            events += int(np.sum(np.diff(at.astype(int)) > 0))
        c = cells(asked.r, asked.q.logs, left, name, spoilt=Spoilt(rows, measured=True))
        spans = [
            (k, float(s.t[x.start]), float(s.t[x.stop - 1]))
            for k, (s, at) in enumerate(zip(asked.q.logs, rows, strict=True))
            for x in runs(at)
        ]
        since = [min(a for n, a, _ in spans if n == k) for k in sorted({n for n, _, _ in spans})]
        level = float(np.median([_held(asked.q.logs[k], name, a, b) for k, a, b in spans]))
        row = _again(asked, "limit", name, {name: c}, level, SETTINGS.number * events)
        out.append(replace(row, group="limit", since=since, spans=spans))
    return out


def _held(s: Stretch, name: str, a: float, b: float) -> float:
    """Return the size at which the effort stands between two times [N or N·m]."""
    m = s.motion
    rows = (m.t - m.t[0] >= a) & (m.t - m.t[0] <= b)
    return float(np.quantile(np.abs(m.u[rows, m.names.index(name)]), 0.95))


def _limited(r: Reference, s: Stretch, left: Floats, name: str, most: int = 60) -> tuple[Floats, Mask] | None:
    """Return what the law leaves between the times at a limit, and those times; None where it is no limit.

    A drive at its limit does not integrate: after each such time the law is off by another constant.
    """
    w, u = r.whitenings[name, "law"], s.axes[name]["u"]
    high = max(8.0 * w.sigma, 0.01 * float(np.abs(u).max()))
    pad, hold = max(1, int(0.06 / s.step)), max(2, int(0.12 / s.step))
    rest, at, i = left - np.median(left[:hold]), np.zeros(len(left), dtype=bool), 0
    for _ in range(most):
        behind = np.flatnonzero(rest[i:] * np.sign(u[i:]) < -high)
        if not len(behind):
            break
        a = i + int(behind[0])
        b = a
        while b + hold < len(rest) and np.ptp(rest[b : b + hold]) > 0.5 * high:
            b += 1
        at[max(a - pad, 0) : b + pad] = True
        rest[b:] -= np.median(rest[b : b + hold])
        i = min(b + 1, len(rest) - 1)
        if b + hold >= len(rest):
            break
    else:
        return None
    return (rest, at) if at.mean() < 0.4 and _at_limit(s.axes[name], rest, at, high) else None


def _at_limit(c: Columns, left: Floats, at: Mask, slack: float) -> bool:
    """Whether a drive is at a limit ``|u| = L - b |v|``: its effort is nearer to it than to the law, never beyond."""
    u, speed = np.abs(c["u"]), np.abs(c["v"])
    drives = c["u"] * c["v"] > 0.0
    held, later = at & drives, drives & ~at & (np.arange(len(at)) > int(np.argmax(at)))
    if not held.any():
        return True
    X = np.column_stack([np.ones(len(u)), -speed])
    level = X @ nnls(X[held], u[held])[0]
    off = (u - level)[held]
    level += float(np.quantile(off, 0.9)) + slack
    return bool(np.std(off) < np.std(left[held]) and np.sum(u[later] > level[later]) <= 0.01 * later.sum())


def _late(asked: Asked, name: str) -> list[Row]:
    """Return the row of a command that was recorded late by whole samples."""
    cycle = asked.q.logs[0].cycle
    delays = np.arange(-2, 15) * cycle

    def rest(delay: float) -> float:
        each = [asked.r.residuals(_earlier(s, name, delay), [name])[name, "law"] for s in asked.q.logs]
        return float(sum(np.log(np.var(x)) for x in each))

    best = _best(np.asarray(delays, dtype=float), 0.0, rest)
    if not best:
        return []
    logs = [_earlier(s, name, best) for s in asked.q.logs]
    left = [asked.r.residuals(s, [name]) for s in logs]
    c = cells(asked.r, logs, left, name)
    return [_again(asked, "command_late", name, {name: c}, best, SETTINGS.number + 2.0)]


def _best(tried: Floats, healthy: float, rest: Callable[[float], float]) -> float:
    """Return the number that leaves least; only where one beside the healthy one leaves less are all tried."""
    at = int(np.argmin(np.abs(tried - healthy)))
    near = float(min(tried[at - 1 : at + 2], key=rest))
    return near if near == tried[at] else float(min(tried, key=rest))


def _earlier(s: Stretch, name: str, delay: float) -> Stretch:
    """Return a stretch with the command of an axis earlier by a delay [s]."""
    c, later = dict(s.axes[name]), np.clip(s.t + delay, s.t[0], s.t[-1])
    for k in ("vr", "ar", "jr"):
        c[k] = CubicSpline(s.t, c[k])(later)
    command = CubicSpline(s.t, c["qr"])
    c["qr"] = command(later)
    path = command.antiderivative()
    change = c["qr"] - command(s.t)
    c["e"] = c["e"] + change
    # ``ie`` is a sum over rows of the log: half a cycle ahead of the integral.
    c["ie"] = c["ie"] + path(later) + c["qr"] * (s.t + delay - later) - path(s.t) + 0.5 * s.cycle * change
    return replace(s, axes={**s.axes, name: c})


def _clock(asked: Asked) -> list[Row]:
    """Return the row of a clock that runs too fast or too slowly."""
    q = asked.q
    factors = np.r_[np.arange(0.96, 1.0, 0.01), 0.995, 1.0, 1.005, np.arange(1.01, 1.045, 0.01)]

    def rest(f: float) -> float:
        each = [asked.r.residuals(_slower(asked.r, s, f)) for s in q.logs]
        return float(sum(np.log(np.var(x) + 1e-300) for row in each for x in row.values()))

    best = _best(factors, 1.0, rest)
    if best == 1.0:
        return []
    logs = [_slower(asked.r, s, best) for s in q.logs]
    left = [asked.r.residuals(s) for s in logs]
    again = {k: cells(asked.r, logs, left, k) for k in asked.r.axes}
    return [_again(asked, "clock_scale", ALL, again, best, SETTINGS.number + 2.0)]


def _slower(r: Reference, s: Stretch, factor: float) -> Stretch:
    """Return a stretch whose clock is slower by a factor."""
    if factor == 1.0:
        return s
    m = replace(s.motion, v=s.motion.v / factor, a=s.motion.a / factor**2)
    m = with_model_effort(m, r.twin.effects, r.twin.theta)
    left = s.taken(np.nan_to_num(m.u - r.twin.effort(m)))
    axes = {}
    for name, c in s.axes.items():
        found = {k: x * factor ** POWERS.get(k, 0) for k, x in c.items()}
        axes[name] = {**found, "left": left[:, m.names.index(name)]}
    return replace(s, axes=axes)


def _again(
    asked: Asked, cause: str, axis: str, again: Mapping[str, Mapping[str, Cells]], number: float, price: float
) -> Row:
    """Return the row of a transform from the cells that it leaves: gains of equations, each per cell that is there."""
    by, closed = {"day": 0.0}, dict[str, float]()
    logs, every = np.zeros(len(asked.q.logs)), list[Floats]()
    for name, each in again.items():
        for equation, c in each.items():
            before, old = asked.base[name, equation], asked.cells[name][equation]
            after = score([(c, np.zeros(0, dtype=np.intp))], 0)
            new, was = after.held[0], before.held[0]
            by["day"] += after.cost - before.cost
            was_open, is_open = opened(old, was), opened(c, new)
            closed[equation] = (was_open - is_open) / max(was_open - 1.0, 0.1)
            by[equation] = by.get(equation, 0.0) + float(new.sum() - was.mean() * len(new))
            for k in range(len(logs)):
                a, b = c.log == k, old.log == k
                if a.any() and b.any():
                    logs[k] += float(new[a].sum() - was[b].mean() * a.sum())
            if len(new) == len(was):
                every.append(new - was)
    gains = np.concatenate(every) if every else np.zeros(1)
    return Row(
        name=cause,
        axis=axis,
        group="recording",
        score=sum(by.values()) - price,
        by=by,
        price=price,
        count=1,
        theta=number,
        error=float("nan"),
        z=10.0,
        worth=1.0,
        logs=[float(x) for x in logs],
        closed=closed,
        positive=positive(gains) if every else 1.0,
        spread=spread(gains),
    )
