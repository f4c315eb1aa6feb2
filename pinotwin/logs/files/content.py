"""What every reader hands over, and how it becomes a ``Log``: numbers, vectors and matrices by dotted names.

The clock is the longest dimension that holds most numbers: arrays of that length are channels (a matrix column by
column), numbers and short vectors are scalars, everything else is left out with a note.
"""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinotwin.arrays import Floats
from pinotwin.errors import LogError, some
from pinotwin.log import Log, split_unit

SHORT = 64  # longest vector that is kept as scalars ``name[0]``, ``name[1]``... when it is no channel
MOST = 400_000_000  # most numbers that a file may hold (3.2 GB): five axes at 4 kHz for two hours
_FREE, _EXPANSION = 2**29, 100
"""Bytes that the numbers of any file may become as floats, and how many more for each of its own."""

BROKEN = (
    *(ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RuntimeError, MemoryError),
    *(OSError, EOFError, struct.error),
)
"""What libraries let through where a file is damaged: lengths, JSON, UTF-8, what is not there or not implemented."""

Seen = Callable[[float], None]  # called with the share of a file that was read, 0 to 1

_EPOCH_EXACT = 2.0**53
_INDEX = re.compile(r"(?<!^)[\[(][^\[(]*$")  # or unit, at the end of a name


class Holes(str):
    """A note that values are missing, which `check` says itself under the channel's name of the contract."""

    missing: int

    def __new__(cls, text: str, missing: int = 0) -> Holes:
        """Return the note of so many missing values."""
        out = super().__new__(cls, text)
        out.missing = missing
        return out


@dataclass
class Content:
    """Flattened content of one file while it is being read."""

    arrays: dict[str, NDArray[np.generic]] = field(default_factory=dict)  # dotted name -> array of any shape
    units: dict[str, str] = field(default_factory=dict)  # name -> unit that the file states
    left_out: list[str] = field(default_factory=list)  # names of what is no number (text, cells, references)
    notes: list[str] = field(default_factory=list)  # what the reader noticed
    place: Callable[[int], str] = "row {}".format  # where a row (from 0) is, for messages
    clock: str = ""  # name of the array whose length is the log's; "" leaves it to the majority
    stated: dict[str, str] = field(default_factory=dict)  # name -> name that the file states for several
    parts: dict[str, list[str]] = field(default_factory=dict)  # column of lists -> names of their parts

    def add(self, name: str, value: object) -> None:
        """Take one item: fields of a record array one by one, text and objects left out."""
        x = np.asarray(value)
        if x.dtype.names:
            for part in x.dtype.names:
                self.add(f"{name}.{part}" if name else part, x[part])
        elif x.dtype.kind in "biuf":
            self.arrays[name] = x
        elif x.dtype.kind in "mM":
            self.arrays[name] = self._seconds(name, x)
        else:
            self.left_out.append(name)

    def _seconds(self, name: str, x: NDArray[np.generic]) -> NDArray[np.generic]:
        start = x.flat[0] if x.size else np.datetime64(0, "ns")
        origin = start if x.dtype.kind == "M" else np.timedelta64(0, "ns")
        self.units[name] = "s"
        self.notes.append(f"{name}: dates and times were turned into seconds since {origin}")
        return np.asarray((x - origin) / np.timedelta64(1, "s"))  # type: ignore[operator]


@contextmanager
def undamaged(
    source: str, broken: tuple[type[Exception], ...] = BROKEN, remedy: str = "save or copy it again"
) -> Iterator[None]:
    """Raise a LogError for a file that its own library cannot read to the end, which says so by one of ``broken``."""
    try:
        yield
    except broken as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:80]
        raise LogError(f"{source}: is damaged or cut off ({reason}); {remedy}") from None


def held(kind: np.dtype[Any]) -> int:
    """Return how many numbers one item of an array holds: several where it is a record, an array or text."""
    if kind.subdtype:
        return held(kind.subdtype[0]) * math.prod(kind.subdtype[1])
    return sum(held(kind[name]) for name in kind.names) if kind.names else max(1, kind.itemsize // 8)


def limited(source: str, numbers: int, size: int) -> None:
    """Refuse a file of ``size`` bytes that claims more ``numbers`` than any log, or one of its size, may hold."""
    most = min(MOST, (_FREE + _EXPANSION * size) // 8)
    if not 0 <= numbers <= most:
        raise LogError(
            f"{source}: claims {numbers:.3g} numbers, more than the {most:.3g} that a log of {size} bytes may hold; "
            "cut it into parts or export it again"
        )


def to_log(content: Content, source: str, only: str | None = None) -> Log:
    """Return the log in the content of a file, of names that begin with ``only``; LogError where no channel is."""
    arrays = {k: np.squeeze(x) for k, x in content.arrays.items() if k.startswith(only or "")}
    if not arrays:
        kind = f"no numbers whose name begins with {only!r}" if only else "no numbers"
        raise LogError(f"{source}: holds {kind}; export the recorded signals as numeric columns")
    n = len(arrays[content.clock]) if content.clock in arrays else _clock_length(arrays)
    if n < 2:
        raise LogError(f"{source}: holds a single row or only single numbers; export time series")
    channels: dict[str, Floats] = {}
    scalars: dict[str, float] = {}
    notes = list(content.notes)
    other: list[str] = []
    for name, x in arrays.items():
        if x.ndim == 0:
            scalars[name] = float(x)
        elif x.ndim == 1 and len(x) == n:
            channels[name] = x.astype(float, copy=False)
        elif x.ndim == 2 and n in x.shape:
            rows = x if x.shape[1] == n and x.shape[0] != n else x.T
            channels.update({f"{name}[{i}]": row.astype(float) for i, row in enumerate(rows)})
        elif x.ndim == 1 and len(x) <= SHORT:
            scalars.update({f"{name}[{i}]": float(value) for i, value in enumerate(x)})
        else:
            other.append(f"{name} {x.shape}")
    if other:
        notes.append(f"left out, not of length {n}: {some(other)}")
    if content.left_out:
        notes.append(f"left out, not numbers: {some(content.left_out)}")
    notes += _sift(channels, content.stated)
    channels, units = _named(channels, content.units)
    notes += _missing(channels, content.place)
    return Log(channels, source, scalars, tuple(notes), units)


def _clock_length(arrays: dict[str, NDArray[np.generic]]) -> int:
    votes: Counter[int] = Counter()
    for x in arrays.values():
        if 1 <= x.ndim <= 2:
            votes[max(x.shape)] += x.size
    return max(votes, key=lambda n: (votes[n], n), default=0)


def distinct(names: Sequence[str]) -> list[str]:
    """Return the names with a number in those that stand a second time: ``q[0]`` becomes ``q#2[0]``."""
    taken, counts, out = set(names), Counter[str](), list[str]()
    for name in names:
        counts[name] += 1
        new = name
        while counts[name] > 1 and new in taken:
            index = _INDEX.search(name)
            end = index.start() if index else len(name)
            new = f"{name[:end].rstrip()}#{counts[name]}{name[len(name[:end].rstrip()) :]}"
            counts[name] += new in taken
        taken.add(new)
        out.append(new)
    return out


def repeated(names: Sequence[str], stated: Sequence[str]) -> dict[str, str]:
    """Return the names of columns that share the name which the file states -> that name."""
    counts = Counter(stated)
    return {name: old for name, old in zip(names, stated, strict=True) if counts[old] > 1}


def _sift(channels: dict[str, Floats], stated: dict[str, str]) -> list[str]:
    """Take out the columns of one name that never change, ``q_d[0]`` to ``q_d[6]`` as one; return what was done."""
    families: dict[str, list[str]] = {}
    for name in channels:
        if name in stated:
            families.setdefault(re.sub(r"\[\d+\]$", "", stated[name]), []).append(name)
    notes = []
    for family, names in families.items():
        if all(_rests(channels[name]) for name in names):
            notes.append(f"left out, unused: {len(names)} columns named {family!r}, of which none changes")
            for name in names:
                del channels[name]
        else:
            told = [name for name in names if name != stated[name]]
            notes.append(f"{len(names)} columns are named {family!r}, distinguished as {some(told)}")
    return notes


def _rests(x: Floats) -> bool:
    known = x[np.isfinite(x)]
    return not len(known) or bool(known.min() == known.max())


def _named(channels: dict[str, Floats], units: dict[str, str]) -> tuple[dict[str, Floats], dict[str, str]]:
    parts = [split_unit(header) for header in channels]
    named = dict(zip(distinct([name for name, _ in parts]), channels.values(), strict=True))
    known = [
        unit or units.get(header) or units.get(header.split("[")[0])
        for header, (_, unit) in zip(channels, parts, strict=True)
    ]
    return named, {name: unit for name, unit in zip(named, known, strict=True) if unit}


def _missing(channels: dict[str, Floats], place: Callable[[int], str]) -> list[str]:
    notes: list[str] = []
    for name, x in channels.items():
        bad = ~np.isfinite(x)
        if bad.any():
            kind, count = "missing or infinite" if np.isinf(x).any() else "missing", int(bad.sum())
            first = place(int(np.argmax(bad)))
            notes.append(Holes(f"{name}: {count} {kind} values, first in {first}", count))
        elif max(x.max(initial=0.0), -x.min(initial=0.0)) > _EPOCH_EXACT:
            notes.append(f"{name}: numbers above 2^53 lost their last digits as floats")
    return notes
