"""Findings about the clock, and resampling, which happens only when asked for."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from pinotwin.errors import DataError, LogError
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike, as_log
from pinotwin.logs.quality.results import Finding
from pinotwin.signals import Clock, clock, uniform

SLOW = 50.0
"""Rate [Hz] below which the accelerations of a servo (10 to 100 ms long) fall between the "
"samples."""
_SLOWEST, _FASTEST = 2.0, 2e5  # rates [Hz] beyond which the stamps are in another unit


def clock_findings(c: Clock, rows: int) -> Iterator[Finding]:
    """Say what is wrong with a time axis."""
    at = f"about {c.rate:.4g} Hz"
    if c.backward:
        yield Finding(
            "warning",
            "t",
            f"the clock runs backward {len(c.backward)} times, first at row {c.backward[0]}; the "
            "log is cut there, check the logger's clock",
            "clock_backward",
        )
    if c.duplicated:
        yield Finding(
            "warning",
            "t",
            f"{len(c.duplicated)} duplicated time stamps, first at row {c.duplicated[0]} ({at}); "
            "the log is cut there, resample it or log finer stamps",
            "clock_duplicated",
        )
    if c.gaps:
        jump = c.longest > max(1.0, 1000.0 * c.step)
        yield Finding(
            "warning",
            "t",
            f"{len(c.gaps)} gaps, {c.missing} samples missing at {at}, the longest "
            f"{c.longest:.4g} s{' (a jump of the clock?)' if jump else ''}, first at row "
            f"{c.gaps[0]}; single samples are bridged, the log is cut at longer gaps",
            "clock_gaps",
        )
    if c.jitter_rms > 0.02 * c.step:
        yield Finding(
            "warning",
            "t",
            f"irregular sampling: interval {1e3 * c.step:.4g} ms, jitter {1e3 * c.jitter_rms:.3g} "
            f"ms rms, {1e3 * c.jitter_max:.3g} ms at most; preparation takes the clock that the motion shows",
            "clock_jitter",
        )
    refused = implausible_clock(c)
    if refused:
        yield Finding("error", "t", refused, "clock_unit")
    elif c.rate < SLOW:
        yield Finding(
            "warning",
            "t",
            f"{c.rate:.4g} Hz is too slow to identify inertia: a servo accelerates within 10 to "
            f"100 ms; friction and gravity can be found, log at 250 Hz or more for the rest",
            "slow_rate",
        )


def implausible_clock(c: Clock) -> str:
    """Return why a clock cannot be in seconds, with the unit that it seems to be in; "" if it can."""
    if _SLOWEST <= c.rate <= _FASTEST:
        return ""
    if c.rate > _FASTEST:
        return (
            f"{c.rate:.3g} samples per second: no servo is logged so fast; correct unit of t in machine.yaml"
        )
    unit = next((u for u, factor in (("ms", 1e3), ("us", 1e6)) if c.rate * factor >= 20.0), "ns")
    return (
        f"{c.rate:.3g} samples per second look like a clock in {unit}: set unit: {unit} for t under columns in "
        "machine.yaml"
    )


def resample(log: LogLike, rate: float, gap: float = 5.0) -> Log:
    """Return the log on a uniform clock, by linear interpolation; the notes say what was made up.

    Nothing is made up across a gap, a clock that runs backward, or a missing value: the new log
    has a break there too. There is no anti-alias filter: low-pass first when going to a lower
    rate.

    Args:
        log: needs ``t``; a log or its file.
        rate: new rate [Hz].
        gap: interval that counts as a gap, in median intervals.

    Raises:
        LogError: no time channel, a rate that is not above 0, or stamps that do not advance.
    """
    log = as_log(log)
    if not (np.isfinite(rate) and rate > 0):
        raise LogError(f"{log.source}: resample to {rate} Hz: the rate must be above 0")
    if "t" not in log:
        raise LogError(f"{log.source}: has no t; map it, or give t: {{rate: ...}}, in machine.yaml")
    try:
        before = clock(log.t)
    except DataError as error:
        raise LogError(f"{log.source}: {error}") from None
    fresh = np.isfinite(log.t) & np.r_[True, np.diff(log.t) != 0]
    kept = log.rows(fresh)
    dt = np.diff(kept.t)
    breaks = np.flatnonzero((dt <= 0) | (dt > gap * before.step)) + 1
    edges = [0, *(int(b) for b in breaks), len(kept)]
    stretches = [slice(a, b) for a, b in pairwise(edges) if b - a > 1]
    names = [name for name in kept.channels if name != "t"]
    table = np.column_stack([kept[name] for name in names]) if names else np.empty((len(kept), 0))
    t, x, parts = uniform(kept.t, table, rate, stretches)
    notes = [
        f"resampled from about {before.rate:.4g} Hz (jitter {1e3 * before.jitter_rms:.3g} ms rms) "
        f"to {rate:g} Hz by linear interpolation: {len(log)} rows became {len(t)} in {len(parts)} "
        "stretches"
    ]
    if not fresh.all():
        notes.append(f"{int((~fresh).sum())} rows with a duplicated or missing stamp were left out")
    if rate < 0.9 * before.rate:
        notes.append("the new rate is lower and nothing was low-passed before: signals may alias")
    return log.with_channels({"t": t, **dict(zip(names, x.T, strict=True))}, notes)
