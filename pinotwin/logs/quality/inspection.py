"""Inspect a log before anything is fitted: tables per channel and axis, findings with a remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.clock import even_clock
from pinotwin.logs.quality.axes import axis_findings, inspect_axes
from pinotwin.logs.quality.results import ChannelQuality, Finding, Limits, Quality
from pinotwin.logs.quality.rows import row_findings
from pinotwin.logs.quality.sampling import clock_findings
from pinotwin.logs.quality.values import quantisation_step, saturated_rows, significant_digits
from pinotwin.signals import Clock, clock

_COARSE = 500  # steps over the range
_HOLES = re.compile(r": (\d+) missing (?:or infinite )?values, first in ")  # a reader's note
_ORDER = {"error": 0, "warning": 1, "info": 2}


def inspect(log: Log, axes: Mapping[str, bool], limits: Mapping[str, Limits] | None = None) -> Quality:
    """Return what a log in the names of the contract is worth.

    Args:
        log: bound log (SI).
        axes: axis -> whether it is rotary.
        limits: axis -> what it can do, if known.
    """
    findings: list[Finding] = []
    ticks = _clock(log, findings)
    channels = {name: _channel(log, name) for name in log.channels if name != "t"}
    for name, channel in channels.items():
        findings += _channel_findings(log, name, channel)
    findings += _digit_findings(channels)
    table, cutoff = inspect_axes(*_even(log, axes, ticks))
    findings += axis_findings(log, axes, table, channels, limits or {}, ticks)
    rows = list(row_findings(log))
    torn = {f.channel for f in rows if f.code in ("wraps", "leaps")}
    findings = [f for f in findings if not (f.code == "speed_limit" and f.channel in torn)] + rows
    findings += [Finding("info", "", note) for note in _untold(log.notes, findings)]
    findings.sort(key=lambda f: _ORDER[f.severity])
    stamps = log.t[np.isfinite(log.t)] if "t" in log else np.zeros(1)
    return Quality(
        source=log.source,
        rows=len(log),
        duration=float(stamps[-1] - stamps[0]) if len(stamps) else 0.0,
        clock=ticks,
        cutoff=cutoff,
        channels=channels,
        axes=table,
        findings=tuple(findings),
    )


def _untold(notes: Iterable[str], findings: Iterable[Finding]) -> Iterator[str]:
    """Yield what the reader noticed but for the holes that findings tell of, under the names of the contract."""
    told = {f.message.split()[0] for f in findings if f.code in ("missing", "clock_holes")}
    for note in dict.fromkeys(notes):
        holes = _HOLES.search(note)
        if holes is None or holes[1] not in told:
            yield note


def _even(
    log: Log, axes: Mapping[str, bool], ticks: Clock | None
) -> tuple[Log, Mapping[str, bool], Clock | None]:
    """Return what the axes are inspected with: the log on an even clock, as preparation takes it."""
    present = [name for name in axes if f"{name}.q" in log]
    if ticks is None or not present:
        return log, axes, ticks
    even = even_clock(log, present)
    return even, axes, clock(even.t)


def _clock(log: Log, findings: list[Finding]) -> Clock | None:
    if "t" not in log:
        remedy = "map its column, or give `t: {rate: ...}`, under columns in machine.yaml"
        findings.append(Finding("error", "t", f"no time channel; {remedy}", "clock_missing"))
        return None
    missing = int((~np.isfinite(log.t)).sum())
    if missing:
        findings.append(
            Finding("warning", "t", f"{missing} stamps are missing; the log is cut there", "clock_holes")
        )
    try:
        ticks = clock(log.t)
    except DataError as error:
        findings.append(Finding("error", "t", str(error), "clock_stands"))
        return None
    findings += clock_findings(ticks, len(log))
    return ticks


def _channel(log: Log, name: str) -> ChannelQuality:
    x = log[name]
    good = x[np.isfinite(x)]
    factor = abs(log.scale.get(name, (1.0, 0.0))[0])
    raw = log.raw(name)
    step = quantisation_step(raw)
    saturated = name.endswith(".u") and saturated_rows(raw)
    return ChannelQuality(
        missing=len(x) - len(good),
        low=float(good.min()) if len(good) else float("nan"),
        high=float(good.max()) if len(good) else float("nan"),
        constant=len(good) > 0 and bool(np.ptp(good) == 0),
        step=None if step is None else step * factor,
        digits=significant_digits(raw),
        saturated=float(np.mean(saturated)),
    )


def _channel_findings(log: Log, name: str, c: ChannelQuality) -> Iterator[Finding]:
    if c.missing == len(log):
        yield Finding("error", name, "holds no number at all; drop it from columns or log it", "empty")
        return
    if c.missing:
        first = int(np.argmax(~np.isfinite(log[name])))
        yield Finding(
            "warning",
            name,
            f"{c.missing} values missing, first in row {first}; the log is cut there",
            "missing",
        )
    if c.constant and c.low == 0.0:
        wired = ": not wired, or not recorded?" if name.endswith(".u") else ""
        yield Finding("warning", name, f"is always zero{wired or '; drop it or record it'}", "always_zero")
    elif c.constant:
        yield Finding("info", name, f"is constant at {c.low:.6g}", "constant")
    if c.step and name.endswith(".q") and 0 < c.high - c.low < _COARSE * c.step:
        yield Finding(
            "warning",
            name,
            f"resolves {c.step:.3g}: only {(c.high - c.low) / c.step:.0f} steps over its whole "
            "range, speed and acceleration from it are coarse; log with more digits",
            "coarse_position",
        )
    if c.saturated:
        yield Finding(
            "warning",
            name,
            f"saturated at {c.low:.4g} or {c.high:.4g} in {100 * c.saturated:.2g} % of the rows; "
            f"these rows say nothing about the plant; move less violently",
            "saturated",
        )


def _digit_findings(channels: Mapping[str, ChannelQuality]) -> Iterator[Finding]:
    rounded: dict[int, list[str]] = {}
    for name, c in channels.items():
        if c.digits is not None:
            rounded.setdefault(c.digits, []).append(name)
    for digits, names in sorted(rounded.items()):
        yield Finding(
            "warning" if digits <= 4 else "info",
            "",
            f"{', '.join(names)}: numbers have {digits} significant digits, so the resolution "
            "falls as they grow; export with more digits",
            "few_digits",
        )
