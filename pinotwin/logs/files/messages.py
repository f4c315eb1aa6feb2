"""Messages of numbers (JSON objects, ROS messages as dicts) as columns: dotted names, lists ``[i]``.

Parallel lists ``name position velocity effort`` (JointState) become ``<joint>.q .v .u``, a command ``<joint>.qr``.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.log import JOINT_SIGNALS
from pinotwin.logs.files.content import SHORT, limited

_DESIRED, _ACTUAL = ("reference", "desired"), ("feedback", "actual")
_SECONDS, _NANOSECONDS = ("sec", "secs"), ("nanosec", "nsec", "nsecs")


class Table:
    """Columns of numbers that grow row by row; what a row does not have is missing."""

    def __init__(self, source: str) -> None:
        self.rows, self._source = 0, source
        self.stamps: list[int] = []  # of the rows that have one [ns]
        self._given = 0  # numbers in all rows
        self._columns: dict[str, array[float]] = {}

    def add(self, pairs: Iterable[tuple[str, float]], at: int | None) -> None:
        """Append one row and, if it has one, its stamp [ns]."""
        self.stamps += [] if at is None else [at]
        for name, x in pairs:
            if name not in self._columns:
                self._columns[name] = array("d")
                self._limit()
            column = self._columns[name]
            if len(column) <= self.rows:
                self._fill(column)
                column.append(x)
                self._given += 1
        self.rows += 1

    def _fill(self, column: array[float]) -> None:
        column.extend(array("d", [np.nan]) * (self.rows - len(column)))

    def _limit(self) -> None:
        """Refuse names without end; a name takes as much as some rows."""
        limited(self._source, (self.rows + SHORT) * len(self._columns), 8 * self._given)

    def arrays(self) -> dict[str, Floats]:
        """Return the columns, each of shape (rows,)."""
        self._limit()
        for column in self._columns.values():
            self._fill(column)
        return {name: np.frombuffer(column, dtype=float) for name, column in self._columns.items()}


def seconds_since(origin: int, stamps: Sequence[int]) -> Floats:
    """Return stamps [ns] as seconds since one of them, shape (n,)."""
    return np.asarray((np.array(stamps, dtype=np.int64) - origin) * 1e-9, dtype=float)


def stamp(message: Mapping[str, object]) -> int | None:
    """Return the time of a message's header [ns], None where it has none or never set it."""
    header = message.get("header")
    given = header.get("stamp") if isinstance(header, Mapping) else None
    if not isinstance(given, Mapping):
        return None
    seconds = next((given[k] for k in _SECONDS if k in given), None)
    nanoseconds = next((given[k] for k in _NANOSECONDS if k in given), None)
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        return None
    return seconds * 10**9 + nanoseconds


def numbers(value: object, name: str, text: set[str]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their names; collect the names of what is none."""
    if isinstance(value, bool | int | float):
        yield name or "value", float(value)
    elif value is None:
        yield name or "value", float("nan")
    elif isinstance(value, Mapping):
        yield from _members(value, name, text)
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for i, item in enumerate(value):
            yield from numbers(item, f"{name}[{i}]", text)
    else:
        text.add(name)


def _members(value: Mapping[str, object], name: str, text: set[str]) -> Iterator[tuple[str, float]]:
    joints = joint_names(value)
    if joints:
        yield from joint_signals(value, joints)
    for key, item in value.items():
        if key == "header" and stamp(value) is not None:
            continue
        if joints and key in ("name", "joint_names", *JOINT_SIGNALS, *_DESIRED, *_ACTUAL):
            continue
        yield from numbers(item, f"{name}.{key}" if name else str(key), text)


def joint_names(message: Mapping[str, object]) -> list[str]:
    """Return the joints that a message names beside lists of as many numbers; none if it does not."""
    names = message.get("name", message.get("joint_names"))
    if not isinstance(names, list | tuple) or not names or not all(isinstance(n, str) for n in names):
        return []
    return list(names) if any(len(x) == len(names) for _, x in _lists(message)) else []


def joint_signals(message: Mapping[str, object], joints: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield ``<joint>.q .v .u`` of a JointState, and ``.qr`` of a controller's state."""
    for signal, values in _lists(message):
        if len(values) == len(joints):
            for joint, x in zip(joints, values, strict=True):
                if isinstance(x, int | float):
                    yield f"{joint}.{signal}", float(x)


def _lists(message: Mapping[str, object]) -> Iterator[tuple[str, Sequence[object]]]:
    for key, signal in JOINT_SIGNALS.items():
        yield signal, _sequence(message.get(key))
    actual = (("positions", "q"), ("velocities", "v"), ("effort", "u"))
    for keys, fields in ((_ACTUAL, actual), (_DESIRED, (("positions", "qr"),))):
        for part in (message.get(key) for key in keys):
            if isinstance(part, Mapping):
                yield from ((signal, _sequence(part.get(field))) for field, signal in fields)


def _sequence(value: object) -> Sequence[object]:
    return value if isinstance(value, list | tuple) else ()
