"""The parts of machine.yaml beside the axes: what their types do not say is checked here."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pinocchio as pin
from msgspec import Meta

from pinotwin.arrays import Floats
from pinotwin.columns import AXIS_SIGNALS, LOAD_SIGNALS, POSITIONS, Column, is_contract_name
from pinotwin.errors import MachineError, nearest, require
from pinotwin.machine.parts import Axis, DataSettings, Imu, LeftOut, LoopShape
from pinotwin.machine.urdf_check import read_tree
from pinotwin.system.phrases import joined
from pinotwin.system.reading import Number, known_key, read, read_keys
from pinotwin.units import SI_FACTOR, UNUSED

_NAME = re.compile(r"[A-Za-z_]\w*$")
_FACTOR = Annotated[Number | str, Meta(description="a number, or the name of one in the log")]
_COLUMN: dict[str, Any] = {"column": str | int, "unit": str, "factor": _FACTOR} | dict.fromkeys(
    ("offset", "rate", "wrap", "kp", "kd", "found"), Number
)
_COLUMN |= {"law": Annotated[str, Meta(pattern="^pd$", description="pd")]}
_Kind = Literal["raw", "gravity_compensated", "magnitude", "external", "percent", "current"]
_UNITS = {"percent": {"unit": "%"}, "current": {"unit": "A"}, **{kind: {"unit": kind} for kind in UNUSED}}


def imus(stated: Mapping[str, Any], urdf: Path) -> dict[str, Imu]:
    """Return the inertial sensors, each on a link of the URDF."""
    links = [str(link.get("name")) for link in read_tree(urdf).findall("link")]
    for name, imu in stated.items():
        require(imu.get("link", ""), links, f"imus.{name}.link: no link", MachineError)
    return {name: Imu(name, **imu) for name, imu in stated.items()}


def loops(file: Mapping[str, Any], axes: tuple[str, ...]) -> dict[str, LoopShape]:
    """Return the closed loop of the axes that state one: its order, and on which encoder it is closed."""
    out = {}
    for name, stated in file.get("loop", {}).items():
        known_key(name, axes, "loop")
        shape = LoopShape(**stated, stated=bool(stated.keys() - {"closed_on"}))
        if isinstance(shape.feedforward_poles, list):
            shape = dataclasses.replace(shape, feedforward_poles=tuple(shape.feedforward_poles))
        if shape.real_poles + shape.pole_pairs < 1:
            raise MachineError(f"loop.{name}: needs at least one pole")
        ahead = len(shape.feedforward_poles) if isinstance(shape.feedforward_poles, tuple) else 2
        if shape.real_poles - ahead + 2 * shape.pole_pairs < 2:
            raise MachineError(
                f"loop.{name}: {shape.real_poles} real poles, {ahead} of them of the feed-forward, and "
                f"{shape.pole_pairs} pairs leave fewer than two for plant and feedback"
            )
        for key, (low, high) in shape.bounds.items():
            if not low < high:
                found = f"[{low:g}, {high:g}]"
                raise MachineError(f"loop.{name}.bounds.{key}: expected [lower, upper], found {found}")
        if shape.closed_on == "load" and file.get("transmission"):
            raise MachineError(
                f"loop.{name}.closed_on: a loop on the load's encoder behind a transmission of several motors is "
                "not modelled; give the motor's encoder"
            )
        out[name] = shape
    return out


def columns(stated: Mapping[str, Any], names: tuple[str, ...], model: pin.Model) -> dict[str, Column]:
    """Return the columns; a channel must belong to an axis, a passive joint or a link."""
    columns = parse_columns(stated)
    frames = [frame.name for frame in model.frames]
    for channel in columns:
        owner, _, signal = channel.rpartition(".")
        if owner:
            what, known = ("axis", names) if signal in AXIS_SIGNALS else ("link", frames)
            require(owner, known, f"columns.{channel}: no {what}", MachineError)
    return columns


def efforts(
    axes: Mapping[str, dict[str, Any]], of_all: Any, mapped: Mapping[str, Any]
) -> tuple[dict[str, dict[str, Any]], bool]:
    """Return the columns that `effort` makes beside those mapped, and whether the weight is out of all efforts."""
    out, kinds = {}, {}
    for name, axis in axes.items():
        where = f"axes.{name}.effort"
        given = dict(axis.pop("effort", of_all) or {})
        kinds[name] = read(given.pop("kind", "raw"), _Kind, f"{where}.kind")
        if isinstance(given.get("law"), Mapping):
            law = read(given.pop("law"), dict[str, dict[str, Number]], f"{where}.law")
            given |= {"law": next(iter(law), ""), **next(iter(law.values()), {})}
        unit, own = _UNITS.get(kinds[name], {}), mapped.get(f"{name}.u", {})
        own = own if isinstance(own, dict) else {"column": own}
        lost = unit if kinds[name] in UNUSED else {}  # whatever its unit
        if given or unit:
            out[f"{name}.u"] = ({} if given else {"column": f"{name}.u"}) | unit | given | own | lost
    bare = [name for name, kind in kinds.items() if kind == "gravity_compensated"]
    if bare and len(bare) < len(kinds):
        rest = joined([name for name in kinds if name not in bare])
        raise MachineError(
            f"axes.{bare[0]}.effort.kind: gravity_compensated holds for all axes or for none; log the effort of "
            f"{joined(bare)} with its weight, or state the kind of {rest} too"
        )
    return out, bool(bare)


def parse_columns(stated: Any) -> dict[str, Column]:
    """Return the columns that a mapping describes: channel -> fields of :class:`Column`, or the column's name."""
    given = read({} if stated is None else stated, dict[str, Any], "columns")
    return {name: _column(name, entry, f"columns.{name}") for name, entry in given.items()}


def _column(name: str, entry: Any, path: str) -> Column:
    if not (is_contract_name(name) or _NAME.match(name)):
        signals = (*AXIS_SIGNALS, *LOAD_SIGNALS)
        raise MachineError(f"{path}: no such signal; {nearest(name.rpartition('.')[2], signals)}")
    if not isinstance(entry, str | dict):
        raise MachineError(f"{path}: expected a column's name or keys and values, found {entry!r}")
    given = read_keys({"column": entry} if isinstance(entry, str) else entry, _COLUMN, path)
    column = Column(**given)
    if isinstance(column.column, int):
        column = dataclasses.replace(column, column=f"[{column.column}]")
    if column.unit and column.unit.strip() not in SI_FACTOR:
        raise MachineError(f"{path}.unit: unknown unit {column.unit!r}; {nearest(column.unit, SI_FACTOR)}")
    if column.factor == 0:
        raise MachineError(f"{path}.factor is 0, which erases the channel; correct it")
    if column.rate is not None and (name != "t" or column.rate <= 0 or column.column):
        raise MachineError(f"{path}.rate: only t may have a rate, above 0 Hz and instead of a column")
    if column.wrap is not None and (name.rpartition(".")[2] not in POSITIONS or column.wrap <= 0):
        raise MachineError(f"{path}.wrap: only q, qr and ql may wrap, after a range above 0")
    if column.law and not column.kp > 0.0:
        raise MachineError(f"{path}: a law needs its gain kp")
    if column.rate is None and column.column is None and not column.law and not column.found:
        raise MachineError(f"{path}: has no column; add column: <name in the log>")
    return column


def transmission(rows: Mapping[str, Mapping[str, float]], axes: Mapping[str, Axis], nv: int) -> Floats | None:
    """Return the matrix from joint to motor positions, shape (nv, nv), or None for identity."""
    if not rows:
        return None
    matrix = np.eye(nv)
    for motor, row in rows.items():
        known_key(motor, axes, "transmission")
        matrix[axes[motor].index] = 0.0
        for joint, ratio in row.items():
            known_key(joint, axes, f"transmission.{motor}")
            matrix[axes[motor].index, axes[joint].index] = ratio
    if abs(np.linalg.det(matrix)) < 1e-12:
        raise MachineError("transmission: the matrix is singular; every joint needs a motor")
    return matrix


def data_settings(stated: Mapping[str, Any]) -> DataSettings:
    """Return how logs of this machine are prepared."""
    values = dict(stated)
    if "drop" in values:
        ends = values["drop"] if isinstance(values["drop"], list) else [values["drop"]] * 2
        if len(ends) != 2:
            raise MachineError(f"data.drop: expected samples at the start and the end, found {ends!r}")
        values["drop"] = tuple(ends)
    if "leave_out" in values:
        values["leave_out"] = tuple(_left_out(values["leave_out"]))
    return DataSettings(**values)


def data_spec(settings: DataSettings) -> dict[str, Any]:
    """Return the mapping that :func:`data_settings` turns into the same settings."""
    out: dict[str, Any] = {}
    for f in dataclasses.fields(settings):
        value = getattr(settings, f.name)
        if f.name == "leave_out":
            for file, first, last in value:
                item = {first: last} if isinstance(first, str) else [first, last]
                out.setdefault("leave_out", {}).setdefault(file, []).append(item)
        elif value != f.default:
            out[f.name] = list(value) if isinstance(value, tuple) else value
    return out


def _left_out(given: Any, file: str = "") -> Iterator[LeftOut]:
    """Yield the rows of ``[[from, to], {channel: value}, ...]``, or of such a list for each file."""
    if isinstance(given, dict):
        for name, rows in given.items():
            yield from _left_out(rows, name)
        return
    for i, item in enumerate(given):
        if isinstance(item, dict):
            for channel, values in item.items():
                yield from ((file, channel, x) for x in (values if isinstance(values, list) else [values]))
        else:
            start, stop = item
            if stop < start:
                where = f"data.leave_out.{file}[{i}]" if file else f"data.leave_out[{i}]"
                raise MachineError(f"{where}: {start:g} to {stop:g} s runs backward")
            yield (file, start, stop)


def seconds(value: str | float, where: str) -> float:
    """Return a time such as ``3.5 ms`` or ``0.0035`` (then in s) in seconds."""
    text, _, unit = str(value).strip().partition(" ")
    factor = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}.get(unit.strip())
    if factor is None:
        raise MachineError(f"{where}: expected a time such as 3.5 ms, found {value!r}")
    return factor * float(read(text, Number, where))
