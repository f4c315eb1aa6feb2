"""Rows that are no measurement: copies of others, jumps to a sentinel, the state they share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.log import Log
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.quality.values import (
    has_more_values,
    jump_rows,
    quantisation_step,
    repeated_rows,
    sentinel,
)
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.signals import runs

_FEW = 5  # rows over which a rounded position shows which way it moves


def row_findings(log: Log, settings: Settings = USUAL) -> Iterator[Finding]:
    """Say which rows are not to be trusted."""
    measured, states = _kinds(log)
    bad = np.zeros(len(log), dtype=bool)
    if len(measured) > 2:
        yield from _repeats(log, measured, bad, settings)
    for name in measured:
        if name.endswith(".q"):
            yield from _jumps(log, name, bad, settings)
        elif name.endswith(".u"):
            yield from _effort_sentinel(log, name, bad)
    yield from _shared_state(states, bad)


def _repeats(log: Log, measured: dict[str, Floats], bad: Mask, settings: Settings) -> Iterator[Finding]:
    """Say which rows repeat others, and mark copies in ``bad``; of three channels a copy elsewhere may be chance."""
    copies, stale = repeated_rows(np.column_stack([np.nan_to_num(x) for x in measured.values()]))
    rest, many, enough = _at_rest(measured), stale.mean() > settings.oversampled, len(measured) > 3
    twice = np.flatnonzero(stale & ~rest)
    if len(twice) > 2 and not many and "t" in log:
        yield finding("rows_doubled", count=len(twice), first=float(log.t[twice[0]]))
    if many and enough:
        yield finding("stale_rows", count=int(stale.sum()), rows=len(log))
    fresh = copies & ~stale & ~rest
    if fresh.mean() > settings.spoiled and enough:
        bad |= copies
        said = {"channels": len(measured), "key": _key(log, copies)}
        yield finding("copied_rows", count=int(fresh.sum()), rows=len(log), **said)


def _at_rest(measured: dict[str, Floats]) -> Mask:
    """Return the rows where nothing moves, or is told to: what an encoder says there, it may say again."""
    rest = np.ones(len(next(iter(measured.values()))), dtype=bool)
    for name, x in measured.items():
        if name.endswith(".q"):
            stands = _span(x) <= 3.0 * (quantisation_step(x) or 0.0) + 1e-12
            command = measured.get(f"{name}r")
            rest &= stands if command is None else stands | (_span(command) == 0.0)
    return rest


def _span(x: Floats, rows: int = 21) -> Floats:
    return np.asarray(scipy.ndimage.maximum_filter1d(x, rows) - scipy.ndimage.minimum_filter1d(x, rows))


def _key(log: Log, rows: Mask) -> str:
    """Return the key of machine.yaml that leaves these rows out, with the first few of their times [s]."""
    if "t" not in log:
        return ""
    times = [f"[{log.t[s.start]:.6g}, {log.t[s.stop - 1]:.6g}]" for s in runs(rows)]
    more = ", ..." if len(times) > 4 else ""
    return f" (data: {{leave_out: [{', '.join(times[:4])}{more}]}})"


def _kinds(log: Log, measured: int = 20) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the channels with more distinct values than a state has, and those that change at all."""
    varied = {name: x for name, x in log.channels.items() if name != "t" and has_more_values(x, 1)}
    numbers = {name: x for name, x in varied.items() if has_more_values(x, measured)}
    return numbers, {name: x for name, x in varied.items() if name not in numbers}


def _jumps(log: Log, name: str, bad: Mask, settings: Settings, leaps: int = 3) -> Iterator[Finding]:
    """Say where a position jumps, and mark those rows in ``bad``; a few leaps are not worth a word."""
    q = log.raw(name)
    found = sentinel(q)
    if found is not None:
        value, times, rows = found
        bad |= rows
        said = finding("sentinel", name, value=value, times=times, rows=int(rows.sum()), key=_key(log, rows))
        yield said if rows.mean() > settings.spoiled else replace(said, code="spikes")
        return
    apart = jump_rows(q)
    bad |= apart
    if apart.any():
        where = {"count": int(apart.sum()), "first": int(np.argmax(apart))}
        yield finding("spikes", name, **where, key=_key(log, apart))
    turns = _within_stretches(log, _wraps(q))
    if len(turns):
        value, usual = _range(q, turns)
        said_range = f"`wrap: {value:.10g}`" if usual else f"`wrap:` (about {value:.3g})"
        yield finding("wraps", name, count=len(turns), first=turns[0], name=name, range=said_range)
    rest = np.setdiff1d(_within_stretches(log, _leaps(q)), turns)
    if len(rest) >= leaps and not apart.any():
        size = float(np.abs(q[rest] - q[rest - 1]).max())
        yield finding("leaps", name, count=len(rest), first=rest[0], size=size)


def _within_stretches(log: Log, rows: Ints) -> Ints:
    """Return those rows that follow the one before in time: across a gap of the clock a position may be anywhere."""
    if "t" not in log or not len(rows):
        return rows
    step = np.abs(np.diff(log.t, prepend=log.t[:1]))
    return rows[step[rows] < 5.0 * np.nanmedian(step)]


def _effort_sentinel(log: Log, name: str, bad: Mask) -> Iterator[Finding]:
    """Name a value far beyond all others that comes again and again: efforts jump, sentinels stand apart."""
    u = log.raw(name)
    for value in (np.nanmin(u), np.nanmax(u)):
        rows = np.asarray(u == value)
        count = np.count_nonzero(rows)
        others = np.abs(u[~rows & np.isfinite(u)])
        if count >= 3 and len(others) and abs(value) > 3.0 * others.max() > 0:
            bad |= rows
            said = finding("effort_sentinel", name, value=value, rows=int(count), key=_key(log, rows))
            yield replace(said, code="sentinel")


def _wraps(q: Floats) -> Ints:
    """Return the rows before which a position jumps by its range, against the way it moves over one row or a few."""
    rows = _against(q, 1)
    rounded = np.union1d(rows, _against(q, _FEW))
    return rounded if len(rounded) and _range(q, rounded)[1] else rows


def _against(q: Floats, k: int) -> Ints:
    """Return the rows before which a position jumps by its range against its motion over k rows before and after."""
    before, jump, after, fastest, span = _about(q, k)
    against = (before * after > 0) & (before * jump < 0)
    return np.flatnonzero((np.abs(jump) > 0.75 * span) & against & (fastest < 0.2 * span)) + k + 1


def _about(q: Floats, k: int) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Return the change over k rows before every row, to it, and after it; the larger of the outer two; the range."""
    span = float(np.nanmax(q) - np.nanmin(q))
    q = q if len(q) >= 2 * k + 2 else q[:0]
    before, after = q[k : -k - 1] - q[: -2 * k - 1], q[2 * k + 1 :] - q[k + 1 : -k]
    return before, q[k + 1 : -k] - q[k : -k - 1], after, np.maximum(np.abs(before), np.abs(after)), span


def _range(q: Floats, turns: Ints) -> tuple[float, bool]:
    """Return the range of a counter that wraps before these rows, in the unit of ``q``, and whether it is usual."""
    inside = turns[(turns >= _FEW + 1) & (turns + _FEW < len(q))]
    rows = inside if len(inside) else turns
    jump = q[rows] - q[rows - 1]
    if len(inside):
        jump -= (q[rows - 1] - q[rows - 1 - _FEW] + q[rows + _FEW] - q[rows]) / (2 * _FEW)
    found = float(np.abs(jump).max())  # rows lost at a turn make a jump smaller, never larger
    decimals = 10.0 ** -np.arange(10)
    turn = [360.0, 2.0 * np.pi, 2e3 * np.pi, 400.0, 1.0, 3.6e5, 1.296e6]
    usual = np.concatenate([turn, 2.0**16 * decimals, 2.0**32 * decimals])
    near = float(usual[np.argmin(np.abs(np.log(usual / found)))])
    return (near, True) if abs(near / found - 1.0) < 0.01 else (found, False)


def _leaps(q: Floats) -> Ints:
    """Return the rows before which a position that moves steadily is suddenly elsewhere and moves on."""
    before, jump, after, fastest, span = _about(q, _FEW)
    steady = (before * after > 0) & (fastest < 2.0 * np.minimum(np.abs(before), np.abs(after)))
    bound = np.maximum(20.0 * fastest / _FEW, 0.01 * span)
    return np.flatnonzero(steady & (np.abs(jump) > bound)) + _FEW + 1


def _shared_state(states: dict[str, Floats], bad: Mask) -> Iterator[Finding]:
    """Name a state (a feed rate, a program number) that most of the bad rows have in common."""
    if not bad.any():
        return
    for name, x in states.items():
        for value in np.unique(x[np.isfinite(x)]):
            rows = x == value
            recall = float(np.mean(rows[bad]))
            precision = float(np.mean(bad[rows]))
            if recall > 0.8 and precision > max(0.5, 1.05 * bad.mean()):
                said = {"value": value, "rows": int(rows.sum())}
                yield finding("bad_state", name, percent=100 * recall, name=name, **said)
