"""JSON documents (columns, or a list of messages, perhaps below keys) and JSON lines (a message a line)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.errors import LogError
from pinotwin.logs.files.clocks import take_messages
from pinotwin.logs.files.content import Content, undamaged
from pinotwin.logs.files.messages import Table, numbers, stamp


def load(path: Path, source: str) -> Content:
    """Return the signals of a JSON document or of JSON lines."""
    content = Content()
    broken = ValueError, RecursionError, OSError
    with undamaged(source, broken, "write it again"), path.open(encoding="utf-8-sig") as file:
        first, second = file.readline(), file.readline()
        file.seek(0)
        in_lines = False
        with suppress(ValueError):
            in_lines = bool(second.strip()) and isinstance(json.loads(first), dict)
        if in_lines:
            _take_rows((json.loads(line) for line in file if line.strip()), "", content)
            return content
        value = json.load(file)
    if not isinstance(value, dict | list):
        raise LogError(f"{source}: holds a single value; write the signals as lists")
    _take(value, "", content)
    return content


def _take(value: Any, name: str, content: Content) -> None:
    if _is_table(value):
        _take_rows(value, name, content)
    elif isinstance(value, Mapping):
        only = sum(_is_table(item) for item in value.values()) == 1
        for key, item in value.items():
            plain = only and _is_table(item) and not name  # settings beside the one list of messages
            _take(item, "" if plain else (f"{name}.{key}" if name else str(key)), content)
    elif isinstance(value, list):
        try:
            content.add(name or "value", np.array(value, dtype=float))
        except (ValueError, TypeError):
            content.left_out.append(name)
    elif isinstance(value, bool | int | float):
        content.add(name, float(value))
    elif value is not None:
        content.left_out.append(name)


def _is_table(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)


def _take_rows(rows: Iterable[object], name: str, content: Content) -> None:
    table, text = Table(name or "the messages"), set[str]()
    for row in rows:
        if not isinstance(row, Mapping):
            raise ValueError(f"row {table.rows} is no object")
        table.add(numbers(row, "", text), stamp(row))
    content.left_out += sorted(text)
    take_messages(content, name or "t", f"{name}." if name else "", table, name or "the messages")
