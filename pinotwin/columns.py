"""How a controller names and scales its channels: from a file's columns to the contract's channels.

    SI = raw * si_factor(unit) * factor + offset

``factor`` (torque constant times gear, a sign) may name a scalar of the file (``gtau``); ``offset`` is SI. A clock
may come from a rate (``t: {rate: 5000}``); ``wrap`` is the range of a counter that starts again, in the file's unit.
Names of the contract: ``t``; ``<axis>.`` q, qr, u, v, a, e, temperature; ``<link>.`` fx fy fz mx my mz; IMU ``gx gy
gz ax ay az``; further ones have no dot. A ``column`` is named as the header has it, or ``"[k]"``: column k without one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import LogError, nearest, some
from pinotwin.log import JOINT_SIGNALS, ONE_UNIT, Log, split_unit
from pinotwin.units import COUNTS, ELECTRICAL, SI_FACTOR, UNUSED, si_factor

AXIS_SIGNALS = ("q", "qr", "ql", "u", "v", "a", "e", "temperature")
POSITIONS = ("q", "qr", "ql")
LOAD_SIGNALS = ("fx", "fy", "fz", "mx", "my", "mz")
IMU_SIGNALS = ("gx", "gy", "gz", "ax", "ay", "az")

_JOINT_STATE = re.compile(r"(?:.*/)?(?P<joint>[^/]+?)[./](?P<field>position|velocity|effort)$")


@dataclass(frozen=True)
class Column:
    """Where one channel comes from."""

    column: str | None = None  # name in the file; None only for a clock made from ``rate``
    unit: str = ""  # unit of the numbers in the file; "" takes the one that the file states, else SI
    factor: float | str = 1.0  # remaining factor to SI, or the name of a scalar of the file that holds it
    offset: float = 0.0  # added after scaling [SI]
    rate: float | None = None  # sampling rate [Hz] of a clock without a column
    wrap: float | None = None  # range of a counter to unwrap, in ``unit`` before ``factor``
    law: str = ""  # "pd": no column, the effort is kp (qr - q) + kd (qr' - q')
    kp: float = 0.0  # gain of that law [``unit`` per m or rad], kd on the velocity
    kd: float = 0.0
    found: float = 0.0  # what `identify` found one unit of an effort without a factor to be [N or N·m]


def is_contract_name(name: str) -> bool:
    """Whether a channel of that name is SI by contract."""
    owner, _, signal = name.rpartition(".")
    if owner:
        return signal in AXIS_SIGNALS or signal in LOAD_SIGNALS
    return name == "t" or name in IMU_SIGNALS


def bind(log: Log, columns: Mapping[str, Column], optional: Container[str] = ()) -> Log:
    """Return the log with SI channels named per the contract; a bound log takes no more than a factor found since.

    What is not mapped, or its column is missing, but has a name of the contract passes through: as SI, or converted
    where the file says so (a note). The rest is left out, and ``optional`` channels that the file lacks or gives no
    size. LogError: a column or scalar is not in the file, or a unit is unknown.
    """
    if log.scale:
        return _sized(log, columns)
    channels: dict[str, Floats] = {}
    scale: dict[str, tuple[float, float]] = {}
    units: dict[str, str] = {}
    notes = list(log.notes)
    used: set[str] = set()
    for name, column in columns.items():
        if column.rate is not None:
            if name in log and not _maps_any(log, columns):
                continue
            channels[name] = np.arange(len(log)) / column.rate
            notes.append(f"t: made from the rate {column.rate:g} Hz, not recorded")
        if column.column is None:
            continue
        with suppress(LogError) if name in optional else nullcontext():
            source = _find(log, column.column, name)
            if source is not None:  # else the log is in the names of the contract already
                channels[name], units[name], scale[name], said = _mapped(log, name, column, source)
                used.add(source)
                notes += said
    _brought_together(channels, columns, scale)
    for held, name in _passing(log, channels, used):
        used.add(held)
        channels[name], units[name], scale[name], _ = _mapped(log, name, Column(held), held)
        notes += (
            [f"{name}: the file states {units[name]}, converted to SI"] if scale[name] != ONE_UNIT else []
        )
        notes += [f"{name}: taken from {held}"] if held != name else []
    if not channels:
        raise LogError(
            f"{log.source}: no channel has a name of the contract (t, <axis>.q, <axis>.u...) and "
            "no columns are mapped; map them under `columns` in machine.yaml; "
            f"channels: {some(list(log.channels))}"
        )
    for name in [name for name, column in columns.items() if column.law]:
        with suppress(LogError) if name in optional else nullcontext():
            channels[name], units[name], scale[name] = _by_law(log, channels, name, columns[name])
    unused = [name for name in channels if name in columns and columns[name].unit in UNUSED]
    notes += [f"{name}: {UNUSED[columns[name].unit]}" for name in unused]
    channels = {name: x for name, x in channels.items() if name not in unused}
    left = [name for name in log.channels if name not in used]
    notes += [f"not mapped and left out: {some(left)}"] if left else []
    return _sized(Log(channels, log.source, log.scalars, tuple(notes), units, scale), columns)


def unsized(log: Log) -> dict[str, str]:
    """Return the efforts of a bound log that no factor turned into N or N·m -> what they are in."""
    efforts = {name: unit for name, unit in log.units.items() if name.endswith(".u") and unit in ELECTRICAL}
    factors = {name: abs(log.scale.get(name, (0.0, 0.0))[0]) for name in efforts}
    return {name: ELECTRICAL[unit] for name, unit in efforts.items() if factors[name] == si_factor(unit)}


def _sized(log: Log, columns: Mapping[str, Column]) -> Log:
    """Return a bound log with the efforts that `identify` found the factor of in N or N·m."""
    sizes = {name: columns[name].found for name in unsized(log) if name in columns and columns[name].found}
    if not sizes:
        return log
    channels = {name: x * sizes[name] if name in sizes else x for name, x in log.channels.items()}
    scale = {name: (size * log.scale[name][0], size * log.scale[name][1]) for name, size in sizes.items()}
    return replace(log, channels=channels, scale={**log.scale, **scale})


def _by_law(
    log: Log, channels: Mapping[str, Floats], name: str, column: Column
) -> tuple[Floats, str, tuple[float, float]]:
    """Return the effort that a servo's law makes of command and position, shape (n,), its unit, factor and offset."""
    axis = name.rpartition(".")[0]
    if missing := [x for x in ("t", f"{axis}.qr", f"{axis}.q") if x not in channels]:
        raise LogError(f"{log.source}: {name}: its law needs {', '.join(missing)}; map it under `columns`")
    error = channels[f"{axis}.qr"] - channels[f"{axis}.q"]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = column.kp * error + (column.kd * np.gradient(error, channels["t"]) if column.kd else 0.0)
    factor = _scalar(log, column.factor, name)
    return factor * np.where(np.isfinite(u), u, np.nan), column.unit or "law", (factor, 0.0)


def _mapped(
    log: Log, name: str, column: Column, source: str
) -> tuple[Floats, str, tuple[float, float], list[str]]:
    """Return a mapped channel in SI, its unit in the file, factor and offset, and notes."""
    notes, mapped, stated = [], column.unit.strip(), log.units.get(source)
    unit = mapped or log.units.get(source, "1")
    if mapped and stated is not None and SI_FACTOR.get(stated) != SI_FACTOR[mapped]:
        notes.append(f"{name}: the mapping says {mapped}, the file says {stated}; the mapping was followed")
    try:
        factor = si_factor(unit)
    except LogError as error:
        raise LogError(f"{log.source}: {name}: {error}; set unit in machine.yaml") from None
    size = (factor * _scalar(log, column.factor, name), column.offset)
    if unit in COUNTS and column.factor == 1.0 and name.rpartition(".")[2] in ("q", "qr", "v", "a", "e"):
        raise LogError(  # it would pass as metres
            f"{log.source}: {name} is in {unit}, which has no size of its own; give columns.{name} a "
            f"`factor` in machine.yaml: metres or radians of one {unit}"
        )
    raw = log[source]
    if column.wrap is not None:
        raw, times = unwrapped(raw, column.wrap)
        notes.append(
            f"{name}: unwrapped {times} times by {column.wrap:.10g} {unit if unit != '1' else ''}".rstrip()
        )
    return raw if size == ONE_UNIT else raw * size[0] + size[1], unit, size, notes


def unwrapped(x: Floats, wrap: float) -> tuple[Floats, int]:
    """Return a position (n,) without jumps of more than half the range ``wrap``, and how many there were; NaN stays."""
    good = np.isfinite(x)
    out = x.copy()
    out[good] = np.unwrap(x[good], period=wrap)
    turns = np.round((out[good] - x[good]) / wrap)
    return out, int(np.count_nonzero(np.diff(turns)))


def _brought_together(
    channels: dict[str, Floats], columns: Mapping[str, Column], scale: Mapping[str, tuple[float, float]]
) -> None:
    """Move unwrapped commands and load positions by whole turns to where the unwrapped ``<axis>.q`` is."""
    for name in channels:
        axis, _, signal = name.rpartition(".")
        own = columns[name].wrap if name in columns else None
        if own is None or signal == "q" or f"{axis}.q" not in channels:
            continue
        away = channels[f"{axis}.q"] - channels[name]
        away = away[np.isfinite(away)]
        period = own * abs(scale[name][0])
        if len(away):
            channels[name] = channels[name] + period * round(float(np.median(away)) / period)


def _maps_any(log: Log, columns: Mapping[str, Column]) -> bool:
    """Whether any mapped column is in the log; else it was not written by that controller."""
    wanted = [c.column for c in columns.values() if c.column]
    return any(split_unit(w)[0] in log or w in log or w.startswith("[") for w in wanted)


def _passing(log: Log, channels: Mapping[str, Floats], used: set[str]) -> Iterator[tuple[str, str]]:
    """Yield channels that need no mapping, and their names in the contract: ROS' ``<joint>.position`` is one."""
    for name in log.channels:
        if is_contract_name(name) and name not in channels:
            yield name, name
    for name in log.channels:
        match = _JOINT_STATE.match(name)
        if match and name not in used:
            target = f"{match['joint']}.{JOINT_SIGNALS[match['field']]}"
            if target not in channels and target not in log:
                yield name, target


def _find(log: Log, column: str, name: str) -> str | None:
    """Return the channel that a mapping means; None if the log has ``name`` itself instead."""
    for spelling in (column, split_unit(column)[0]):
        if spelling in log:
            return spelling
    if re.fullmatch(r"\[\d+\]", column):
        ending = [channel for channel in log.channels if channel.endswith(column)]
        if len(ending) == 1:
            return ending[0]
        if ending:
            raise LogError(f"{log.source}: {name}: {column} could be any of {some(ending)}; name one in full")
    if name in log and is_contract_name(name):
        return None
    raise LogError(f"{log.source}: {name}: no column {column!r}; {nearest(column, log.channels)}")


def _scalar(log: Log, factor: float | str, name: str) -> float:
    if not isinstance(factor, str):
        return factor
    if factor not in log.scalars:
        raise LogError(
            f"{log.source}: {name}: no scalar {factor!r} for factor; {nearest(factor, log.scalars)}"
        )
    value = log.scalars[factor]
    if value == 0 or not math.isfinite(value):
        raise LogError(f"{log.source}: {name}: the scalar {factor!r} is {value}; give a number")
    return value
