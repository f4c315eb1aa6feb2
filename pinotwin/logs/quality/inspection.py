"""Inspect a log before anything is fitted: tables per channel and axis, findings with a remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.clock import even_clock
from pinotwin.logs.files.content import Holes
from pinotwin.logs.quality.axes import axis_findings, inspect_axes
from pinotwin.logs.quality.recorded import recorded_findings, row_findings
from pinotwin.logs.quality.results import ChannelQuality, Finding, Limits, Quality, Severity, finding
from pinotwin.logs.quality.sampling import clock_findings
from pinotwin.logs.quality.values import quantisation_step, saturated_rows, significant_digits
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.signals import Clock, clock


def inspect(
    log: Log, axes: Mapping[str, bool], limits: Mapping[str, Limits] | None = None, settings: Settings = USUAL
) -> Quality:
    """Return what a bound log (SI) is worth; ``axes`` says which are rotary, ``limits`` what they can do, if known."""
    findings: list[Finding] = []
    ticks = _clock(log, findings, settings)
    channels = {name: _channel(log, name) for name in log.channels if name != "t"}
    for name, channel in channels.items():
        findings += _channel_findings(log, name, channel, settings)
    findings += _digit_findings(channels)
    present = [name for name in axes if f"{name}.q" in log]
    even = even_clock(log, present, settings) if ticks and present else log  # as preparation takes it
    table, cutoff = inspect_axes(even, axes, ticks and clock(even.t), settings)
    findings += axis_findings(log, axes, table, channels, limits or {}, ticks, settings)
    rows = [*row_findings(log, settings), *recorded_findings(log, list(axes))]
    torn = {f.channel for f in rows if f.code in ("wraps", "leaps")}
    findings = [f for f in findings if not (f.code == "speed_limit" and f.channel in torn)] + rows
    findings += [Finding("info", "", note) for note in _untold(log, channels)]
    findings.sort(key=lambda f: ("error", "warning", "info").index(f.severity))
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


def _untold(log: Log, channels: Mapping[str, ChannelQuality]) -> Iterator[str]:
    """Yield what the reader noticed but for the holes that findings tell of, under the names of the contract."""
    told = {c.missing for c in channels.values() if c.missing < len(log)}
    told.add(int((~np.isfinite(log.t)).sum()) if "t" in log else 0)
    for note in dict.fromkeys(log.notes):
        if not (isinstance(note, Holes) and note.missing in told):
            yield note


def _clock(log: Log, findings: list[Finding], settings: Settings) -> Clock | None:
    if "t" not in log:
        findings.append(finding("clock_missing", "t"))
        return None
    missing = int((~np.isfinite(log.t)).sum())
    if missing:
        findings.append(finding("clock_holes", "t", count=missing))
    try:
        ticks = clock(log.t)
    except DataError as error:
        findings.append(finding("clock_stands", "t", why=error))
        return None
    findings += clock_findings(ticks, settings)
    if ticks.step * len(log) < settings.shortest:
        findings.append(finding("log_short", "t", seconds=ticks.step * len(log)))
    return ticks


def _channel(log: Log, name: str) -> ChannelQuality:
    x = log[name]
    good = x[np.isfinite(x)]
    factor = abs(log.scale.get(name, (1.0, 0.0))[0])
    raw = log.raw(name)
    step = quantisation_step(raw)
    return ChannelQuality(
        missing=len(x) - len(good),
        low=float(good.min()) if len(good) else float("nan"),
        high=float(good.max()) if len(good) else float("nan"),
        constant=len(good) > 0 and bool(np.ptp(good) == 0),
        step=None if step is None else step * factor,
        digits=significant_digits(raw),
        saturated=float(np.mean(name.endswith(".u") and saturated_rows(raw))),
    )


def _channel_findings(log: Log, name: str, c: ChannelQuality, settings: Settings) -> Iterator[Finding]:
    if c.missing == len(log):
        yield finding("empty", name)
        return
    if c.missing:
        yield finding("missing", name, count=c.missing, first=int(np.argmax(~np.isfinite(log[name]))))
    if c.constant and c.low == 0.0:
        wired = ": not wired, or not recorded?" if name.endswith(".u") else "; drop it or record it"
        yield finding("always_zero", name, remedy=wired)
    elif c.constant:
        yield finding("constant", name, value=c.low)
    if c.step and name.endswith(".q") and 0 < c.high - c.low < settings.coarse * c.step:
        yield finding("coarse_position", name, step=c.step, steps=(c.high - c.low) / c.step)
    if c.saturated:
        yield finding("saturated", name, low=c.low, high=c.high, percent=100 * c.saturated)


def _digit_findings(channels: Mapping[str, ChannelQuality]) -> Iterator[Finding]:
    rounded: dict[int, list[str]] = {}
    for name, c in channels.items():
        if c.digits is not None:
            rounded.setdefault(c.digits, []).append(name)
    for digits, names in sorted(rounded.items()):
        grave: Severity = "warning" if digits <= 4 else "info"
        yield finding("few_digits", "", grave, names=", ".join(names), digits=digits)
