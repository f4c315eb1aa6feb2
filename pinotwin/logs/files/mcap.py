"""MCAP recordings of JSON objects; ROS messages: :mod:`pinotwin.logs.files.rosbag`. Without ``t``: time of logging."""

from __future__ import annotations

import json
from pathlib import Path

from mcap.reader import make_reader

from pinotwin.errors import LogError
from pinotwin.logs.files.checksums import BROKEN_MCAP, REMEDY, verify
from pinotwin.logs.files.clocks import take_messages
from pinotwin.logs.files.content import Content, limited, undamaged
from pinotwin.logs.files.messages import Table, numbers

ROS_ENCODINGS = ("cdr", "ros1", "ros1msg")


def load(path: Path, source: str) -> Content:
    """Return the signals of an MCAP file, topic by topic."""
    tables: dict[str, Table] = {}
    text: set[str] = set()
    verify(path, source)
    with undamaged(source, BROKEN_MCAP, REMEDY), path.open("rb") as file:
        for _schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding in ROS_ENCODINGS:
                break
            if channel.message_encoding != "json":
                raise LogError(
                    f"{source}: topic {channel.topic!r} is encoded as "
                    f"{channel.message_encoding!r}; only JSON and ROS messages can be read, "
                    f"re-encode the topic or export it as CSV"
                )
            table = tables.setdefault(channel.topic, Table(source))
            limited(source, 8 * len(message.data), path.stat().st_size)  # an object for each few letters
            table.add(numbers(json.loads(message.data), "", text), message.log_time)
        else:
            return _content(tables, text, source)
    from pinotwin.logs.files.rosbag import load as load_ros

    return load_ros(path, source)


def _content(tables: dict[str, Table], text: set[str], source: str) -> Content:
    if not tables:
        raise LogError(f"{source}: holds no messages; record it again")
    content = Content(left_out=sorted(text))
    for topic, table in tables.items():
        prefix = "" if len(tables) == 1 else topic.strip("/").replace("/", ".") + "."
        take_messages(content, topic, prefix, table, source, "time of logging")
    return content
