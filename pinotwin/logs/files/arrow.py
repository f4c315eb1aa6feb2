"""Columns of an Arrow table as arrays, shared by the text and the Parquet reader."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pinotwin.logs.files.cells import is_clock
from pinotwin.logs.files.clocks import CARRIED, held, known_rows, on_one_clock, separated, written_on_change
from pinotwin.logs.files.content import Content, distinct, repeated
from pinotwin.logs.files.joint_states import joint_columns, stamps
from pinotwin.logs.files.long_form import is_text, spread


def take(table: pa.Table, content: Content, source: str, blank_is_missing: bool = False) -> None:
    """Move the columns of a table, but text, into ``content``, on one clock unless ``blank_is_missing``."""
    names = distinct(table.column_names)
    content.stated.update(repeated(names, table.column_names))
    table = table.rename_columns(names)
    clock = next((name for name in names if is_clock(name) or content.units.get(name) == "s"), None)
    if clock is not None and _is_number(table.column(clock).type) and spread(table, clock, content):
        return
    texts: dict[str, str] = {}
    for name, column in zip(names, table.columns, strict=True):
        kind = column.type
        if pa.types.is_timestamp(kind) or pa.types.is_date(kind) or pa.types.is_duration(kind):
            content.add(name, column.to_numpy())
        elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
            _take_list(name, column, content)
        elif pa.types.is_null(kind):
            content.notes.append(f"{name}: all {len(column)} values are missing; left out")
        elif _is_number(kind):
            content.add(name, _floats(column))
        else:
            content.left_out.append(name)
            values = pc.unique(pc.drop_null(column)).to_pylist() if is_text(kind) else []
            texts.update({name: values[0]} if len(values) == 1 else {})
    _name_joints(names, texts, clock is None, content)
    if clock in content.arrays and not blank_is_missing:
        _onto_one_clock(clock, content, source)


def _name_joints(names: list[str], texts: dict[str, str], timeless: bool, content: Content) -> None:
    """Give the columns of joint states the names that stand in the table, and a table without a clock its stamps."""
    joints = joint_columns(names, texts, content.arrays)
    if not joints:
        return
    t = stamps(names, content.arrays) if timeless else None
    content.arrays = {joints.get(name, name): x for name, x in content.arrays.items()}
    found = dict.fromkeys(joint.rpartition(".")[0] for joint in joints.values())
    content.notes.append(f"joints by their names in the file: {', '.join(found)}")
    if t is not None:
        content.arrays = {"t": t, **{k: x for k, x in content.arrays.items() if k not in names[:2]}}
        content.units["t"] = "s"
        content.notes.append("t: seconds and nanoseconds of the stamps, from the first on")


def _onto_one_clock(clock: str, content: Content, source: str) -> None:
    """Put channels that stand in rows of their own (PlotJuggler) onto the clock of most; carry changes forward."""
    t, known = known_rows(clock, content.arrays)
    if written_on_change(content.arrays, known):
        for name, here in known.items():
            content.arrays[name] = held(t[here], content.arrays[name][here].astype(float), t)
        content.notes.append(f"{CARRIED}: {', '.join(known)}")
        return
    groups = separated(clock, content.arrays, t, known)
    if groups:
        t, channels, notes = on_one_clock(groups, source)
        content.arrays = {clock: t, **channels}
        content.notes += notes


def _is_number(kind: pa.DataType) -> bool:
    checks = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal)
    return any(check(kind) for check in checks)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    wide = column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False)
    full = pc.fill_null(wide, float("nan")) if wide.null_count else wide
    # to_numpy would import pandas, which takes longer than reading most logs
    return np.concatenate([np.zeros(0), *(np.from_dlpack(chunk) for chunk in full.chunks if len(chunk))])


def _take_list(name: str, column: pa.ChunkedArray, content: Content) -> None:
    """A vector in every row becomes a matrix, if all rows hold as many numbers, and no more than there are rows."""
    lengths = pc.unique(pc.list_value_length(column)).to_pylist()
    flat = pc.list_flatten(column)
    if len(lengths) != 1 or not 0 < (lengths[0] or 0) <= len(column) or not _is_number(flat.type):
        content.left_out.append(name)
        return
    matrix = _floats(flat).reshape(len(column), lengths[0])
    parts = content.parts.get(name, [])
    named = len(set(parts)) == lengths[0]
    for i in range(lengths[0]):
        content.add(f"{name}.{parts[i]}" if named else f"{name}[{i}]", matrix[:, i])
