"""What a controller writes above the numbers: sample time, date, units in a table of signals.

Nothing here is needed to read the numbers. A sample time is used only where the file has no time
column, and only with its unit: a bare 4 may be milliseconds as well as cycles.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.units import SI_FACTOR, find_unit

_PERIOD = (
    r"(?:sampl\w*|trace|scan|scope|record\w*)(?:[\s_-]*(?:time|period|interval|cycle|step))+|"
    r"abtast(?:zeit|takt|intervall|periode)|cycle[\s_-]*time|zykluszeit|time[\s_-]*(?:step|increment)|"
    r"delta[\s_-]*t|dt"
)
_RATE = (
    r"(?:sampl\w*|trace|scan|record\w*)[\s_-]*(?:rate|freq\w*)|abtast(?:rate|freq\w*)|sampling[\s_-]*freq\w*"
)
_VALUE = (
    r"\s*(?:[\[(]\s*(?P<before>[^\])]+?)\s*[\])])?(?:\s+is\b)?[\"':=;,\s]*(?P<value>\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)"
    r"[\"';,\s]*[\[(]?(?P<after>[A-Za-zµ]+)?"
)
_PERIOD_LINE = re.compile(rf"\b(?:{_PERIOD})\b{_VALUE}", re.I)
_RATE_LINE = re.compile(rf"\b(?:{_RATE})\b{_VALUE}", re.I)
_DATE = re.compile(
    r"(?:\d{4}-\d\d-\d\d|\d{1,2}\.\d{1,2}\.\d{4}|\d{1,2}/\d{1,2}/\d{4})(?:[T ;,\t]+\d{1,2}:\d\d(?::\d\d)?)?"
)
UNIT_TITLES = ("unit", "units", "einheit", "unité", "unità")
_TIMES = ("s", "ms", "us", "µs", "ns")
_RATES = ("Hz", "kHz")
_SANE = (1e-6, 1.0)
"""Steps that a servo trace can have [s]: 1 MHz to 1 Hz."""
_SHOWN = 6


@dataclass(frozen=True)
class Preamble:
    """The lines above the header.

    Attributes:
        lines: as they stand.
        step: sample time that they state [s].
        date: date and time of the recording, as written.
        units: column -> unit, from a table of signals.
    """

    lines: tuple[str, ...] = ()
    step: float | None = None
    date: str | None = None
    units: dict[str, str] = field(default_factory=dict)

    @property
    def notes(self) -> list[str]:
        """What a user should know of it."""
        if not self.lines:
            return []
        shown = " | ".join(" ".join(line.split())[:80] for line in self.lines[:_SHOWN])
        more = len(self.lines) - _SHOWN
        out = [f"above the numbers: {shown}" + (f" | and {more} more lines" if more > 0 else "")]
        return out + ([f"recorded {self.date}"] if self.date else [])


def are_steps(name: str, x: Floats, unit: str) -> bool:
    """Whether a column holds the time of each row, by its name (``dt``, ``duration``) and its numbers.

    Numbers that only rise are a clock.
    """
    bare = re.split(r"[\[(]", name)[0].strip()
    if (
        not re.fullmatch(rf"(?:{_PERIOD}|duration)", bare, re.I)
        or unit not in _TIMES
        or x.ndim != 1
        or len(x) < 2
    ):
        return False
    low, high = SI_FACTOR[unit] * x.min(), SI_FACTOR[unit] * x.max()
    return bool(_SANE[0] <= low and high <= _SANE[1] and np.diff(x).min() <= 0.0)


def read_preamble(lines: Sequence[str], rows: Sequence[Sequence[str]], names: Sequence[str]) -> Preamble:
    """Return what the lines above the header say.

    Args:
        lines: the lines, comments among them.
        rows: cells of those that are no comments.
        names: the file's columns.
    """
    kept = tuple(line.strip() for line in lines if line.strip(' ;,\t"'))
    return Preamble(kept, _step(kept), _date(kept), _signal_units(rows, names))


def _step(lines: Sequence[str]) -> float | None:
    for pattern, known in ((_PERIOD_LINE, _TIMES), (_RATE_LINE, _RATES)):
        for line in lines:
            match = pattern.search(line)
            stated = map(find_unit, (match["before"] or "", match["after"] or "")) if match else ()
            unit = next((u for u in stated if u in known), None)
            if match is None or unit is None:
                continue
            value = float(match["value"].replace(",", ".")) * SI_FACTOR[unit]
            if value > 0.0:
                step = value if known is _TIMES else 1.0 / value
                if _SANE[0] <= step <= _SANE[1]:
                    return step
    return None


def _date(lines: Sequence[str]) -> str | None:
    found = (_DATE.search(line) for line in lines)
    return next((" ".join(re.split(r"[;,\t ]+", match[0])) for match in found if match), None)


def _signal_units(rows: Sequence[Sequence[str]], names: Sequence[str]) -> dict[str, str]:
    """Return the units of a table of signals (``Nr;Signal;Axis;Unit``), found by name or by order."""
    for at, title in enumerate(rows):
        column = next((i for i, cell in enumerate(title) if cell.casefold() in UNIT_TITLES), None)
        if column is None or len(title) < 2:
            continue
        table = []
        for row in rows[at + 1 :]:
            if len(row) <= column or not row[column]:
                break
            table.append(row)
        units = _by_name(table, column, names) or _by_order(table, column, names)
        if units:
            return units
    return {}


def _by_name(table: Sequence[Sequence[str]], column: int, names: Sequence[str]) -> dict[str, str]:
    folded = {re.sub(r"[\W_]+", "", name).casefold(): name for name in names}
    out = {}
    for row in table:
        words = [re.sub(r"[\W_]+", "", cell).casefold() for i, cell in enumerate(row) if i != column]
        joined = ["".join(pair) for k in range(len(words)) for pair in (words[k : k + 2], words[k::-1][:2])]
        name = next((folded[w] for w in (*words, *joined) if w in folded), None)
        unit = find_unit(row[column])
        if name and unit:
            out[name] = unit
    return out


def _by_order(table: Sequence[Sequence[str]], column: int, names: Sequence[str]) -> dict[str, str]:
    first = len(names) - len(table)  # a leading time column is no signal
    if first not in (0, 1):
        return {}
    units = {name: find_unit(row[column]) for name, row in zip(names[first:], table, strict=True)}
    return {name: unit for name, unit in units.items() if unit}
