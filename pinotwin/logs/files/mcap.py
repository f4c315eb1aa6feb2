"""MCAP recordings whose messages are JSON objects of numbers.

Nested objects get dotted names and lists ``[i]``. With one topic the names are those in the
message; with several each begins with its topic (``servo.Y.q``). Where a message has no ``t`` the
time of logging is it, in seconds since the topic's first message.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader

from pinotwin.errors import LogError
from pinotwin.logs.files.content import Content, damaged

_Rows = list[dict[str, float]]

# What the mcap package lets through when a record is damaged (ValueError: lengths, JSON, UTF-8;
# RuntimeError: lz4).
_BROKEN = (
    McapError,
    ValueError,
    RuntimeError,
    KeyError,
    OverflowError,
    MemoryError,
    struct.error,
    OSError,
    EOFError,
    zstandard.ZstdError,
)


def load(path: Path, source: str) -> Content:
    """Return the signals of an MCAP file, topic by topic."""
    rows: dict[str, _Rows] = {}
    times: dict[str, list[int]] = {}
    text: set[str] = set()
    try:
        with path.open("rb") as file:
            for _schema, channel, message in make_reader(file).iter_messages():
                if channel.message_encoding != "json":
                    raise LogError(
                        f"{source}: topic {channel.topic!r} is encoded as "
                        f"{channel.message_encoding!r}; only JSON messages of numbers can be read, "
                        f"re-encode the topic or export it as CSV"
                    )
                values = dict(_numbers(json.loads(message.data), "", text))
                rows.setdefault(channel.topic, []).append(values)
                times.setdefault(channel.topic, []).append(message.log_time)
    except _BROKEN as error:
        raise damaged(source, error, "recover it with `mcap recover`") from None
    if not rows:
        raise LogError(f"{source}: holds no messages; record it again")
    content = Content(left_out=sorted(text))
    for topic, messages in rows.items():
        prefix = "" if len(rows) == 1 else topic.strip("/").replace("/", ".") + "."
        _take_topic(prefix, messages, times[topic], content)
    return content


def _numbers(value: object, name: str, text: set[str]) -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float):
        yield name or "value", float(value)
    elif value is None:
        yield name or "value", float("nan")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(item, f"{name}.{key}" if name else str(key), text)
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from _numbers(item, f"{name}[{i}]", text)
    else:
        text.add(name)


def _take_topic(prefix: str, rows: _Rows, stamps: list[int], content: Content) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    for name in names:
        content.add(prefix + name, np.array([row.get(name, np.nan) for row in rows]))
    if "t" not in names:
        seconds = (np.array(stamps, dtype=np.int64) - stamps[0]) * 1e-9
        content.add(f"{prefix}t", seconds)
        content.units[f"{prefix}t"] = "s"
        content.notes.append(f"{prefix}t: time of logging, in seconds since the first message")
