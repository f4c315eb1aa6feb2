"""Helper of examples 04 and 05: a ROS 2 bag of a robot whose masses and friction are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import pinotwin as pt

START = 1_700_000_000 * 10**9


def motion(machine: pt.Machine, seconds: float, seed: int, rate: float = 125.0) -> tuple[np.ndarray, ...]:
    """Return t, q, v, a of all axes moving on sums of five sines."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    low, high = machine.model.lowerPositionLimit, machine.model.upperPositionLimit
    w = 2 * np.pi * 0.1 * np.arange(1, 6)[:, None, None]
    size = 0.25 * np.minimum(high - low, 2.0) / np.arange(1, 6)[:, None]
    angle = w * t[None, :, None] + rng.uniform(0, 2 * np.pi, (5, 1, machine.nv))
    c = (size * rng.uniform(0.3, 1.0, (5, machine.nv)))[:, None, :]
    q = (c * np.sin(angle)).sum(0) + np.clip(0.0, low, high) / 2 + np.clip((low + high) / 2, -1.5, 1.5) / 2
    return t, q, (c * w * np.cos(angle)).sum(0), -(c * w**2 * np.sin(angle)).sum(0)


def rigid_effort(machine: pt.Machine, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return Pinocchio's RNEA with the URDF's masses, row by row."""
    data = machine.model.createData()
    return np.array([pin.rnea(machine.model, data, *row) for row in zip(q, v, a, strict=True)])


def friction(machine: pt.Machine) -> tuple[np.ndarray, np.ndarray]:
    """Return viscous and dry friction of every axis: 3 and 5 % of its largest effort on one motion."""
    _, q, v, a = motion(machine, 20.0, seed=0)
    top = np.abs(rigid_effort(machine, q, v, a)).max(axis=0)
    return 0.03 * top / np.abs(v).max(axis=0), 0.05 * top


def excited(machine: pt.Machine, seconds: float, seed: int, worn: str | None = None) -> dict[str, np.ndarray]:
    """Return ``t`` and ``<joint>.q .v .u`` of a motion, the effort with noise of 1 %.

    The dry friction of the axis ``worn`` is three times what it was.
    """
    t, q, v, a = motion(machine, seconds, seed)
    viscous, dry = friction(machine)
    dry = dry * [3.0 if name == worn else 1.0 for name in machine.axes]
    u = (
        rigid_effort(machine, q, v, a) + viscous * v + dry * np.tanh(v / 1e-3)
    )  # turns over within some 10 mrad/s
    u += 0.01 * np.std(u, axis=0) * np.random.default_rng([seed, 1]).normal(size=u.shape)
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
