"""Findings about the clock, and resampling, which happens only when asked for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.errors import DataError, LogError
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_log
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.signals import Clock, clock, joined, uniform


def clock_findings(c: Clock, settings: Settings = USUAL) -> Iterator[Finding]:
    """Say what is wrong with a time axis."""
    if c.backward:
        yield finding("clock_backward", "t", count=len(c.backward), first=c.backward[0])
    if c.duplicated:
        yield finding("clock_duplicated", "t", count=len(c.duplicated), first=c.duplicated[0], rate=c.rate)
    if c.gaps:
        jump = " (a jump of the clock?)" if c.longest > max(1.0, 1000.0 * c.step) else ""
        seen = {"missing": c.missing, "rate": c.rate, "longest": c.longest, "jump": jump}
        yield finding("clock_gaps", "t", count=len(c.gaps), first=c.gaps[0], **seen)
    if c.jitter_rms > settings.jitter * c.step:
        scatter = {"rms": 1e3 * c.jitter_rms, "most": 1e3 * c.jitter_max}
        yield finding("clock_jitter", "t", step=1e3 * c.step, **scatter)
    cycle = usual_cycle(c.step)
    off = c.step / cycle - 1.0
    if 0.002 < abs(off) < 0.03:
        yield finding("clock_odd", "t", step=1e3 * c.step, cycle=1e3 * cycle, off=100.0 * off)
    refused = implausible_clock(c)
    if refused:
        yield finding("clock_unit", "t", why=refused)
    elif c.rate < settings.slow_rate:
        yield finding("slow_rate", "t", rate=c.rate)


def usual_cycle(step: float) -> float:
    """Return the nearest interval that controllers are clocked by [s]: one, two, four, five and such of a decade."""
    usual = np.array([1.0, 1.25, 1.5, 5.0 / 3.0, 2.0, 2.5, 3.0, 10.0 / 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
    usual *= 10.0 ** np.floor(np.log10(max(step, 1e-9)))
    return float(usual[np.argmin(np.abs(np.log(usual / step)))])


def implausible_clock(c: Clock) -> str:
    """Return why a clock cannot be in seconds, with the unit that it seems to be in; "" if it can."""
    slowest, fastest = 2.0, 2e5  # rates [Hz] that servos are logged at
    if slowest <= c.rate <= fastest:
        return ""
    said = f"{c.rate:.3g} samples per second"
    if c.rate > fastest:
        return f"{said}: no servo is logged so fast; correct unit of t in machine.yaml"
    unit = next((u for u, factor in (("ms", 1e3), ("us", 1e6)) if c.rate * factor >= 20.0), "ns")
    return f"{said} look like a clock in {unit}: set unit: {unit} for t under columns in machine.yaml"


def resample(log: LogLike, rate: float, gap: float = 5.0, *, smooth: bool = False) -> Log:
    """Return the log on a uniform clock, by linear interpolation; the notes say what was made up.

    Nothing is made up across a gap, a clock that runs backward, or a missing value: there is a break there too.
    Nothing is low-passed: do that first when going to a lower rate.

    Args:
        log: needs ``t``; a log or its file.
        rate: new rate [Hz].
        gap: interval that counts as a gap, in median intervals.
        smooth: it was low-passed, so that nothing aliases.

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
    stamped = log.rows(np.isfinite(log.t))
    kept = stamped.rows(np.diff(stamped.t, prepend=np.nan) != 0)
    stretches = [s for s in joined(kept.t, gap * before.step) if s.stop - s.start > 1]
    names = [name for name in kept.channels if name != "t"]
    table = np.column_stack([kept[name] for name in names]) if names else np.empty((len(kept), 0))
    t, x, parts = uniform(kept.t, table, rate, stretches)
    notes = [
        f"resampled from about {before.rate:.4g} Hz (jitter {1e3 * before.jitter_rms:.3g} ms rms) "
        f"to {rate:g} Hz by linear interpolation: {len(log)} rows became {len(t)} in {len(parts)} stretches"
    ]
    if len(kept) < len(log):
        notes.append(f"{len(log) - len(kept)} rows with a duplicated or missing stamp were left out")
    if rate < 0.9 * before.rate and not smooth:
        notes.append("the new rate is lower and nothing was low-passed before: signals may alias")
    return log.with_channels({"t": t, **dict(zip(names, x.T, strict=True))}, notes)
