"""Helper of examples 04 and 05: a ROS 2 bag of a robot whose masses and friction are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import pinotwin as pt

START = 1_700_000_000 * 10**9


def excited(machine: pt.Machine, seconds: float, seed: int, rate: float = 125.0) -> dict[str, np.ndarray]:
    """Return ``t`` and ``<joint>.q .v .u`` of all axes moving on sums of five sines.

    The effort is Pinocchio's RNEA with the URDF's masses, viscous and dry friction of 3 and 5 % of the largest
    effort, and noise of 1 %.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    low, high = machine.model.lowerPositionLimit, machine.model.upperPositionLimit
    w = 2 * np.pi * 0.1 * np.arange(1, 6)[:, None, None]
    size = 0.25 * np.minimum(high - low, 2.0) / np.arange(1, 6)[:, None]
    angle = w * t[None, :, None] + rng.uniform(0, 2 * np.pi, (5, 1, machine.nv))
    c = (size * rng.uniform(0.3, 1.0, (5, machine.nv)))[:, None, :]
    q = (c * np.sin(angle)).sum(0) + np.clip(0.0, low, high) / 2 + np.clip((low + high) / 2, -1.5, 1.5) / 2
    v, a = (c * w * np.cos(angle)).sum(0), -(c * w**2 * np.sin(angle)).sum(0)
    data = machine.model.createData()
    u = np.array([pin.rnea(machine.model, data, *row) for row in zip(q, v, a, strict=True)])
    top = np.abs(u).max(axis=0)
    u += 0.03 * top * v / np.abs(v).max(axis=0) + 0.05 * top * np.tanh(v / 1e-3)
    u += 0.01 * np.std(u, axis=0) * rng.normal(size=u.shape)
    out = {"t": t}
    for name, axis in machine.axes.items():
        out.update({f"{name}.{s}": x[:, axis.index] for s, x in (("q", q), ("v", v), ("u", u))})
    return out


def write_bag(folder: Path, log: dict[str, np.ndarray]) -> Path:
    """Write the log as a recorder would: /joint_states in MCAP, encoded as CDR."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    joints = [name[:-2] for name in log if name.endswith(".q")]
    columns = {s: np.column_stack([log[f"{j}.{s}"] for j in joints]) for s in "qvu"}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = bag.add_connection("/joint_states", kind.__msgtype__, typestore=store)
        for i, t in enumerate(log["t"]):
            now = START + round(float(t) * 1e9)
            stamp = store.types["builtin_interfaces/msg/Time"](sec=now // 10**9, nanosec=now % 10**9)
            message = kind(header(stamp=stamp, frame_id=""), joints, *(columns[s][i] for s in "qvu"))
            bag.write(topic, now, bytes(store.serialize_cdr(message, kind.__msgtype__)))
    return folder
