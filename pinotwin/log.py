"""What was recorded: named channels of equal length on one clock, frozen.

A log as read keeps the names and units of its file. :func:`pinotwin.logs.columns.bind` gives the
channels the names and SI units of the contract: ``t``, ``<axis>.q``, ``<axis>.u``,
``<axis>.qr``...

A header such as ``Y_ActPos [mm]`` or ``Time (ms)`` becomes the channel ``Y_ActPos`` or ``Time``
and the unit is kept in ``Log.units``; the numbers stay as the file has them. Only ``bind``
converts, and it says so in the notes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import LogError, nearest
from pinotwin.units import SI_FACTOR

_UNIT_AT_END = re.compile(
    r"^(?P<name>.*?\S)\s*(?:[\[(<]\s*(?P<unit>[^\])>]+?)\s*[\])>]|\s(?:/|in)\s+(?P<bare>[^\s\[\]()]+))$"
)

ONE_UNIT: tuple[float, float] = (1.0, 0.0)


def split_unit(header: str) -> tuple[str, str | None]:
    """Return name and unit of a header written ``name [unit]``, ``name(unit)``, ``name / unit``.

    What is no unit known to :mod:`pinotwin.units` stays part of the name.
    """
    match = _UNIT_AT_END.match(header.strip())
    unit = match and (match["unit"] or match["bare"])
    if match and unit and unit in SI_FACTOR and not unit.isdigit() and unit != "-":
        return match["name"], unit
    return header.strip(), None


def _is_frozen(values: Floats) -> bool:
    """Whether an array is nobody's to change, as those of another log: it need not be copied."""
    own = isinstance(values, np.ndarray) and values.dtype == float and values.flags.owndata
    return own and not values.flags.writeable


@dataclass(frozen=True)
class Log:
    """Named channels on one clock.

    Attributes:
        channels: name -> values, each of shape (n,).
        source: the file (or files) it came from, for messages.
        scalars: single numbers that the file held beside the channels (gains, constants).
        notes: what the reader noticed, one sentence each (nothing is repaired in silence).
        units: unit of a channel as the file states it; absent where the file states none.
        scale: (factor, offset) with which ``bind`` made a channel SI, so that
            ``(x - offset) / factor`` is the number that the file held.
    """

    channels: Mapping[str, Floats]
    source: str = "log"
    scalars: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    scale: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        lengths = {name: len(x) for name, x in self.channels.items()}
        if len(set(lengths.values())) > 1:
            raise LogError(f"{self.source}: channels differ in length: {lengths}")
        frozen = {}
        for name, values in self.channels.items():
            x = values if _is_frozen(values) else np.array(values, dtype=float)
            x.flags.writeable = False
            frozen[str(name)] = x
        object.__setattr__(self, "channels", MappingProxyType(frozen))
        for name in ("scalars", "units", "scale"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle through the constructor: a read-only view of a dict cannot be pickled."""
        plain = (dict(self.scalars), self.notes, dict(self.units), dict(self.scale))
        return Log, (dict(self.channels), self.source, *plain)

    def __getitem__(self, name: str) -> Floats:
        try:
            return self.channels[name]
        except KeyError:
            raise LogError(f"{self.source}: no channel {name!r}; {nearest(name, self.channels)}") from None

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def __len__(self) -> int:
        return len(next(iter(self.channels.values()), ()))

    @property
    def t(self) -> Floats:
        """Time [s], shape (n,)."""
        return self["t"]

    def raw(self, name: str) -> Floats:
        """Return a channel as the file held it, before ``bind`` scaled it, shape (n,)."""
        factor, offset = self.scale.get(name, ONE_UNIT)
        return (self[name] - offset) / factor

    def rows(self, keep: slice | Floats) -> Log:
        """Return some rows (a slice, a mask or indices) as a log of their own."""
        return self.with_channels({name: x[keep] for name, x in self.channels.items()})

    def with_channels(self, channels: Mapping[str, Floats], notes: Iterable[str] = ()) -> Log:
        """Return this log with other channels and further notes."""
        return Log(channels, self.source, self.scalars, (*self.notes, *notes), self.units, self.scale)

    def fingerprint(self) -> str:
        """Return a hash of names and numbers that tells two recordings apart."""
        digest = hashlib.sha256()
        for name in sorted(self.channels):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(self.channels[name]).tobytes())
        return digest.hexdigest()[:16]
