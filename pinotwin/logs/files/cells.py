"""Cells of a text log that are more than a number: lists, times of day."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from pinotwin.arrays import Floats

TIME_OF_DAY = re.compile(
    r"(?:(?P<date>\d{1,2}[./]\d{1,2}[./]\d{4})[ T])?(?P<H>\d{1,2}):(?P<M>\d\d):(?P<S>\d\d(?:[.,]\d+)?)$"
)
_DAY = 86400.0


def lists(cells: Sequence[str | None]) -> pa.Array:
    """Return cells such as ``[0.1, 0.2]`` as lists of numbers; an empty cell is a missing list."""
    return pa.array([_list(cell) for cell in cells], type=pa.list_(pa.float64()))


def _list(cell: str | None) -> list[float]:
    try:
        return [float(x) for x in (cell or "").strip()[1:-1].replace(",", " ").split()]
    except ValueError:
        return []


def seconds(cells: Sequence[str | None]) -> tuple[Floats, str]:
    """Return times of day [s] since the first, and the first as it is written.

    A time that falls back by more than half a day is on the next day.
    """
    found = [TIME_OF_DAY.match((cell or "").strip()) for cell in cells]
    day = np.array(
        [
            np.nan
            if m is None
            else 3600.0 * int(m["H"]) + 60.0 * int(m["M"]) + float(m["S"].replace(",", "."))
            for m in found
        ]
    )
    known = np.flatnonzero(np.isfinite(day))
    day[known] += _DAY * np.concatenate([[0.0], np.cumsum(np.diff(day[known]) < -0.5 * _DAY)])
    return day - day[known[0]], str(cells[known[0]])
