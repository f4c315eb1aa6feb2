"""What the rows themselves show of recording: rows lost or held, a slower log drawn through, a frozen channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.ndimage import median_filter

from pinotwin.arrays import Floats
from pinotwin.log import Log
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.signals import runs

FEW, DRAWN = 3, 0.4  # rows beyond chance, and share of them on lines that no measurement has


def recorded_findings(log: Log, axes: Sequence[str]) -> Iterator[Finding]:
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
    for axis in (a for a in axes if f"{a}.u" in log and f"{a}.q" in log):
        for rows in frozen_rows(t, log[f"{axis}.u"], log[f"{axis}.q"]):
            yield finding("frozen", f"{axis}.u", start=float(t[rows.start]), end=float(t[rows.stop - 1]))


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
