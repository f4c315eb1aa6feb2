"""ROS recordings: what was written comes back under the contract's names, without ROS."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from pinotwin.errors import LogError
from pinotwin.logs.files import read
from tests.ros_bags import write_bag

JOINTS = ("shoulder", "elbow")


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(2)
    channels = {"t": 0.008 * np.arange(120)}
    for joint in JOINTS:
        for signal in ("q", "v", "u", "qr"):
            channels[f"{joint}.{signal}"] = rng.normal(size=120)
    return channels


def same(read_back: object, log: dict[str, np.ndarray], signals: str) -> None:
    for joint in JOINTS:
        for signal in signals.split():
            np.testing.assert_array_equal(read_back[f"{joint}.{signal}"], log[f"{joint}.{signal}"])
    np.testing.assert_allclose(read_back.t, log["t"], atol=1e-9)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("by", ["folder", "file"])
def test_ros2_bag(tmp_path: Path, log: dict[str, np.ndarray], storage: str, by: str) -> None:
    bag = write_bag(tmp_path / "bag", log, storage=storage)
    path = bag if by == "folder" else next(p for p in bag.iterdir() if p.suffix in (".mcap", ".db3"))
    back = read(path)
    assert set(back.channels) == {"t", *(f"{j}.{s}" for j in JOINTS for s in "qvu")}
    same(back, log, "q v u")


def test_ros1_bag(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    same(read(write_bag(tmp_path / "run.bag", log, storage="ros1")), log, "q v u")


def test_the_controllers_state_gives_the_command_and_the_force_sensor_its_wrench(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    back = read(write_bag(tmp_path / "bag", log, command=True, wrench=True))
    same(back, log, "q v u qr")
    np.testing.assert_allclose(back["tool0.wrench_fx"], log["t"], atol=1e-9)
    assert back["tool0.wrench_mz"][0] == 6.0
    assert "/arm_controller/controller_state: 2 channels that another topic holds were left" in back.notes


def test_an_imu_beside_the_joints_is_read_on_its_own_clock(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    bag = write_bag(tmp_path / "bag", log, imu=True)
    alone = read(bag, only="imu.")
    assert set(alone.channels) == {"imu.t", *(f"imu.{s}" for s in ("gx", "gy", "gz", "ax", "ay", "az"))}
    np.testing.assert_allclose(np.diff(alone["imu.t"]), 0.002, atol=1e-9)
    joints = read(bag)  # the IMU holds more numbers, but a servo log is asked for
    same(joints, log, "q v u")
    assert any(note.startswith("left out, not of length 120: imu") for note in joints.notes)


def test_a_bag_of_an_imu_alone_has_the_names_of_an_imu_log(tmp_path: Path) -> None:
    back = read(write_bag(tmp_path / "bag", {"t": np.arange(3) * 0.1}, imu=True))
    assert set(back.channels) == {"t", "gx", "gy", "gz", "ax", "ay", "az"}
    np.testing.assert_allclose(back["gz"], back.t, atol=1e-9)


def test_joints_in_another_order_in_every_message(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    turned = {"t": log["t"], **{k: v for k, v in reversed(log.items()) if k != "t"}}
    same(read(write_bag(tmp_path / "bag", turned)), log, "q v u")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3", "ros1"])
def test_a_slower_gripper_and_doubled_messages_on_the_topic_of_an_arm(
    tmp_path: Path, log: dict[str, np.ndarray], storage: str
) -> None:
    name = "run.bag" if storage == "ros1" else "bag"
    back = read(write_bag(tmp_path / name, log, storage=storage, gripper=True))
    same(back, log, "q v u")
    assert any("repeated messages were dropped" in note for note in back.notes)
    assert any(note.startswith("left out, sampled every 0.04") and "finger.q" in note for note in back.notes)


def test_json_lines_of_two_publishers_give_every_joint_its_own_clock(tmp_path: Path) -> None:
    def line(ms: int, joints: dict[str, float]) -> str:
        stamp = {"sec": 5, "nanosec": ms * 10**6}
        return json.dumps({"header": {"stamp": stamp}, "name": list(joints), "position": [*joints.values()]})

    rows = [
        (10 * i, {"a": float(i), "b": -float(i)} if i % 2 else {"b": -float(i), "a": float(i)})
        for i in range(40)
    ]
    rows += [(50 * i + 4, {"finger": 0.02}) for i in range(8)]
    (tmp_path / "run.jsonl").write_text("\n".join(line(*row) for row in sorted(rows, key=lambda r: r[0])))
    back = read(tmp_path / "run.jsonl")
    np.testing.assert_allclose(back.t, 0.01 * np.arange(40), atol=1e-9)
    np.testing.assert_array_equal(back["a.q"], np.arange(40.0))
    np.testing.assert_array_equal(back["b.q"], -np.arange(40.0))
    assert any("finger.q" in note for note in back.notes)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3", "ros1"])
def test_a_damaged_bag_is_one_line(tmp_path: Path, log: dict[str, np.ndarray], storage: str) -> None:
    bag = write_bag(tmp_path / "run.bag", log, storage=storage)
    path = bag if bag.is_file() else next(p for p in bag.iterdir() if p.suffix != ".yaml")
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    said = []
    for _ in range(25):
        raw = bytearray(whole)
        at = int(rng.integers(100, len(raw)))
        raw[at : at + 60] = rng.bytes(60)
        path.write_bytes(raw[: len(raw) // 2] if rng.random() < 0.3 else raw)
        try:
            read(bag)
        except LogError as error:
            said.append(str(error))
    assert said
    assert all("\n" not in text for text in said)


def test_an_empty_message_is_one_line(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    bag = write_bag(tmp_path / "bag", log, storage="sqlite3")
    with sqlite3.connect(next(bag.glob("*.db3"))) as base:
        base.executescript(
            "CREATE TABLE m AS SELECT * FROM messages; DROP TABLE messages; ALTER TABLE m RENAME TO messages;"
            "UPDATE messages SET data = NULL WHERE id = 5"
        )
    with pytest.raises(LogError, match="is damaged or cut off"):
        read(bag)


def test_a_bag_without_numbers_names_its_topics(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        kind = "sensor_msgs/msg/Image"
        bag.add_connection("/camera", kind, typestore=store)
    with pytest.raises(LogError, match=r"no messages of numbers \(topics: /camera \(sensor_msgs/msg/Image\)"):
        read(tmp_path / "bag")


def test_the_real_bag_of_a_ur10(data_dir: Path) -> None:
    log = read(data_dir / "ur10_rosbag" / "ur10_exciting_trajectory.db3")
    assert len(log) == 3441
    assert {"elbow_joint.q", "elbow_joint.v", "elbow_joint.u", "wrist_3_joint.u"} <= set(log.channels)
    np.testing.assert_allclose(np.diff(log.t), 0.008, atol=1e-8)
    # the velocity in the messages is the derivative of the position in them
    np.testing.assert_allclose(
        np.gradient(log["elbow_joint.q"], log.t)[50:-50], log["elbow_joint.v"][50:-50], atol=0.02
    )
