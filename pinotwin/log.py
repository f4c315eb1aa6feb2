"""What was recorded: named channels of equal length on one clock, frozen.

A log as read keeps names, units and numbers of its file: ``Y_ActPos [mm]`` is the channel ``Y_ActPos`` with a unit.
:func:`pinotwin.columns.bind` alone converts, and says so: ``t``, ``<axis>.q``, ``<axis>.u``, ``<axis>.qr``... in SI.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, LogError, nearest, require
from pinotwin.notebook import Card, Shown
from pinotwin.units import SI_FACTOR

_UNIT_AT_END = re.compile(
    r"^(?P<name>.*?\S)\s*(?:[\[(<]\s*(?P<unit>[^\])>]+?)\s*[\])>]|\s(?:/|in)\s+(?P<bare>[^\s\[\]()]+))$"
)

ARRAYS = ("q", "v", "a", "u", "qr", "ql")
"""Channels of an axis that a log in the names of the contract may have."""
JOINT_SIGNALS = {"position": "q", "velocity": "v", "effort": "u"}  # field of a JointState -> signal

ONE_UNIT: tuple[float, float] = (1.0, 0.0)


def split_unit(header: str) -> tuple[str, str | None]:
    """Return name and known unit of a header written ``name [unit]``, ``name(unit)``, ``name / unit``."""
    match = _UNIT_AT_END.match(header.strip())
    unit = match and (match["unit"] or match["bare"])
    if match and unit and unit in SI_FACTOR and not unit.isdigit() and unit != "-":
        return match["name"], unit
    return header.strip(), None


@dataclass(frozen=True, repr=False)
class Log(Card):
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
        if not isinstance(self.channels, Mapping):
            raise LogError(
                f"Log: expected channels by name, as in Log({{'t': t, 'X.q': q}}), not {type(self.channels).__name__}; "
                "arrays: Log.from_arrays(t, q=q, u=u, axes=names), a table: Log.from_pandas(table), a file: pt.read"
            )
        frozen = {}
        for name, values in self.channels.items():
            own = isinstance(values, np.ndarray) and values.dtype == float and values.flags.owndata
            frozen_already = own and not values.flags.writeable  # as those of another log: no copy is needed
            x = values if frozen_already else _numbers(values, f"{self.source}: channel {name!r}")
            if x.ndim != 1:
                raise LogError(
                    f"{self.source}: channel {name!r} has shape {x.shape}, expected (n,); several axes at once: "
                    "Log.from_arrays(t, q=q, u=u, axes=names)"
                )
            x.flags.writeable = False
            frozen[str(name)] = x
        lengths = {name: len(x) for name, x in frozen.items()}
        if len(set(lengths.values())) > 1:
            raise LogError(f"{self.source}: channels differ in length: {lengths}")
        object.__setattr__(self, "channels", MappingProxyType(frozen))
        for name in ("scalars", "units", "scale"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle through the constructor: a read-only view of a dict cannot be pickled."""
        plain = (dict(self.scalars), self.notes, dict(self.units), dict(self.scale))
        return Log, (dict(self.channels), self.source, *plain)

    def __getitem__(self, name: str) -> Floats:
        require(name, self.channels, f"{self.source}: no channel", LogError)
        return self.channels[name]

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
        return self[name] if (factor, offset) == ONE_UNIT else (self[name] - offset) / factor

    def rows(self, keep: slice | Floats) -> Log:
        """Return some rows (a slice, a mask or indices) as a log of their own."""
        return self.with_channels({name: x[keep] for name, x in self.channels.items()})

    def with_channels(self, channels: Mapping[str, Floats], notes: Iterable[str] = ()) -> Log:
        """Return this log with other channels and further notes."""
        return Log(channels, self.source, self.scalars, (*self.notes, *notes), self.units, self.scale)

    @classmethod
    def from_arrays(
        cls, t: Any, q: Any, *, axes: Sequence[str] = (), source: str = "arrays", **channels: Any
    ) -> Log:
        """Return arrays of all axes as a log in the names of the contract, SI.

        Args:
            t: time [s], shape (n,).
            q: measured position [m or rad], shape (n, nv), or (n,) of a single axis.
            axes: name of every column, ``list(model.names)[1:]`` of a ``pin.Model``.
            source: what messages call it.
            **channels: of the same shape as ``q``, or None: ``v`` and ``a`` (its derivatives), ``u`` motor effort
                [N or N·m], ``qr`` commanded position, ``ql`` position at the load. A column of NaN is left out:
                the axis has no such channel (each has its ``q``).

        Raises:
            LogError: an array has another shape, holds what is no number, or a name is unknown or given twice; the
                clock stands still.
        """
        names = [axes] if isinstance(axes, str) else [str(name) for name in axes]
        for kind in sorted(channels.keys() - set(ARRAYS)):
            raise LogError(f"{source}: no channel {kind!r}; {nearest(kind, ARRAYS)}; names of columns: axes=")
        if not names:
            raise LogError(
                f"{source}: give the names of the columns, axes=list(model.names)[1:] of a pin.Model"
            )
        if len(set(names)) < len(names):
            raise LogError(f"{source}: axes: {names} names an axis twice")
        clock = _numbers(t, f"{source}: t")
        if clock.ndim != 1 or not np.isfinite(clock).all():
            raise LogError(f"{source}: t has shape {clock.shape}, expected (n,) finite times in s")
        if len(clock) > 1 and not (np.diff(clock) > 0.0).any():
            raise LogError(
                f"{source}: t: no time is later than the one before; give the time of every row in s"
            )
        out = {"t": clock}
        for kind, values in {"q": q, **channels}.items():
            if values is not None:
                out |= _columns(values, kind, len(clock), names, source)
        return cls(out, source=source)

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame; units and notes in its ``attrs``. InputError if pandas is not installed."""
        table = require_pandas().DataFrame({name: np.array(x) for name, x in self.channels.items()})
        table.attrs = {"source": self.source, "units": dict(self.units), "notes": list(self.notes)}
        return table

    @classmethod
    def from_pandas(cls, table: Any, source: str = "DataFrame") -> Log:
        """Return the columns of a pandas DataFrame as a log.

        A time index becomes ``t`` in seconds from its first entry, and an index named ``t`` becomes ``t``,
        unless there is a column of that name.

        Args:
            table: one row a sample; headers may carry units, ``Y_ActPos [mm]``; of two levels, ``Y.q``.
            source: what messages call it.

        Raises:
            LogError: a column holds no numbers, or two have one name.
        """
        table = table if hasattr(table, "index") else table.to_pandas()  # of polars, of pyarrow
        channels, units = {}, dict(getattr(table, "attrs", {}).get("units", {}))
        index = table.index
        timed = any(split_unit(str(header))[0] == "t" for header in table.columns)
        if not timed and len(index) and index.dtype.kind in "Mm":
            channels["t"] = np.asarray((index - index[0]) / np.timedelta64(1, "s"), dtype=float)
        elif not timed and index.name == "t":
            channels["t"] = _numbers(index.to_numpy(), f"{source}: t")
        for k, header in enumerate(table.columns):
            name, unit = split_unit(".".join(map(str, header)) if isinstance(header, tuple) else str(header))
            if name in channels:
                raise LogError(f"{source}: two columns are called {name!r}; rename or drop one")
            try:
                channels[name] = table.iloc[:, k].to_numpy(dtype=float, na_value=np.nan)
            except (ValueError, TypeError):
                raise LogError(f"{source}: column {header!r} does not hold numbers; drop it") from None
            if unit is not None:
                units[name] = unit
        return cls(channels, source=source, units=units)

    def _shown(self) -> Shown:
        rows = []
        for name, x in self.channels.items():
            known = x[np.isfinite(x)]
            low, high = (known.min(), known.max()) if len(known) else (np.nan, np.nan)
            rows.append((name, self.units.get(name, ""), f"{low:.5g}", f"{high:.5g}", np.isnan(x).sum()))
        heads = ("channel", "unit", "smallest", "largest", "missing")
        return (f"Log {self.source}: {len(self)} rows", heads, rows, " ".join(self.notes[:3]))

    def fingerprint(self) -> str:
        """Return a hash of names and numbers that tells two recordings apart."""
        digest = hashlib.sha256()
        for name in sorted(self.channels):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(self.channels[name]).tobytes())
        return digest.hexdigest()[:16]


def is_table(given: Any) -> bool:
    """Whether something is a table of pandas, polars or pyarrow, which :meth:`Log.from_pandas` takes."""
    return hasattr(given, "columns") and (hasattr(given, "iloc") or hasattr(given, "to_pandas"))


def _numbers(values: Any, what: str) -> Floats:
    """Return a copy of values as real numbers."""
    try:
        if np.asarray(values).dtype.kind in "cSU":
            raise TypeError("complex, or text")
        return np.array(values, dtype=float)
    except (ValueError, TypeError):
        raise LogError(f"{what}: expected an array of numbers, not {type(values).__name__}") from None


def _columns(values: Any, kind: str, rows: int, names: Sequence[str], source: str) -> dict[str, Floats]:
    """Return the columns of an array as channels; one of NaN throughout is none."""
    x = _numbers(values, what := f"{source}: {kind}")
    x = x[:, None] if x.ndim == 1 and len(names) == 1 else x
    if x.shape != (rows, len(names)):
        turned = "; transpose it" if x.shape == (len(names), rows) else ""
        raise LogError(
            f"{what} has shape {x.shape}, expected ({rows}, {len(names)}): a row for each time, a column for each "
            f"of axes={list(names)}{turned}"
        )
    lost = [name for name, column in zip(names, x.T, strict=True) if np.isnan(column).all()]
    if kind == "q" and lost and rows:
        raise LogError(
            f"{source}: {lost[0]}.q: all values are NaN; record its position, or leave the axis out of axes"
        )
    out = {f"{name}.{kind}": column for name, column in zip(names, x.T, strict=True) if name not in lost}
    for name, column in out.items():
        wrong = np.flatnonzero(~np.isfinite(column))
        if len(wrong):
            raise LogError(
                f"{source}: {name}: {len(wrong)} of {rows} values are not finite, the first in row {wrong[0]}; leave "
                "these rows out, or use Log.from_pandas, where NaN is a missing value"
            )
    return out


def require_pandas() -> Any:
    """Return pandas, which is optional; an InputError says how to do without."""
    try:
        import pandas
    except ImportError:
        raise InputError(
            "pandas is not installed; `pip install pandas`, or use the NumPy arrays of the object"
        ) from None
    return pandas
