"""Columns of an Arrow table as arrays, shared by the text and the Parquet reader."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pinotwin.logs.files.content import Content, distinct


def take(table: pa.Table, content: Content) -> None:
    """Move the columns of a table into ``content``; text is left out."""
    stated = table.column_names
    names, counts = distinct(stated), Counter(stated)
    content.stated.update({name: old for name, old in zip(names, stated, strict=True) if counts[old] > 1})
    for name, column in zip(names, table.columns, strict=True):
        kind = column.type
        if pa.types.is_timestamp(kind) or pa.types.is_date(kind) or pa.types.is_duration(kind):
            content.add(name, column.to_numpy())
        elif _is_list(kind):
            _take_list(name, column, content)
        elif pa.types.is_null(kind):
            content.notes.append(f"{name}: all {len(column)} values are missing; left out")
        elif _is_number(kind):
            content.add(name, _floats(column))
        else:
            content.left_out.append(name)


def _is_number(kind: pa.DataType) -> bool:
    checks = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal)
    return any(check(kind) for check in checks)


def _is_list(kind: pa.DataType) -> bool:
    return pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    wide = column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False)
    full = pc.fill_null(wide, float("nan")) if wide.null_count else wide
    out, at = np.empty(len(full)), 0
    for chunk in full.chunks:  # to_numpy would import pandas, which takes longer than reading most logs
        out[at : at + len(chunk)] = np.from_dlpack(chunk) if len(chunk) else 0.0
        at += len(chunk)
    return out


def _take_list(name: str, column: pa.ChunkedArray, content: Content) -> None:
    """A vector in every row becomes a matrix, if all rows hold as many numbers."""
    lengths = pc.unique(pc.list_value_length(column)).to_pylist()
    flat = pc.list_flatten(column)
    if len(lengths) != 1 or not lengths[0] or not _is_number(flat.type):
        content.left_out.append(name)
        return
    matrix = _floats(flat).reshape(len(column), lengths[0])
    for i in range(lengths[0]):
        content.add(f"{name}[{i}]", matrix[:, i])
