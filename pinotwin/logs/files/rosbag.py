"""ROS recordings through ``rosbags``, without ROS: ROS 2 bags (MCAP or sqlite3, a file or a folder), ROS 1 bags.

    JointState                                   <joint>.q .v .u, by the names in the message
    JointTrajectoryControllerState (desired)     <joint>.qr
    Imu                                          gx gy gz ax ay az
    Wrench, WrenchStamped                        <frame>.wrench_fx _fy _fz _mx _my _mz

Joint states, commands and wrenches go on one clock; all else keeps its topic's name and clock (``imu.t``), to be read
by ``only=``. A wrench is in its sensor's axes: no external load (world axes) before ``columns`` says that it is.
"""

from __future__ import annotations

import bz2
import io
import sqlite3
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

import apsw
import lz4.frame
import numpy as np
import zstandard
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag2 import ReaderError as Reader2Error
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_typestore

from pinotwin.errors import LogError
from pinotwin.logs.files.checksums import Stream, unpacked, verify, zstd
from pinotwin.logs.files.clocks import Group, fresh, on_one_clock, streams
from pinotwin.logs.files.content import BROKEN, Content, undamaged
from pinotwin.logs.files.messages import Table, joint_names, joint_signals, numbers, seconds_since, stamp

_BROKEN = (
    *(*BROKEN, AssertionError, AnyReaderError, Reader1Error, Reader2Error, SerdeError, TypesysError),
    *(sqlite3.Error, apsw.Error, zstandard.ZstdError),
)


@dataclass
class _Topic:
    servo: bool  # whether it goes on the clock of the joints
    table: Table  # its numbers, and the stamps of the messages' headers [ns], 0 where not set
    logged: list[int] = field(default_factory=list)  # time of logging of each message [ns]

    @property
    def stamped(self) -> bool:
        """Whether the headers carry a clock: most messages that are not sent twice have a stamp of their own."""
        sent = fresh(np.array(self.table.stamps, dtype=float), self.table.arrays())
        return len(set(self.table.stamps)) > 0.5 * len(sent)


def load(path: Path, source: str) -> Content:
    """Return the signals of a ROS bag."""
    topics: dict[str, _Topic] = {}
    text: set[str] = set()
    unknown: dict[str, str] = {}
    with undamaged(source, _BROKEN, "repair it with `ros2 bag reindex` or copy it again"):
        if path.is_dir():
            _verify(path, source)
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            size, unpacked_to = sum(p.stat().st_size for p in (path, *path.glob("*"))), 0
            for stream in _packed(reader.readers[0]):
                unpacked_to = unpacked(stream, source, size, unpacked_to)
            known = [c for c in reader.connections if _known(reader, c, unknown)]
            for connection, logged, raw in reader.messages(connections=known) if known else ():
                _take(reader.deserialize(raw, connection.msgtype), connection, logged, topics, text)
            lost = list(_lost(known, topics))
    if not topics:
        held = ", ".join(f"{t} ({kind})" for t, kind in unknown.items()) or "none"
        raise LogError(f"{source}: holds no messages of numbers (topics: {held}); record /joint_states")
    content = _content(topics, text, unknown, source)
    content.notes += lost
    return content


def _verify(folder: Path, source: str) -> None:
    """Refuse a bag with files that are none, differ from their checksums or unpack to more than they may."""
    names = (folder / "metadata.yaml").read_text(errors="replace")
    for file in (p for p in folder.iterdir() if p.name in names and p.name != "metadata.yaml"):
        if not file.is_file():
            raise LogError(f"{source}: {file.name} is no file; record or copy the bag again")
        if file.suffix == ".mcap":
            verify(file, source)
        elif file.suffix == ".zstd":
            unpacked(zstd(file.open("rb")), source, file.stat().st_size)


def _packed(bag: Any) -> Iterator[Stream]:
    """Yield the messages of a bag where each is compressed, or the chunks of one of ROS 1, to be unpacked."""
    for storage in bag.storage.storages if getattr(bag, "compression_mode", None) == "message" else ():
        yield from (zstd(packed) for _, _, packed in storage.messages(storage.connections))
    streams_of = {bz2.decompress: bz2.open, lz4.frame.decompress: lz4.frame.open}
    for chunk in getattr(bag, "chunks", {}).values():
        if chunk.decompressor in streams_of:
            bag.bio.seek(chunk.datapos)
            yield streams_of[chunk.decompressor](io.BytesIO(bag.bio.read(chunk.datasize)))


def _lost(known: list[Connection], topics: dict[str, _Topic]) -> Iterator[str]:
    """Yield a note for each topic of which the bag states other messages than were read."""
    stated: Counter[str] = Counter()
    for connection in known:
        stated[connection.topic] += connection.msgcount
    for name, count in stated.items():
        read = len(topics[name].logged) if name in topics else 0
        if read != count:
            yield f"{name}: {read} messages where the bag states {count}: it is damaged, copy it again"


def _known(reader: AnyReader, connection: Connection, unknown: dict[str, str]) -> bool:
    """Whether the message type of a topic is known, and one of numbers."""
    heavy = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2")
    if connection.msgtype in reader.typestore.fielddefs and connection.msgtype not in heavy:
        return True
    unknown[connection.topic] = connection.msgtype
    return False


def _take(
    message: Any, connection: Connection, logged: int, topics: dict[str, _Topic], text: set[str]
) -> None:
    kind = connection.msgtype.rpartition("/")[2]
    value = _plain(message)
    joints = joint_names(value)
    servo = bool(joints) or kind in ("Wrench", "WrenchStamped")
    topic = topics.setdefault(connection.topic, _Topic(servo, Table(connection.topic)))
    if joints:
        pairs: Iterator[tuple[str, float]] = joint_signals(value, joints)
    elif servo:
        frame = str(value.get("header", {}).get("frame_id") or connection.topic.strip("/").replace("/", "_"))
        names = {"force": f"{frame}.wrench_f", "torque": f"{frame}.wrench_m"}
        pairs = _vectors(value.get("wrench", value), names)
    elif kind == "Imu":
        pairs = _vectors(value, {"angular_velocity": "g", "linear_acceleration": "a"})
    else:
        pairs = numbers(value, "", text)
    topic.table.add(pairs, stamp(value) or 0)
    topic.logged.append(logged)


def _plain(message: Any) -> Any:
    if is_dataclass(message):
        return {name: _plain(part) for name, part in vars(message).items()}
    if isinstance(message, np.ndarray):
        return message.tolist()
    return [_plain(item) for item in message] if isinstance(message, list) else message


def _vectors(value: dict[str, Any], parts: dict[str, str]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of vectors with their names: field -> name without the letter of the direction."""
    for part, name in parts.items():
        yield from ((name + axis, float(value[part][axis])) for axis in "xyz")


def _content(topics: dict[str, _Topic], text: set[str], unknown: dict[str, str], source: str) -> Content:
    content = Content(left_out=sorted(text))
    if unknown:
        held = ", ".join(f"{topic} ({kind})" for topic, kind in unknown.items())
        content.notes.append(f"topics left out, their messages are no known numbers: {held}")
    by_header = all(topic.stamped for topic in topics.values())
    clock = "the messages' headers" if by_header else "time of logging"
    content.notes.append(f"t: {clock}, in seconds since the first message")
    times = {name: topic.table.stamps if by_header else topic.logged for name, topic in topics.items()}
    origin = min(min(t) for t in times.values())
    servo = {name: topic for name, topic in topics.items() if topic.servo}
    if servo:
        groups = []
        for name, topic in servo.items():
            own, notes = streams(name, seconds_since(origin, times[name]), topic.table.arrays())
            groups += own
            content.notes += [f"{name}: {note}" for note in notes]
        t, channels, notes = on_one_clock(_without_doubles(groups, content), source)
        content.arrays.update({"t": t, **channels})
        content.units["t"] = "s"
        content.clock = "t"
        content.notes += notes
    for name, topic in topics.items():
        if not topic.servo:
            prefix = "" if len(topics) == 1 else name.strip("/").replace("/", ".") + "."
            content.arrays[f"{prefix}t"] = seconds_since(origin, times[name])
            content.units[f"{prefix}t"] = "s"
            content.arrays.update({prefix + key: x for key, x in topic.table.arrays().items()})
    return content


def _without_doubles(groups: list[Group], content: Content) -> list[Group]:
    """Keep a channel that several topics hold (as controllers do) once, from that with most measured channels."""
    measured = sorted(groups, key=lambda g: -sum(name.endswith(".u") for name in g.channels))
    held: set[str] = set()
    out = []
    for group in measured:
        double = held & set(group.channels)
        if double:
            content.notes.append(f"{group.clock}: {len(double)} channels that another topic holds were left")
        out.append(Group(group.clock, group.t, {k: x for k, x in group.channels.items() if k not in held}))
        held |= set(group.channels)
    return out
