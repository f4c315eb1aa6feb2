"""What the rows themselves show of recording: rows lost or held, a slower log drawn through, a frozen channel.

Other rows are no measurement: copies of others, jumps to a sentinel, the state they share.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy
from scipy.ndimage import median_filter

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.log import Log
from pinotwin.logs.quality import values
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.signals import runs

FEW, DRAWN = 3, 0.4  # rows beyond chance, and share of them on lines that no measurement has


def recorded_findings(log: Log, axes: Sequence[str], settings: Settings = USUAL) -> Iterator[Finding]:
    """Say what became of a bound log while it was recorded."""
    if "t" not in log or len(log) < 20 or not np.isfinite(log.t).all():
        return
    t, missing, held = log.t, lost_rows(log, axes), held_rows(log)
    line = max((drawn_rows(log[name]) for axis in axes if (name := f"{axis}.u") in log), default=0.0)
    if missing.any():
        places = np.flatnonzero(missing)
        yield finding("rows_lost", count=int(missing.sum()), first=float(t[places[0]]), places=len(places))
    if held > 1:
        yield finding("rows_held", count=held)
    if line > DRAWN:
        yield finding("interpolated", percent=100.0 * line)
    for name in (k for a in axes if (k := f"{a}.qr") in log):
        if (share := command_scatter(t, log[name])) > settings.scatter:
            yield finding("command_jitter", name, percent=100.0 * share)
    for axis in (a for a in axes if f"{a}.u" in log and f"{a}.q" in log):
        for rows in frozen_rows(t, log[f"{axis}.u"], log[f"{axis}.q"]):
            span = float(t[rows.start]), float(t[rows.stop - 1])
            yield replace(finding("frozen", f"{axis}.u", start=span[0], end=span[1]), span=span)


def habits(log: Log, axes: Sequence[str]) -> list[str]:
    """Return the codes of what became of a bound log while it was recorded: its recorder will do it again."""
    return sorted({f.code for f in (*row_findings(log), *recorded_findings(log, axes))})


def lost_rows(log: Log, axes: Sequence[str]) -> Floats:
    """Return how many rows are missing before each, (n,): there all axes step by whole samples on an even clock."""
    steps, out = np.diff(log["t"]), np.zeros(len(log))
    vote, weight = np.zeros(len(steps)), np.zeros(len(steps))
    for name in (f"{a}.qr" if f"{a}.qr" in log else f"{a}.q" for a in axes):
        if name not in log or not np.isfinite(log[name]).all():
            continue
        d = np.diff(log[name])
        around = median_filter(d, 7, mode="nearest")
        speed = np.abs(around)
        fast = speed > 0.1 * np.quantile(speed, 0.99)
        scale = speed[fast] / max(float(speed.max()), 1e-300)
        vote[fast] += scale * (d[fast] / around[fast] - 1.0)
        weight[fast] += scale
    jump = np.where(weight > 0.0, vote / np.maximum(weight, 1e-300), 0.0)
    whole, even = np.round(jump), steps < 1.5 * float(np.median(steps))
    longer = even & (whole >= 1.0) & (whole <= 50.0) & (np.abs(jump - whole) < 0.3)
    odd = int(np.sum(np.abs(jump) > 0.3)) - int(longer.sum())
    if longer.sum() >= FEW and longer.sum() > 4 * odd:
        out[1:][longer] = whole[longer]
    return out


def held_rows(log: Log) -> int:
    """Return for how many rows every measurement is held while a command moves on; 1 where none is."""
    commands = [k for k in log.channels if k.endswith(".qr")]
    measured = [k for k in log.channels if k != "t" and k not in commands]
    moved = {k: np.diff(x, prepend=np.nan) != 0.0 for k, x in log.channels.items()}
    none = np.zeros(len(log), dtype=bool)
    asked, new = (np.any([none, *(moved[k] for k in names)], axis=0) for names in (commands, measured))
    share = float(new[asked].mean()) if asked.sum() > 20 else 1.0
    return round(1.0 / share) if 0.15 < share < 0.7 else 1


def drawn_rows(x: Floats) -> float:
    """Return the share of rows that lie on the line between their neighbours while a channel (n,) changes."""
    bend, moves = np.abs(np.diff(x, 2)), np.abs(np.diff(x))[1:] > 0.0
    return float(np.mean((bend < 1e-6 * np.std(x)) & moves))


def command_scatter(t: Floats, command: Floats) -> float:
    """Return the scatter of a command's steps from row to row over a step [1]; 0 where a clock tells nothing of it.

    A fifth difference passes what changes from row to row; of a motion hardly anything, but in a slow log.
    """
    step, size = np.diff(t), np.abs(np.diff(command))
    pace = median_filter(size, 7, mode="nearest")[2:-2]
    rows = pace > 0.1 * np.quantile(size, 0.99)
    if np.median(step) > 1.0 / USUAL.slow_rate or np.ptp(step) > 0.1 * np.median(step) or rows.sum() < 20:
        return 0.0
    bend = np.abs(np.diff(command, 5))[rows] / pace[rows]
    return float(np.median(bend) / (0.6745 * np.sqrt(252.0)))


def frozen_rows(t: Floats, x: Floats, q: Floats, shortest: float = 0.1) -> Iterator[slice]:
    """Yield where a channel (n,) stands still for long [s] while its axis moves on, longer than chance has it."""
    low, high = float(x.min()), float(x.max())
    if not min(high - low, np.ptp(q)) > 0.0:
        return
    same = np.abs(np.diff(x, prepend=np.inf)) <= 1e-9 * (high - low)
    stretches, alike, reach = runs(same), int(same.sum()), 0.01 * np.ptp(q)
    for rows in stretches:
        n, value = rows.stop - rows.start, x[rows.start]
        usual = (alike - n + 1.0) / (len(x) - n + 2.0)  # share of other rows alike: most of a coarse effort
        long = t[rows.stop - 1] - t[rows.start] >= shortest and usual < 0.5 and len(x) * usual**n < 1e-6
        back = long and value in (low, high) and sum(x[other.start] == value for other in stretches) > 1
        if long and np.ptp(q[rows]) > reach and not back:  # a drive comes back to its limit
            yield slice(rows.start - 1, rows.stop)


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
    copies, stale = values.repeated_rows(np.column_stack([np.nan_to_num(x) for x in measured.values()]))
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
    """Return the rows where nothing moves, or is told to move much: what an encoder says there, it may say again."""
    rest = np.ones(len(next(iter(measured.values()))), dtype=bool)
    for name, x in measured.items():
        if name.endswith(".q"):
            stands = _span(x) <= 3.0 * (values.quantisation_step(x) or 0.0) + 1e-12
            if f"{name}r" in measured:  # a command at less than a tenth of its top speed
                pace = _span(measured[f"{name}r"], 5)
                stands |= pace <= 0.1 * pace.max()
            rest &= stands
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
    varied = {name: x for name, x in log.channels.items() if name != "t" and values.has_more_values(x, 1)}
    numbers = {name: x for name, x in varied.items() if values.has_more_values(x, measured)}
    return numbers, {name: x for name, x in varied.items() if name not in numbers}


def _jumps(log: Log, name: str, bad: Mask, settings: Settings, leaps: int = 3) -> Iterator[Finding]:
    """Say where a position jumps, and mark those rows in ``bad``; a few leaps are not worth a word."""
    q = log.raw(name)
    found = values.sentinel(q)
    if found is not None:
        value, times, rows = found
        bad |= rows
        said = finding("sentinel", name, value=value, times=times, rows=int(rows.sum()), key=_key(log, rows))
        yield said if rows.mean() > settings.spoiled else replace(said, code="spikes")
        return
    apart = values.jump_rows(q)
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
