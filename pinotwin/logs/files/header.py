"""What stands above the numbers: names and units of the columns, which clock stamps which, a controller's notes.

A sample time stated there is used only where the file has no time column, and only with its unit.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.logs.files.cells import TIMES, UNIT_TITLES, is_clock, is_number, is_plain
from pinotwin.logs.files.content import distinct, repeated
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
_SANE = (1e-6, 1.0)  # steps that a servo trace can have [s]: 1 MHz to 1 Hz


@dataclass(frozen=True)
class Header:
    """What the rows above the numbers say of the columns."""

    names: list[str] = field(default_factory=list)  # of the columns; none where the rows are no header
    units: dict[str, str] = field(default_factory=dict)  # name -> unit
    rows: int = 0  # how many rows it has
    clocks: dict[str, tuple[str, ...]] = field(default_factory=dict)  # clock column -> its columns
    stated: dict[str, str] = field(default_factory=dict)  # name -> name that the file states for several


def read_header(cells: list[list[str]], start: int, stem: str) -> Header:
    """Return names and units from the rows above row ``start``; no names where none stand there."""
    width = len(cells[start])
    ends = [max((i + 1 for i, cell in enumerate(row) if cell), default=0) for row in cells[:start]]
    above = [row[: max(width, end)] for row, end in zip(cells, ends, strict=False)]  # as a delimiter ends it
    if not above:
        return Header()
    labelled = _labelled(above, width)
    if labelled is not None:
        return labelled
    units_row = len(above) > 1 and is_unit_row(above[-1], above[-2])
    rows = 1 + units_row
    names = above[-rows]
    if not _names_columns(names, above[:-rows], width):
        return Header()
    if not names[-1] and not any(row[-1] for row in cells[start:] if len(row) == len(names)):
        names = names[:-1]  # a delimiter ends every line
    stated = [name or f"{stem}[{i}]" for i, name in enumerate(names)]
    titles, units = _under(above[-1 - rows][: len(names)] if len(above) > rows else [], stated)
    named = distinct(titles)
    for name, cell in zip(named, above[-1] if units_row else (), strict=False):
        unit = find_unit(cell) or cell.strip("[]() ")
        if unit and unit.casefold() not in UNIT_TITLES:
            units[name] = unit
    return Header(named, units, rows + (titles != stated), _stamped(named), repeated(named, stated))


def is_unit_row(row: Sequence[str], header: Sequence[str]) -> bool:
    """Whether a row under a header holds its units, one of which may be unknown."""
    bare = [cell for cell in row if cell and cell.strip("[]() ") not in ("", "-")]
    if not any(row) or any(cell.isdigit() for cell in bare) or len(row) > len(header) + 1:
        return False
    if all(re.fullmatch(r"[\[(].*[\])]", cell) for cell in row if cell not in ("", "-")):
        return bool(bare)
    known = [cell for cell in bare if cell.strip("[]() ") in SI_FACTOR or find_unit(cell)]
    return bool(bare) and 2 * len(known) > len(bare) and not any(map(is_plain, header))


def _names_columns(row: Sequence[str], above: Sequence[Sequence[str]], width: int) -> bool:
    """Whether a row right above the numbers is their header, not the last line of a block."""
    if all(map(is_number, row)) or (len(row) == 1 and width > 1):
        return False
    if above and _is_pair(row) and _is_pair(above[-1]):
        return False  # "Samples;4000" under "Offset;0"
    return not above or len(row) == width or (len(row) > 1 and len(row) >= 0.6 * width)


def _is_pair(row: Sequence[str]) -> bool:
    kept = [cell for cell in row if cell]
    return len(kept) == 2 and not is_number(kept[0]) and is_number(kept[1])


def _under(upper: Sequence[str], names: list[str]) -> tuple[list[str], dict[str, str]]:
    """Return the names below another row of names, and the units in the lower row of clocks in the upper."""
    words = [cell for cell in upper if cell]
    if len(upper) != len(names) or len(words) < 2 or any(map(is_number, words)):
        return names, {}
    counts, group = Counter(names), ""
    titles: list[str] = []
    units: dict[str, str] = {}
    for above, name in zip(upper, names, strict=True):
        group = above or group
        if is_clock(above) and find_unit(name) in TIMES:
            units[above] = name
            titles.append(above)
        else:
            titles.append(f"{group} {name}" if counts[name] > 1 and group else name)
    return titles, units


def _labelled(above: list[list[str]], width: int) -> Header | None:
    """Return the header of a scope whose rows begin with what they say (``Name pos Name vel``), a clock a channel."""
    rows = {row[0].casefold(): row for row in above if len(row) > 1 and row[0]}
    names = next((row for label, row in rows.items() if label.split()[-1] == "name"), None)
    if names is None or not {"unit", "symbolname", "sampletime[ms]"} & set(rows):
        return None
    label = names[0]
    full = [*names, *[label] * (width - len(names))][:width]
    named = [f"{label}#{i}" if name == label else name or f"[{i}]" for i, name in enumerate(full)]
    clocks = _stamping(named, [name == label for name in full])
    cells = rows.get("unit", [])
    units = {n: u for n, c in zip(named, cells, strict=False) if (u := find_unit(c)) and n not in clocks}
    units.update(dict.fromkeys(clocks, "ms" if "sampletime[ms]" in rows else "s"))
    return Header(named, units, len(above) - above.index(names), clocks)


def _stamped(names: list[str]) -> dict[str, tuple[str, ...]]:
    """Return clock -> columns up to the next clock, where a header repeats its clock."""
    bases = [re.sub(r"#\d+", "", name) for name in names]
    counts = Counter(bases)
    ticks = [counts[base] > 1 and is_clock(base) for base in bases]
    return _stamping(names, ticks) if ticks and ticks[0] else {}


def _stamping(names: Sequence[str], ticks: Sequence[bool]) -> dict[str, tuple[str, ...]]:
    """Return clock -> columns up to the next clock; the first of all columns is one."""
    starts = [i for i, is_tick in enumerate(ticks) if is_tick]
    ends = [*starts[1:], len(names)]
    return {names[a]: tuple(names[a + 1 : b]) for a, b in zip(starts, ends, strict=True)}


def are_steps(name: str, x: Floats, unit: str) -> bool:
    """Whether a column holds the time of each row, by name (``dt``, ``duration``) and numbers; a clock only rises."""
    bare = re.split(r"[\[(]", name)[0].strip()
    called = re.fullmatch(rf"(?:{_PERIOD}|duration)", bare, re.I) and unit in TIMES
    if not called or x.ndim != 1 or len(x) < 2:
        return False
    low, high = SI_FACTOR[unit] * x.min(), SI_FACTOR[unit] * x.max()
    return bool(_SANE[0] <= low and high <= _SANE[1] and np.diff(x).min() <= 0.0)


def read_preamble(
    lines: Sequence[str], rows: Sequence[Sequence[str]], names: Sequence[str], shown: int = 6
) -> tuple[float | None, dict[str, str], list[str]]:
    """Return sample time [s], column of ``names`` -> unit, and notes (``shown`` lines) from above the header."""
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
