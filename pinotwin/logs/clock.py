"""The clock of a log made even: held rows, skipped rows and scattered stamps are told from the motion.

A program that writes the latest values scatters stamps, doubles and loses samples, but positions still advance by
multiples of ``v T``; a logger of uneven times gives positions smooth over its stamps. The clock over which they are
smoother is taken, even rows where neither is. Gaps of a sample or two are bridged and counted, longer ones left open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.signals import clock, lagrange_error, runs

_WINDOW = 21  # rows over which the velocity is taken
_PASSES = 4  # of velocity and ticks


@dataclass(frozen=True)
class _Ticks:
    """When each row was sampled, in steps of an even clock."""

    at: Floats  # tick of every row, increasing within a part, NaN for a row that repeats its sample, (n,)
    parts: tuple[slice, ...]  # unbroken stretches of rows
    step: float  # of the clock [s]


def even_clock(log: Log, axes: Sequence[str], settings: Settings = USUAL) -> Log:
    """Return a bound log on an even clock, told by the positions of ``axes``, short holes bridged; its notes say so."""
    stamped = np.isfinite(log.t)
    even = log if stamped.all() else log.rows(stamped)
    try:
        said = clock(even.t)
    except DataError:  # refused with its channel where the log's stretches are taken
        return log
    steps = np.diff(even.t) / said.step
    if np.mean((steps < 0.5) | (steps > 1.5)) > settings.no_clock:
        return log  # refused there too
    notes: list[str] = []
    if not stamped.all():
        notes.append(f"t: {int((~stamped).sum())} rows without a stamp left out")
    ticks = _by_index(even.t, said.step, settings.bridged)
    remade = said.jitter_rms > settings.jitter * said.step
    if remade:
        ticks, remade, told = _told(even, axes, ticks, said.jitter_rms, settings.smoother)
        notes.append(told)
    even = _at_ticks(even, ticks, remade, notes, settings.bridged)
    return _filled(even, notes, settings.bridged)


def _by_index(t: Floats, step: float, bridged: int) -> _Ticks:
    """Return the ticks if every row is the next sample, but for whole gaps."""
    dt = np.diff(t)
    edges = [0, *(np.flatnonzero((dt <= 0.0) | (dt > (bridged + 1.5) * step)) + 1).tolist(), len(t)]
    parts = tuple(slice(a, b) for a, b in pairwise(edges))
    at = _sum(np.maximum(1.0, np.round(dt / step)), parts, len(t))
    ticks = sum(at[p.stop - 1] for p in parts)
    mean = sum(t[p.stop - 1] - t[p.start] for p in parts) / ticks if ticks else step
    return _Ticks(at, parts, float(mean))


def _sum(advance: Floats, parts: Sequence[slice], n: int) -> Floats:
    at = np.zeros(n)
    for part in parts:
        at[part.start + 1 : part.stop] = np.cumsum(advance[part.start : part.stop - 1])
    return at


def _told(
    log: Log, axes: Sequence[str], index: _Ticks, jitter: float, smoother: float
) -> tuple[_Ticks, bool, str]:
    """Return the ticks over which the positions are smoothest, whether stamps are remade, and a note."""
    t, step = log.t, index.step
    q = np.column_stack([_known(log[f"{name}.q"]) for name in axes])
    q = (q - q.mean(axis=0)) / np.maximum(q.std(axis=0), 1e-12)
    stamps = _Ticks(_sum(np.diff(t) / step, index.parts, len(t)), index.parts, step)
    moved = _by_motion(t, q, index, smoother)
    rough = {name: _roughness(q, x) for name, x in (("rows", index), ("stamps", stamps), ("motion", moved))}
    scatter = f"t: stamps scatter by {100 * jitter / step:.2g} % of a step"
    if rough["rows"] <= smoother * rough["stamps"] and rough["rows"] <= 1.5 * rough["motion"]:
        return index, True, f"{scatter} around an even clock, estimated from the motion and used"
    if moved is not None and rough["motion"] <= smoother * min(rough["rows"], rough["stamps"]):
        held = int(np.isnan(moved.at).sum())
        found = f"the motion shows a clock of {1.0 / moved.step:.4g} Hz below, which was used"
        return moved, True, f"{scatter}; {found} ({held} rows repeat a sample)"
    if rough["stamps"] <= smoother * rough["rows"]:
        rate = f"interpolated to an even clock of {1.0 / step:.4g} Hz"
        return stamps, True, f"{scatter} and so does the motion: {rate}"
    return index, False, f"{scatter}; the motion shows no better clock, rows are taken as evenly sampled"


def _known(x: Floats) -> Floats:
    """Return a channel with its missing values interpolated: to tell the clock by, nothing else."""
    good = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(len(x)), good, x[good]) if len(good) else np.zeros(len(x))


def _by_motion(t: Floats, q: Floats, index: _Ticks, smoother: float, whole: float = 0.15) -> _Ticks | None:
    """Return the ticks by which the positions (n, k) advance, or None if their median is ``whole`` off whole ones."""
    step = index.step
    at = _sum(np.diff(t) / step, index.parts, len(t))
    for _ in range(_PASSES):  # velocity and step are those of the clock found before
        away = np.concatenate([_advance(at, q, part, np.diff(t[part]) / step) for part in index.parts])
        if not len(away) or np.median(away) > whole:
            return None
        slopes = [np.polyfit(at[p], t[p], 1)[0] for p in index.parts if p.stop - p.start > _WINDOW]
        sizes = [p.stop - p.start for p in index.parts if p.stop - p.start > _WINDOW]
        step = float(np.average(slopes, weights=sizes))
    for part in index.parts:
        at[part][1:][np.diff(at[part]) < 0.25] = np.nan
        _settle(at[part], q[part], smoother)
    return _Ticks(at, index.parts, step)


def _settle(at: Floats, q: Floats, smoother: float, stands_out: float = 100.0) -> None:
    """Move, in place, what follows a skip by a tick or two where that makes the positions (n, k) far smoother."""
    kept = np.flatnonzero(np.isfinite(at))
    if len(kept) <= _WINDOW:
        return
    usual = float(np.median(np.sum(lagrange_error(at[kept], q[kept]) ** 2, axis=1)))
    for _ in range(_PASSES):
        moved = False
        for k in np.flatnonzero(np.diff(at[kept]) > 1.5):
            near = kept[max(0, k - 3) : k + 5]
            later = near > kept[k]
            shifts = [s for s in (0.0, 1.0, -1.0, 2.0, -2.0) if at[kept[k + 1]] - at[kept[k]] + s > 0.5]
            rough = [float(np.sum(lagrange_error(at[near] + s * later, q[near]) ** 2)) for s in shifts]
            best = int(np.argmin(rough)) if len(near) > 4 else 0  # a cubic passes through any four
            if rough[0] > stands_out * usual and rough[best] < smoother**2 * rough[0]:
                at[kept[k + 1] :] += shifts[best]
                moved = True
        if not moved:
            return


def _advance(at: Floats, q: Floats, part: slice, stamped: Floats) -> Floats:
    """Put into ``at`` by how many ticks rows advance, slow ones by stamps; return the distance from whole ones."""
    if part.stop - part.start <= _WINDOW:
        return np.zeros(0)
    slope = scipy.signal.savgol_filter(np.column_stack([q[part], at[part]]), _WINDOW, 3, deriv=1, axis=0)
    v = slope[:, :-1] / np.maximum(slope[:, -1:], 0.1)
    v = 0.5 * (v[1:] + v[:-1])
    power = np.sum(v**2, axis=1)
    fast = power > 0.05**2 * power.max(initial=0.0)  # slower rows do not tell their tick
    steps = np.sum(v * np.diff(q[part], axis=0), axis=1) / np.maximum(power, 1e-300)
    whole = np.maximum(np.round(steps), 0.0)
    at[part.start + 1 : part.stop] = np.cumsum(np.where(fast, whole, stamped))
    return np.abs(steps - np.round(steps))[fast]


def _roughness(q: Floats, ticks: _Ticks | None) -> float:
    """Return the RMS deviation of positions (n, k) from a cubic through their four neighbours."""
    if ticks is None:
        return np.inf
    errors = []
    for part in ticks.parts:
        kept = np.isfinite(ticks.at[part])
        if kept.sum() > 4:
            errors.append(lagrange_error(ticks.at[part][kept], q[part][kept]).ravel())
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) if errors else np.inf


def _at_ticks(log: Log, ticks: _Ticks, remade: bool, notes: list[str], bridged: int) -> Log:
    """Return the log at every tick of its parts; nothing is touched where every row is the next one."""
    grids = [np.arange(np.floor(np.nanmax(ticks.at[part]) + 1e-6) + 1.0) for part in ticks.parts]
    sampled = [np.unique(np.round(x[np.isfinite(x)])) for x in (ticks.at[p] for p in ticks.parts)]
    missing = sum(len(grid) - len(s) for grid, s in zip(grids, sampled, strict=True))
    if not (missing or remade):
        return log
    if missing:
        longest = max(int(np.diff(x).max(initial=1.0)) - 1 for x in sampled)
        notes.append(
            f"t: {missing} missing samples bridged ({100 * missing / len(log):.2g} % of the rows), "
            f"at most {longest} in a row"
        )
    columns: dict[str, list[Floats]] = {name: [] for name in log.channels}
    end = -np.inf
    for part, grid in zip(ticks.parts, grids, strict=True):
        kept = np.isfinite(ticks.at[part])
        at = ticks.at[part][kept]
        for name, x in log.channels.items():
            columns[name].append(_between(at, x[part][kept], grid, name))
        if remade:
            start = log.t[part][kept][0]
            if start > end - 10.0 * ticks.step:  # the break between two parts stays one
                start = max(start, end + (bridged + 2) * ticks.step)
            columns["t"][-1] = start + grid * ticks.step
        end = columns["t"][-1][-1]
    return log.with_channels({name: np.concatenate(x) for name, x in columns.items()})


def _between(at: Floats, x: Floats, grid: Floats, name: str) -> Floats:
    """Return the samples ``x`` of a channel taken at ``at`` on the grid, smooth of a position; missing ones stay."""
    if len(at) == len(grid) and np.array_equal(at, grid):
        return x
    good = np.isfinite(x)
    known = at[good], x[good]
    if good.sum() < 4:
        return np.interp(grid, *known) if good.any() else np.full(len(grid), np.nan)
    smooth = name.endswith((".q", ".qr", ".ql"))
    new = scipy.interpolate.CubicSpline(*known)(grid) if smooth else np.interp(grid, *known)
    if not good.all():
        hole: Mask = np.interp(grid, at, (~good).astype(float)) > 0.0
        new[hole] = np.nan
    return np.asarray(new, dtype=float)


def _filled(log: Log, notes: list[str], bridged: int) -> Log:
    """Return the log with holes of at most ``bridged`` values in a channel bridged."""
    filled = {}
    for name, x in log.channels.items():
        hole = ~np.isfinite(x)
        if name == "t" or not hole.any() or hole.all():
            continue
        short = np.zeros(len(x), dtype=bool)
        for start, stop in ((s.start, s.stop) for s in runs(hole)):
            inner = start >= 4 and stop <= len(x) - 4
            around = slice(start - 2, stop + 2)
            if inner and stop - start <= bridged and hole[around].sum() == stop - start:
                dt = np.diff(log.t[start - 1 : stop + 1])
                short[start:stop] = dt.min() > 0.0 and dt.max() < 1.5 * dt.min()
        if short.any():
            rows, known = np.arange(len(x), dtype=float), ~hole
            new = x.copy()
            new[short] = _between(rows[known], x[known], rows, name)[short]
            filled[name] = new
            notes.append(f"{name}: {int(short.sum())} missing values bridged, at most {bridged} in a row")
    return log.with_channels({**log.channels, **filled}, notes)
