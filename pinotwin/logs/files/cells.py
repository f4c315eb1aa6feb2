"""Cells of a text log: numbers and the marks of missing ones, lists, dates and times of day, names of clocks."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pinotwin.arrays import Floats

COMMENTS = ("#", "%", "//")
_WORDS = ("null", "none", "unavailable")  # the last one of MTConnect
MISSING = (*_WORDS, "", "-", "--", "?", "na", "n/a", "#n/a", "nan", "-nan", "nan(ind)", "-nan(ind)")
CLOCK_NAMES = ("t", "time", "zeit", "timestamp", "time stamp", "temps", "tiempo", "x_value")
UNIT_TITLES = ("unit", "units", "einheit", "unité", "unità")
TIMES = ("s", "ms", "us", "µs", "ns")

_NUMBER = re.compile(
    r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|[+-]?inf(inity)?$"
    r"|[+-]?\d{1,3}(,\d{3})+\.\d*$|[+-]?\d{1,3}(\.\d{3})+,\d*$",
    re.I,
)
_BASIC = r"^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)"
_EXTENDED = r"\1-\2-\3T\4:\5:\6"
_STAMP = (
    r"^\s*(?:(?:(?P<Y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)"
    r"|\d\d?[-/. ](?:\d\d?|[A-Za-z]{3})[-/. ]\d{2,4}|[A-Za-z]{3} \d\d?,? \d{4},?)[Tt_ ,]\s*)?"
    r"(?P<H>\d\d?):(?P<M>\d\d):(?P<S>\d\d(?:[.,]\d+)?)\s*"
    r"(?P<half>[AaPp])?(?:\.?[Mm]\.?)?\s*(?:[ZzU]T?C?|(?P<zone>[+-])(?P<h>\d\d)(?::?(?P<min>\d\d))?)?\s*$"
)
_DAY, _HOUR = 86400.0, 3600.0


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, without the blanks around them; a space stands for runs of blanks."""
    if delimiter == " ":
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # a stray carriage return, or a cell beyond csv's limit
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def is_comment(line: str) -> bool:
    """Whether a line is a comment; Excel's ``#N/A`` is a missing value."""
    bare = line.lstrip()
    return bare.startswith(COMMENTS) and not bare.upper().startswith("#N/A")


def is_plain(cell: str) -> bool:
    """Whether a cell is a number."""
    return _NUMBER.match(cell) is not None


def is_number(cell: str) -> bool:
    """Whether a cell is a number or one of the marks of a missing one."""
    return is_plain(cell) or cell.lower() in MISSING


def is_list(cell: str) -> bool:
    """Whether a cell holds a list of numbers: ``[0.1, 0.2]``."""
    if cell[:1] not in ("[", "(") or cell[-1] not in "])":
        return False
    return all(map(is_number, cell[1:-1].replace(",", " ").split() or ["x"]))


def has_value(cell: str) -> bool:
    """Whether a cell is not empty, and a number, a mark of a missing one, or a list."""
    return bool(cell) and (is_number(cell) or is_list(cell))


def is_clock(name: str) -> bool:
    """Whether a column is called as clocks are: ``Time``, ``Zeit [s]``, ``timestamp``."""
    bare = re.split(r"[\[(/]", name.strip())[0].strip(" _").casefold()
    return bare in CLOCK_NAMES or bare.startswith(("time ", "time_", "zeit")) or bare.endswith("timestamp")


def is_stamp(cell: str) -> bool:
    """Whether a cell is a time of day, with or without its date: ISO 8601, ``14:03:12,5``, ``2:03:12 PM``."""
    return re.match(_STAMP, re.sub(_BASIC, _EXTENDED, cell)) is not None


def lists(cells: Sequence[str | None]) -> pa.Array:
    """Return cells such as ``[0.1, 0.2]`` as lists of numbers; an empty cell is a missing list."""
    return pa.array([_list(cell) for cell in cells], type=pa.list_(pa.float64()))


def _list(cell: str | None) -> list[float]:
    try:
        return [float(x) for x in (cell or "").strip()[1:-1].replace(",", " ").split()]
    except ValueError:
        return []


def seconds(cells: pa.ChunkedArray) -> tuple[Floats, list[str]]:
    """Return stamps [s] since the first, (n,), made to rise over midnight and summer time, and what was done."""
    found = pc.extract_regex(pc.replace_substring_regex(cells, _BASIC, _EXTENDED), _STAMP)
    hour, half, zone = _number(found, "H"), _texts(found, "half"), _texts(found, "zone")
    known = np.flatnonzero(np.isfinite(hour))
    if not len(known):
        return hour, []
    first = known[0]
    hour = np.where(half == "", hour, hour % 12.0 + 12.0 * (np.char.lower(half) == "p"))
    ahead = _HOUR * np.nan_to_num(_number(found, "h")) + 60.0 * np.nan_to_num(_number(found, "min"))
    ahead = np.where(zone == "-", -ahead, ahead)  # of UTC
    parts = ((_HOUR, hour), (60.0, _number(found, "M")), (1.0, _number(found, "S")), (-1.0, ahead))
    t = np.sum([size * (x - x[first]) for size, x in parts], axis=0)
    dated = bool(_texts(found, "Y")[first])
    if dated:
        month = 12.0 * (_number(found, "Y") - 1970.0) + _number(found, "m") - 1.0
        first_of_month = month[known].astype("datetime64[M]").astype("datetime64[D]").astype(float)
        day = first_of_month + _number(found, "d")[known]
        t[known] += _DAY * (day - day[0])
    else:
        t[known] += _DAY * np.concatenate([[0.0], np.cumsum(np.diff(t[known]) < -0.5 * _DAY)])
    what = "dates and times" if dated else "times of day"
    notes = [f"{what} were turned into seconds since {str(cells[int(first)]).strip()}"]
    if not (zone != "").any() and (leaps := _summer_time(t, known)):
        notes.append(f"the clock was put by an hour {leaps} times (summer time); taken out")
    return t, notes


def _texts(found: pa.ChunkedArray, name: str) -> np.ndarray:
    return np.array(pc.fill_null(pc.struct_field(found, name), "").to_pylist(), dtype=str)


def _number(found: pa.ChunkedArray, name: str) -> Floats:
    part = pc.replace_substring(pc.struct_field(found, name), ",", ".")
    number = pc.cast(pc.if_else(pc.equal(part, ""), None, part), pa.float64())
    return np.array(pc.fill_null(number, float("nan")).to_pylist(), dtype=float)  # without pandas


def _summer_time(t: Floats, known: np.ndarray) -> int:
    """Take leaps of one hour, to within a step, out of ``t``; return how many there were."""
    apart = np.diff(t[known])
    step = float(np.median(apart)) if len(apart) else 0.0
    hours = np.where(np.abs(apart) > 0.5 * _HOUR, np.sign(apart), 0.0)
    leaps = (hours != 0.0) & (np.abs(apart - step - _HOUR * hours) < step)
    t[known[1:]] -= _HOUR * np.cumsum(np.where(leaps, hours, 0.0))
    return int(leaps.sum())
