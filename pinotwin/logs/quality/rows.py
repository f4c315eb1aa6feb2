"""Rows that are no measurement: copies of others, jumps to a sentinel, the state they share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.log import Log
from pinotwin.logs.quality.results import Finding
from pinotwin.logs.quality.values import (
    has_more_values,
    jump_rows,
    quantisation_step,
    repeated_rows,
    sentinel,
)
from pinotwin.signals import runs

_MEASURED = 20  # a channel with more distinct values than this is a measurement, else a state
_FEWEST = 4  # measured channels, below which a copied row may be chance
_SHARE = 0.02  # of the rows, from which copies or sentinels spoil a log as a whole
_ABOUT = 21  # rows about one that must stand still


def row_findings(log: Log) -> Iterator[Finding]:
    """Say which rows are not to be trusted."""
    measured, states = _kinds(log)
    bad = np.zeros(len(log), dtype=bool)
    if len(measured) >= _FEWEST:
        table = np.column_stack([np.nan_to_num(x) for x in measured.values()])
        copies, stale = repeated_rows(table)
        if stale.mean() > _SHARE:
            yield Finding(
                "warning",
                "",
                f"{int(stale.sum())} of {len(log)} rows repeat the row before in every measured "
                "channel: the log is sampled faster than the controller renews its values; log at "
                "its rate",
                "stale_rows",
            )
        fresh = copies & ~stale & ~_at_rest(measured)
        if fresh.mean() > _SHARE:
            bad |= copies
            yield Finding(
                "warning",
                "",
                f"{int(fresh.sum())} of {len(log)} rows are exact copies of other rows in all "
                f"{len(measured)} measured channels: sentinel or replayed rows, "
                f"leave them out{_key(log, copies)}",
                "copied_rows",
            )
    for name in measured:
        if name.endswith(".q"):
            yield from _jumps(log, name, bad)
        elif name.endswith(".u"):
            yield from _effort_sentinel(log, name, bad)
    yield from _shared_state(states, bad)


def _at_rest(measured: dict[str, Floats]) -> Mask:
    """Return the rows about which no position moves: what an encoder says there, it may say again."""
    rest = np.ones(len(next(iter(measured.values()))), dtype=bool)
    for name, x in measured.items():
        if name.endswith(".q"):
            span = maximum_filter1d(x, _ABOUT) - minimum_filter1d(x, _ABOUT)
            rest &= span <= 3.0 * (quantisation_step(x) or 0.0) + 1e-12
    return rest


def _key(log: Log, rows: Mask, most: int = 4) -> str:
    """Return the key of machine.yaml that leaves these rows out, with the first few of their times [s]."""
    if "t" not in log:
        return ""
    times = [f"[{log.t[s.start]:.6g}, {log.t[s.stop - 1]:.6g}]" for s in runs(rows)]
    more = ", ..." if len(times) > most else ""
    return f" (data: {{leave_out: [{', '.join(times[:most])}{more}]}})"


def _kinds(log: Log) -> tuple[dict[str, Floats], dict[str, Floats]]:
    measured, states = {}, {}
    for name, x in log.channels.items():
        if name != "t":
            if has_more_values(x, _MEASURED):
                measured[name] = x
            elif has_more_values(x, 1):
                states[name] = x
    return measured, states


def _jumps(log: Log, name: str, bad: Mask) -> Iterator[Finding]:
    """Say where a position jumps, and mark those rows in ``bad``."""
    q = log.raw(name)
    found = sentinel(q)
    if found is not None:
        value, times, rows = found
        bad |= rows
        yield Finding(
            "warning",
            name,
            f"jumps to {value:.6g} (as in the file) and back {times} times: a sentinel value; "
            f"leave the {int(rows.sum())} rows with it out{_key(log, rows)}",
            "sentinel" if rows.mean() > _SHARE else "spikes",
        )
        return
    apart = jump_rows(q)
    bad |= apart
    if apart.any():
        yield Finding(
            "warning",
            name,
            f"stands apart from the rows before and after in {int(apart.sum())} rows, first "
            f"{int(np.argmax(apart))}: lost or garbled values; leave these rows out"
            f"{_key(log, apart)}",
            "spikes",
        )
    turns = _wraps(q)
    if "t" in log and len(turns):  # across a gap of the clock a position may be anywhere
        step = np.abs(np.diff(log.t, prepend=log.t[:1]))
        turns = turns[step[turns] < 5.0 * np.nanmedian(step)]
    if len(turns):
        yield Finding(
            "warning",
            name,
            f"wraps around {len(turns)} times, first at row {turns[0]}; unwrap it before use",
            "wraps",
        )


def _effort_sentinel(log: Log, name: str, bad: Mask) -> Iterator[Finding]:
    """Name a value far beyond all others that comes again and again: efforts jump, sentinels stand apart."""
    u = log.raw(name)
    for value in (np.nanmin(u), np.nanmax(u)):
        rows = np.asarray(u == value)
        count = np.count_nonzero(rows)
        others = np.abs(u[~rows & np.isfinite(u)])
        if count >= 3 and len(others) and abs(value) > 3.0 * others.max() > 0:
            bad |= rows
            yield Finding(
                "warning",
                name,
                f"is {value:.6g} (as in the file) in {int(count)} rows, far beyond all others: a sentinel "
                f"value; leave these rows out{_key(log, rows)}",
                "sentinel",
            )


def _wraps(q: Floats) -> Ints:
    """Return the rows before which a position jumps by its range, against the way it is moving."""
    step = np.diff(q)
    span = np.nanmax(q) - np.nanmin(q)
    before, jump, after = step[:-2], step[1:-1], step[2:]
    against = (before * after > 0) & (before * jump < 0)
    small = np.maximum(np.abs(before), np.abs(after)) < 0.2 * span
    return np.flatnonzero((np.abs(jump) > 0.75 * span) & against & small) + 2


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
                yield Finding(
                    "warning",
                    name,
                    f"{100 * recall:.0f} % of the untrustworthy rows have {name} = {value:g}; "
                    f"leave all {int(rows.sum())} rows with that value out "
                    f"(data: {{leave_out: [{{{name}: {value:g}}}]}})",
                    "bad_state",
                )
