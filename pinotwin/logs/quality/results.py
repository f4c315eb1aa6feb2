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
    """One thing that a user should know.

    Attributes:
        severity: ``error`` (the log cannot be used so), ``warning`` (results suffer), ``info``.
        channel: the channel or axis concerned, "" for the whole log.
        message: one sentence with the remedy.
        code: the kind of finding in one word, for programs; "" where none needs it.
    """

    severity: Severity
    channel: str
    message: str
    code: str = ""

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
    """What an axis can do, SI; None where it is not known.

    Attributes:
        position: lowest and highest position.
        velocity: highest speed.
        effort: highest effort.
        lead: time by which its effort is known to be ahead of its position [s].
    """

    position: tuple[float, float] | None = None
    velocity: float | None = None
    effort: float | None = None
    lead: float = 0.0


@dataclass(frozen=True)
class ChannelQuality:
    """One channel.

    Attributes:
        missing: rows without a finite number.
        low: smallest value [SI].
        high: largest value [SI].
        constant: whether all values are the same.
        step: quantisation step [SI], None where none shows.
        digits: significant digits to which the values were rounded, None where they were not.
        saturated: share of the rows that sit on a flat top or bottom.
    """

    missing: int
    low: float
    high: float
    constant: bool
    step: float | None
    digits: int | None
    saturated: float


@dataclass(frozen=True)
class AxisQuality:
    """One axis.

    Attributes:
        rotary: whether positions are rad (else m).
        moves: whether it moves at all.
        low: lowest position [m or rad].
        high: highest position [m or rad].
        speed: highest speed reached [1/s].
        acceleration: highest acceleration reached [1/s²].
        lead: time by which the effort is ahead of the position [s], None where it cannot be told.
        lead_error: standard error of that [s].
    """

    rotary: bool
    moves: bool
    low: float
    high: float
    speed: float
    acceleration: float
    lead: float | None = None
    lead_error: float | None = None


@dataclass(frozen=True)
class Quality:
    """What a log is worth.

    Attributes:
        source: the log's file.
        rows: number of rows.
        duration: from first to last stamp [s].
        clock: what the time stamps say; None without a usable one.
        cutoff: corner of the low-pass that the positions suggest [Hz].
        channels: channel -> its quality.
        axes: axis -> its quality.
        findings: what a user should know, gravest first.
    """

    source: str
    rows: int
    duration: float
    clock: Clock | None
    cutoff: float
    channels: Mapping[str, ChannelQuality]
    axes: Mapping[str, AxisQuality]
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing forbids the use of the log."""
        return not any(f.severity == "error" for f in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Return plain types for JSON; what is not finite becomes None."""
        return {"ok": self.ok, **plain(dataclasses.asdict(self))}


_ERRORS = (
    *("clock_missing", "clock_stands", "clock_unit", "empty", "position_missing", "no_motion"),
    *("body_impossible", "unusable"),
)
_FACTS = ("constant", "load_position", "not_told", "no_effect", "identifiable")


def finding(code: str, channel: str = "", grave: Severity | None = None, /, **numbers: object) -> Finding:
    """Return what is said under a code of a channel, with its numbers; ``grave`` where it is not the usual."""
    usual: Severity = "error" if code in _ERRORS else "info" if code in _FACTS else "warning"
    return Finding(grave or usual, channel, LOG[code].format(**numbers), code)
