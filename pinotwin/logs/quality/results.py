"""What the inspection of a log returns."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pinotwin.arrays import plain
from pinotwin.signals import Clock
from pinotwin.system.phrases import LOG

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True)
class Finding:
    """One thing that a user should know."""

    severity: Severity  # ``error`` (the log cannot be used so), ``warning`` (results suffer), ``info``
    channel: str  # the channel or axis concerned, "" for the whole log
    message: str  # one sentence with the remedy
    code: str = ""  # the kind of finding in one word, for programs; "" where none needs it
    span: tuple[float, ...] = ()  # from when to when [s], of what does not last the whole log

    @property
    def axis(self) -> str:
        """The axes (or links) concerned, separated by commas; "" for the log as a whole."""
        owners = [c.rpartition(".")[0] if "." in c else c for c in self.channel.split(", ")]
        return ", ".join(dict.fromkeys(o for o in owners if o != "t"))

    def __str__(self) -> str:
        where = f"{self.channel}: " if self.channel else ""
        return f"{self.severity}: {where}{self.message}"


@dataclass(frozen=True)
class Limits:
    """What an axis can do, SI; None where it is not known."""

    position: tuple[float, float] | None = None  # lowest and highest position
    velocity: float | None = None  # highest speed
    effort: float | None = None  # highest effort
    lead: float = 0.0  # time by which its effort is known to be ahead of its position [s]


@dataclass(frozen=True)
class ChannelQuality:
    """One channel."""

    missing: int  # rows without a finite number
    low: float  # smallest value [SI]
    high: float  # largest value [SI]
    constant: bool  # whether all values are the same
    step: float | None  # quantisation step [SI], None where none shows
    digits: int | None  # significant digits to which the values were rounded, None where they were not
    saturated: float  # share of the rows that sit on a flat top or bottom


@dataclass(frozen=True)
class AxisQuality:
    """One axis."""

    rotary: bool  # whether positions are rad (else m)
    moves: bool  # whether it moves at all
    low: float  # lowest position [m or rad]
    high: float  # highest position [m or rad]
    speed: float  # highest speed reached [1/s]
    acceleration: float  # highest acceleration reached [1/s²]
    lead: float | None = None  # time by which the effort is ahead of the position [s]; None where untold
    lead_error: float | None = None  # standard error of that [s]


@dataclass(frozen=True)
class Quality:
    """What a log is worth."""

    source: str  # the log's file
    rows: int  # number of rows
    duration: float  # from first to last stamp [s]
    clock: Clock | None  # what the time stamps say; None without a usable one
    cutoff: float  # corner of the low-pass that the positions suggest [Hz]
    channels: Mapping[str, ChannelQuality]  # channel -> its quality
    axes: Mapping[str, AxisQuality]  # axis -> its quality
    findings: tuple[Finding, ...]  # what a user should know, gravest first

    @property
    def ok(self) -> bool:
        """Whether nothing forbids the use of the log."""
        return not any(f.severity == "error" for f in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Return plain types for JSON; what is not finite becomes None."""
        return {"ok": self.ok, **plain(dataclasses.asdict(self))}


_ERRORS = (
    *("clock_missing", "clock_stands", "clock_unit", "empty", "position_missing", "no_motion"),
    *("log_short", "unusable"),
)
_FACTS = (
    *("clock_odd", "constant", "load_position", "not_told", "not_tried", "no_effect", "identifiable"),
    "effort_frictionless",
)


def finding(code: str, channel: str = "", grave: Severity | None = None, /, **numbers: object) -> Finding:
    """Return what is said under a code of a channel, with its numbers; ``grave`` where it is not the usual."""
    usual: Severity = "error" if code in _ERRORS else "info" if code in _FACTS else "warning"
    return Finding(grave or usual, channel, LOG[code].format(**numbers), code)
