"""Writes ROS bags as a recorder does: joint states, a controller's state, an IMU, a force sensor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_POINT = "trajectory_msgs/JointTrajectoryPoint"
_CONTROLLER = (
    f"std_msgs/Header header\nstring[] joint_names\n{_POINT} reference\n{_POINT} feedback\n{_POINT} error\n"
)
_START = 1_700_000_000 * 10**9


class Messages:
    """Makes the messages of one log."""

    def __init__(self, log: Mapping[str, np.ndarray], ros1: bool) -> None:
        self.log, self.ros1 = log, ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.store.register(
            get_types_from_msg(_CONTROLLER, "control_msgs/msg/JointTrajectoryControllerState")
        )
        self.types = self.store.types
        self.joints = [name[:-2] for name in log if name.endswith(".q")]

    def header(self, t: float, frame: str = "") -> object:
        ns = _START + round(t * 1e9)
        time = self.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        seq = {"seq": 0} if self.ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **seq)

    def column(self, i: int, signal: str) -> np.ndarray:
        held = (f"{joint}.{signal}" for joint in self.joints)
        return np.array([self.log[name][i] for name in held if name in self.log], dtype=float)

    def joint_state(self, i: int, t: float) -> object:
        columns = [self.column(i, signal) for signal in "qvu"]
        return self.types["sensor_msgs/msg/JointState"](self.header(t), self.joints, *columns)

    def finger(self, i: int, t: float) -> object:
        none = np.array([])
        return self.types["sensor_msgs/msg/JointState"](
            self.header(t), ["finger"], np.array([0.02]), none, none
        )

    def controller(self, i: int, t: float) -> object:
        none, zero = np.array([]), self.types["builtin_interfaces/msg/Duration"](0, 0)
        columns = (self.column(i, "qr"), self.column(i, "q"), np.zeros(len(self.joints)))
        point = self.types["trajectory_msgs/msg/JointTrajectoryPoint"]
        points = [point(x, none, none, none, zero) for x in columns]
        kind = self.types["control_msgs/msg/JointTrajectoryControllerState"]
        return kind(self.header(t), self.joints, *points)

    def vector(self, x: float, y: float, z: float) -> object:
        return self.types["geometry_msgs/msg/Vector3"](x, y, z)

    def imu(self, i: int, t: float) -> object:
        still, nine = self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), np.zeros(9)
        turn, push = self.vector(0.1, 0.2, t), self.vector(0.0, 0.0, 9.81)
        kind = self.types["sensor_msgs/msg/Imu"]
        return kind(self.header(t, "imu_link"), still, nine, turn, nine, push, nine)

    def wrench(self, i: int, t: float) -> object:
        force = self.types["geometry_msgs/msg/Wrench"](self.vector(t, 2.0, 3.0), self.vector(4.0, 5.0, 6.0))
        return self.types["geometry_msgs/msg/WrenchStamped"](self.header(t, "tool0"), force)


def with_checksums(path: Path, compression: str, *, data: bool = False) -> Path:
    """Write an MCAP file of ROS 2 again with the checksums of the format, which rosbags leaves out."""
    with path.open("rb") as file:
        held = list(make_reader(file).iter_messages())
    with path.open("wb") as file:
        kind = CompressionType[compression.upper()]
        writer = Writer(file, chunk_size=16_384, compression=kind, enable_data_crcs=data)
        writer.start(profile="ros2")
        known: dict[int, int] = {}
        for schema, channel, message in held:
            if channel.id not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, "cdr", number, channel.metadata)
            writer.add_message(
                known[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    return path


def write_bag(
    path: Path,
    log: Mapping[str, np.ndarray],
    *,
    storage: str = "mcap",
    command: bool = False,
    imu: bool = False,
    wrench: bool = False,
    gripper: bool = False,
    compression: CompressionMode | None = None,
    chunks: Literal["BZ2", "LZ4"] | None = None,
) -> Path:
    """Write channels ``<joint>.q .v .u .qr`` and the clock ``t``; returns the folder (ROS 1: the file)."""
    ros1 = storage == "ros1"
    make, t = Messages(log, ros1), log["t"]
    fine = np.arange(0.0, t[-1], 0.002)
    topics = [
        ("/joint_states", "sensor_msgs/msg/JointState", make.joint_state, t, bool(make.joints)),
        (
            "/arm_controller/controller_state",
            "control_msgs/msg/JointTrajectoryControllerState",
            make.controller,
            t,
            command,
        ),
        ("/joint_states", "sensor_msgs/msg/JointState", make.joint_state, t, gripper),  # held twice
        ("/joint_states", "sensor_msgs/msg/JointState", make.finger, t[::5] + 0.004, gripper),
        ("/ft_sensor", "geometry_msgs/msg/WrenchStamped", make.wrench, t, wrench),
        ("/imu", "sensor_msgs/msg/Imu", make.imu, fine, imu),
    ]
    plugin = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}.get(storage)
    serialize = make.store.serialize_ros1 if ros1 else make.store.serialize_cdr
    writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    if chunks:
        writer.set_compression(Writer1.CompressionFormat[chunks])
    if compression:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer as bag:
        connections: dict[str, object] = {}
        for topic, kind, message, times, wanted in topics:
            if not wanted:
                continue
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=make.store)
            connection = connections[topic]
            for i, at in enumerate(times):
                raw = serialize(message(i, float(at)), kind)
                bag.write(connection, _START + round(float(at) * 1e9) + 300_000, bytes(raw))
    return path
