"""What a controller writes above the numbers: sample time, date, units in a table of signals.

Nothing here is needed to read the numbers. A sample time is used only where the file has no time
column, and only with its unit: a bare 4 may be milliseconds as well as cycles.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.logs.files.cells import TIMES, UNIT_TITLES
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
_SANE = (1e-6, 1.0)
"""Steps that a servo trace can have [s]: 1 MHz to 1 Hz."""


def are_steps(name: str, x: Floats, unit: str) -> bool:
    """Whether a column holds the time of each row, by its name (``dt``, ``duration``) and its numbers.

    Numbers that only rise are a clock.
    """
    bare = re.split(r"[\[(]", name)[0].strip()
    called = re.fullmatch(rf"(?:{_PERIOD}|duration)", bare, re.I) and unit in TIMES
    if not called or x.ndim != 1 or len(x) < 2:
        return False
    low, high = SI_FACTOR[unit] * x.min(), SI_FACTOR[unit] * x.max()
    return bool(_SANE[0] <= low and high <= _SANE[1] and np.diff(x).min() <= 0.0)


def read_preamble(
    lines: Sequence[str], rows: Sequence[Sequence[str]], names: Sequence[str], shown: int = 6
) -> tuple[float | None, dict[str, str], list[str]]:
    """Return what the lines above the header say: sample time [s], column -> unit, and notes.

    Args:
        lines: the lines, comments among them.
        rows: cells of those that are no comments.
        names: the file's columns.
        shown: how many of the lines a note repeats.
    """
    kept = [line.strip() for line in lines if line.strip(' ;,\t"')]
    notes = []
    if kept:
        first = " | ".join(" ".join(line.split())[:80] for line in kept[:shown])
        more = f" | and {len(kept) - shown} more lines" if len(kept) > shown else ""
        notes.append(f"above the numbers: {first}{more}")
    date = next((match[0] for line in kept if (match := _DATE.search(line))), None)
    if date:
        notes.append("recorded " + " ".join(re.split(r"[;,\t ]+", date)))
    return _step(kept), _signal_units(rows, names), notes


def _step(lines: Sequence[str]) -> float | None:
    for pattern, known in ((_PERIOD_LINE, TIMES), (_RATE_LINE, ("Hz", "kHz"))):
        for match in filter(None, map(pattern.search, lines)):
            stated = map(find_unit, (match["before"] or "", match["after"] or ""))
            unit = next((u for u in stated if u in known), None)
            value = float(match["value"].replace(",", ".")) * SI_FACTOR[unit] if unit else 0.0
            if value > 0.0:
                step = value if known is TIMES else 1.0 / value
                if _SANE[0] <= step <= _SANE[1]:
                    return step
    return None


def _signal_units(rows: Sequence[Sequence[str]], names: Sequence[str]) -> dict[str, str]:
    """Return the units of a table of signals (``Nr;Signal;Axis;Unit``), found by name or by order."""
    for at, title in enumerate(rows):
        column = next((i for i, cell in enumerate(title) if cell.casefold() in UNIT_TITLES), None)
        if column is None or len(title) < 2:
            continue
        below = rows[at + 1 :]
        end = next((k for k, row in enumerate(below) if not any(row[column : column + 1])), len(below))
        table = below[:end]
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
