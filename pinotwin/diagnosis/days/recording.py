"""The recording as a suspect: a transform of the log, scored again by the same equations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.data.samples import left_of
from pinotwin.diagnosis.days.evidence import Left, cells
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import ALL, Row
from pinotwin.diagnosis.days.rows import NONE, Asked, positive, spread
from pinotwin.diagnosis.days.score import Cells, opened, score
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.settings import SETTINGS

Told = Mapping[str, Mapping[str, Cells]]
"""Axis -> equation -> cells."""
POWERS = {"v": -1, "a": -2, "j": -3, "s": -4, "du": -1, "vr": -1, "ar": -2, "jr": -3, "ie": 1}
"""Channel -> power of the clock's scale that it has."""
PROOFS = ("rows_lost", "rows_doubled", "rows_held", "interpolated", "command_jitter", "frozen")


def proven(c: Comparison) -> list[dict[str, Any]]:
    """Return what `check` proves of the recording by its rows alone, and not of a twin's own logs, once an axis."""
    news = set(PROOFS).difference(*(x.get("recorded", ()) for x in c.twin.data if c.change))
    found = {(f.code, f.axis): f for one in c.logs for f in one.doubts if f.code in news}.values()
    spans = [dict(zip(("from", "to"), f.span, strict=False)) for f in found]
    return [entry(c, f.code, f.axis or None, 1.0) | span for f, span in zip(found, spans, strict=True)]


def entry(c: Comparison, fault: str, axis: str | None, confidence: float) -> dict[str, Any]:
    """Return a fault of the recording in the form of the contract: of the whole log [s], its size not known."""
    t = c.logs[0].log["t"]
    whole = {"from": float(t[0]), "to": float(t[-1]), "size": None, "unit": None}
    return {"fault": fault, "axis": axis, **whole, "confidence": confidence}


def doubted(recording: Sequence[Mapping[str, Any]], axes: Collection[str]) -> list[str]:
    """Return the axes that faults of the recording are about: of the whole log all."""
    return [x for fault in recording for x in (fault["axis"].split(", ") if fault["axis"] else axes)]


def recording_rows(asked: Asked) -> list[Row]:
    """Return the rows of what may have become of the log: effort of another run, late command, odd clock."""
    r, q, out = asked.r, asked.q, []
    late = np.asarray(np.arange(-2, 15) * q.logs[0].cycle, dtype=float)
    for name in (k for k in r.axes if (k, "law") in q.left[0]):
        other = {name: cells(r, q.logs, q.left, name, read=False)}
        out.append(again("effort_of_another_run", name, (asked.cells, other), float("nan"), 5.0))
        out += _otherwise(asked, name, "command_late", partial(_earlier, name), late)
    factors = np.r_[np.arange(0.96, 1.0, 0.01), 0.995, 1.0, 1.005, np.arange(1.01, 1.045, 0.01)]
    return [*out, *_otherwise(asked, ALL, "clock_scale", partial(_slower, r), factors, 1.0)]


def _otherwise(
    asked: Asked,
    axis: str,
    cause: str,
    changed: Callable[[Stretch, float], Stretch],
    tried: Floats,
    healthy: float = 0.0,
) -> list[Row]:
    """Return the row of a log changed by the number that leaves least; none where that is the healthy one.

    What counts is left of the law of an axis, or of every equation of all.
    """
    names = asked.r.axes if axis == ALL else (axis,)

    def left(number: float) -> tuple[list[Stretch], list[Left]]:
        logs = [changed(s, number) for s in asked.q.logs]
        return logs, [asked.r.residuals(s, names) for s in logs]

    def rest(number: float) -> float:
        parts = [x for each in left(number)[1] for (_, e), x in each.items() if axis == ALL or e == "law"]
        return float(sum(np.log(np.var(x) + 1e-300) for x in parts))

    at = int(np.argmin(np.abs(tried - healthy)))
    if min(tried[max(at - 1, 0) : at + 2], key=rest) == tried[at]:
        return []  # only where one beside the healthy one leaves less are all tried
    best = float(min(tried, key=rest))
    logs, residuals = left(best)
    told = {k: cells(asked.r, logs, residuals, k) for k in names}
    return [again(cause, axis, (asked.cells, told), best, SETTINGS.number + 2.0)]


def _earlier(name: str, s: Stretch, delay: float) -> Stretch:
    """Return a stretch with the command of an axis earlier by a delay [s]."""
    c, later = dict(s.axes[name]), np.clip(s.t + delay, s.t[0], s.t[-1])
    c |= {k: CubicSpline(s.t, c[k])(later) for k in ("vr", "ar", "jr")}
    command = CubicSpline(s.t, c["qr"])
    c["qr"] = command(later)
    path = command.antiderivative()
    change = c["qr"] - command(s.t)
    c["e"] = c["e"] + change
    # ``ie`` is a sum over rows of the log: half a cycle ahead of the integral.
    c["ie"] = c["ie"] + path(later) + c["qr"] * (s.t + delay - later) - path(s.t) + 0.5 * s.cycle * change
    return replace(s, axes={**s.axes, name: c})


def _slower(r: Reference, s: Stretch, factor: float) -> Stretch:
    """Return a stretch whose clock is slower by a factor."""
    if factor == 1.0:
        return s
    m = replace(s.motion, v=s.motion.v / factor, a=s.motion.a / factor**2)
    m, left = left_of(r.twin, m)
    left = s.taken(np.nan_to_num(left))
    axes = {}
    for name, c in s.axes.items():
        found = {k: x * factor ** POWERS.get(k, 0) for k, x in c.items()}
        axes[name] = {**found, "left": left[:, m.names.index(name)]}
    return replace(s, axes=axes)


def again(cause: str, axis: str, cells: tuple[Told, Told], number: float, price: float) -> Row:
    """Return the row of a transform from cells before and after: gains [nats] per cell that is there."""
    by, closed, every = {"day": 0.0}, dict[str, float](), list[Floats]()
    logs = np.zeros(1 + max(int(c.log.max()) for each in cells[0].values() for c in each.values()))
    for name, each in cells[1].items():
        for equation, c in each.items():
            old = cells[0][name][equation]
            before, after = (score([(x, NONE)], 0) for x in (old, c))
            new, was = after.held[0], before.held[0]
            by["day"] += after.cost - before.cost
            was_open, is_open = opened(old, before.left[0]), opened(c, after.left[0])
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
