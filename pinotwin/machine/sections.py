"""The parts of machine.yaml beside the axes: sensors, loops, columns, transmission, data."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import MachineError, nearest
from pinotwin.logs.columns import AXIS_SIGNALS, LOAD_SIGNALS, Column, parse_columns
from pinotwin.machine.parts import Axis, DataSettings, Imu, LeftOut, LoopShape
from pinotwin.machine.urdf_check import read_tree
from pinotwin.machine.yaml_file import check_keys, mapping, number, truth, whole

LOOP_KEYS = ("real_poles", "pole_pairs", "feedforward_poles", "numerators", "bounds", "closed_on")


GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity of a machine that stands on the floor, in the axes of the URDF's root [m/s²]."""


def gravity(spec: Mapping[str, Any]) -> Floats:
    """Return the acceleration of gravity in the axes of the URDF's root [m/s²], shape (3,)."""
    given = spec.get("gravity", GRAVITY)
    if not isinstance(given, list | tuple) or len(given) != 3:
        raise MachineError(
            f"gravity: expected [x, y, z] in m/s² along the axes of the URDF's root, found {given!r}"
        )
    return np.array([number(x, f"gravity[{k}]") for k, x in enumerate(given)])


def imus(spec: Mapping[str, Any], urdf: Path) -> dict[str, Imu]:
    """Return the inertial sensors, each on a link of the URDF."""
    links = [str(link.get("name")) for link in read_tree(urdf).findall("link")]
    out = {}
    for name, settings in mapping(spec.get("imus"), "imus.").items():
        settings = mapping(settings, f"imus.{name}.")
        check_keys(settings, ("link",), f"imus.{name}.")
        link = str(settings.get("link", ""))
        if link not in links:
            raise MachineError(f"imus.{name}.link: no link {link!r}; {nearest(link, links)}")
        out[str(name)] = Imu(str(name), link)
    return out


def loops(spec: Mapping[str, Any], axes: tuple[str, ...]) -> dict[str, LoopShape]:
    """Return the closed loop of the axes that state one: its order, and on which encoder it is closed."""
    out = {}
    for name, settings in mapping(spec.get("loop"), "loop.").items():
        check_keys({name: None}, axes, "loop.")
        settings = dict(mapping(settings, f"loop.{name}."))
        check_keys(settings, LOOP_KEYS, f"loop.{name}.")
        closed_on = settings.pop("closed_on", "motor")
        if closed_on not in ("motor", "load"):
            raise MachineError(f"loop.{name}.closed_on: expected motor or load, found {closed_on!r}")
        given = {k: _loop_setting(k, v, f"loop.{name}.{k}") for k, v in settings.items()}
        shape = LoopShape(**given, closed_on=closed_on, stated=bool(given))
        if shape.real_poles + shape.pole_pairs < 1:
            raise MachineError(f"loop.{name}: needs at least one pole")
        ahead = len(shape.feedforward_poles) if isinstance(shape.feedforward_poles, tuple) else 2
        if shape.real_poles - ahead + 2 * shape.pole_pairs < 2:
            raise MachineError(
                f"loop.{name}: {shape.real_poles} real poles, {ahead} of them of the feed-forward, and "
                f"{shape.pole_pairs} pairs leave fewer than two for plant and feedback"
            )
        if closed_on == "load" and spec.get("transmission"):
            raise MachineError(
                f"loop.{name}.closed_on: a loop on the load's encoder behind a transmission of several motors is "
                "not modelled; give the motor's encoder"
            )
        out[str(name)] = shape
    return out


def _loop_setting(key: str, value: Any, where: str) -> Any:
    """Return one setting of the black box of a loop, checked."""
    if key in ("real_poles", "pole_pairs"):
        return whole(value, where, 0, 20)
    if key == "numerators":
        if value not in ("exact", "source"):
            raise MachineError(f"{where}: expected exact or source, found {value!r}")
        return value
    if key == "bounds":
        found = {}
        for name, ends in mapping(value, f"{where}.").items():
            if not isinstance(ends, list) or len(ends) != 2:
                raise MachineError(f"{where}.{name}: expected [lower, upper], found {ends!r}")
            low, high = (number(x, f"{where}.{name}", positive=True) for x in ends)
            if not low < high:
                raise MachineError(f"{where}.{name}: expected [lower, upper], found {ends!r}")
            found[str(name)] = (low, high)
        return found
    if value == "search":
        return value
    if not isinstance(value, list):
        raise MachineError(f"{where}: expected search, or a list of frequencies [Hz], found {value!r}")
    return tuple(number(x, where, positive=True) for x in value)


def columns(spec: Mapping[str, Any], names: tuple[str, ...], model: pin.Model) -> dict[str, Column]:
    """Return the columns; a channel must belong to an axis, a passive joint or a link."""
    columns = parse_columns(mapping(spec.get("columns"), "columns."), "columns")
    frames = [frame.name for frame in model.frames]
    for channel in columns:
        owner, _, signal = channel.rpartition(".")
        if owner and signal in AXIS_SIGNALS and owner not in names:
            raise MachineError(f"columns.{channel}: no axis {owner!r}; {nearest(owner, names)}")
        if owner and signal in LOAD_SIGNALS and owner not in frames:
            raise MachineError(f"columns.{channel}: no link {owner!r}; {nearest(owner, frames)}")
    return columns


def transmission(spec: Mapping[str, Any], axes: Mapping[str, Axis], nv: int) -> Floats | None:
    """Return the matrix from joint to motor positions, shape (nv, nv), or None for identity."""
    rows = mapping(spec.get("transmission"), "transmission.")
    if not rows:
        return None
    matrix = np.eye(nv)
    for motor, row in rows.items():
        check_keys({motor: None}, tuple(axes), "transmission.")
        row = mapping(row, f"transmission.{motor}.")
        check_keys(row, tuple(axes), f"transmission.{motor}.")
        matrix[axes[motor].index] = 0.0
        for joint, ratio in row.items():
            matrix[axes[motor].index, axes[joint].index] = number(ratio, f"transmission.{motor}.{joint}")
    if abs(np.linalg.det(matrix)) < 1e-12:
        raise MachineError("transmission: the matrix is singular; every joint needs a motor")
    return matrix


def data_settings(spec: Mapping[str, Any]) -> DataSettings:
    """Return how logs of this machine are prepared."""
    given = mapping(spec.get("data"), "data.")
    known = tuple(f.name for f in dataclasses.fields(DataSettings))
    check_keys(given, known, "data.")
    settings = DataSettings()
    for key, value in given.items():
        if value is not None:
            settings = replace(settings, **{key: _data_value(key, value)})
    return settings


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


def _data_value(key: str, value: Any) -> Any:
    where = f"data.{key}"
    if key == "filter_effort":
        return truth(value, where)
    if key == "drop":
        ends = value if isinstance(value, list) else [value, value]
        if len(ends) != 2:
            raise MachineError(f"{where}: expected samples at the start and the end, found {value!r}")
        return tuple(whole(x, where, 0) for x in ends)
    if key == "leave_out":
        return _left_out(value, where)
    if key in ("cutoff", "resample"):
        return number(value, where, positive=True)
    return whole(value, where, 1, 10 if key == "order" else None)


def _left_out(value: Any, where: str) -> tuple[LeftOut, ...]:
    """Return the rows of ``[[from, to], {channel: value}, ...]``, or of such a list per file name."""
    if isinstance(value, dict):
        return tuple(
            (str(file), first, last)
            for file, rows in value.items()
            for _, first, last in _left_out(rows, f"{where}.{file}")
        )
    if not isinstance(value, list):
        raise MachineError(
            f"{where}: expected a list such as [[1.5, 2.0]] in s or [{{feedrate: 50}}], found {value!r}"
        )
    return tuple(row for i, item in enumerate(value) for row in _left_out_item(item, f"{where}[{i}]"))


def _left_out_item(item: Any, where: str) -> list[LeftOut]:
    if isinstance(item, dict) and item:
        return [
            ("", str(channel), number(x, f"{where}.{channel}"))
            for channel, values in item.items()
            for x in (values if isinstance(values, list) else [values])
        ]
    if not isinstance(item, list) or len(item) != 2:
        raise MachineError(f"{where}: expected [from, to] in s or {{channel: value}}, found {item!r}")
    start, stop = (number(x, where) for x in item)
    if stop < start:
        raise MachineError(f"{where}: {start:g} to {stop:g} s runs backward")
    return [("", start, stop)]


def seconds(value: Any, where: str) -> float:
    """Return a time such as ``3.5 ms`` or ``0.0035`` (then in s) in seconds.

    Raises:
        MachineError: it is none.
    """
    text, _, unit = str(value).strip().partition(" ")
    factor = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}.get(unit.strip())
    if factor is None:
        raise MachineError(f"{where}: expected a time such as 3.5 ms, found {value!r}")
    return factor * number(text if isinstance(value, str) else value, where)
