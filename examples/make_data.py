"""Writes the recordings of ``examples/data`` that the tutorials use: run it again to make them anew.

Run: .venv/bin/python examples/make_data.py. Every file comes from a machine whose truth is known: the virtual
trunnion (``pinotwin record``) for the CNC and the IMU, Pinocchio's inverse dynamics plus friction for the arm.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from robot_bag import START, excited
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import pinotwin as pt
from pinotwin.logs.write import write_log
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.imu import record_imu

DATA = Path(__file__).parent / "data"
NEWTON_PER_AMPERE = {"Y": 35.0, "A": 3.1, "C": 2.2}
"""Torque constant times gear of the trunnion's drives, as its builder would know them."""


def scope(path: Path, log: Mapping[str, np.ndarray], rotary: str = "AC") -> None:
    """Write a trace in the layout of TNCscope: a block for each curve, then rows with the time in µs."""
    signals = [(axis, name) for axis in NEWTON_PER_AMPERE for name in ("s soll", "s ist", "I ist")]
    step = round(1e6 * float(log["t"][1] - log["t"][0]))
    rows = len(log["t"])
    head = [
        "%TNCscopeNT data file",
        "% ",
        "%[GLOBAL]",
        "%VERSION=2.0",
        "%CONTROL=iTNC530",
        f"%SAMPLING={step}",
        "% ",
    ]
    columns = [1e6 * log["t"]]
    for k, (axis, name) in enumerate(signals, 1):
        unit = "A" if name == "I ist" else "Grad" if axis in rotary else "mm"
        head += [f"%[CURVE{k}]", f"%NAME={name}/{axis}", f"%CHANNELTYPE={name}", f"%AXISTYPE={axis}"]
        head += [
            f"%DIMENSION={unit}",
            f"%COUNT={rows}",
            f"%SAMPLING={step}",
            f"%COLUMN={k}",
            "%NUMSYS=d",
            "% ",
        ]
        x = log[f"{axis}.{ {'s soll': 'qr', 's ist': 'q', 'I ist': 'u'}[name] }"]
        scale = {"A": 1 / NEWTON_PER_AMPERE[axis], "Grad": np.rad2deg(1.0), "mm": 1e3}[unit]
        columns.append(scale * x)
    digits = ["%d"] + ["%.3f" if name == "I ist" else "%.4f" for _, name in signals]
    body = [
        ";".join(f % x for f, x in zip(digits, row, strict=True)) + ";" for row in zip(*columns, strict=True)
    ]
    path.write_bytes("\r\n".join([*head, "%[DATA]", *body, ""]).encode("latin-1"))


def cnc(folder: Path, seconds: float = 16.0) -> None:
    """Write two healthy programs, and one of them twice on the day when Y's viscous friction has risen."""
    healthy = VirtualMachine.load(pt.machines()["trunnion"])
    worn = VirtualMachine.load(pt.machines()["trunnion"], inject=["viscous:Y=0.4"])
    traces = {"healthy": (healthy, 1, 1), "other_program": (healthy, 5, 3)}
    traces |= {"monday": (worn, 1, 21), "monday_again": (worn, 1, 22)}
    for name, (machine, program, noise) in traces.items():
        log = machine.record(random_trajectory(machine, seconds, program), seed=noise).to_log()
        every_second = {channel: x[::2] for channel, x in (log.channels | {"t": log.t}).items()}
        scope(folder / f"{name}.sco", every_second)


def bag(folder: Path, log: Mapping[str, np.ndarray], rng: np.random.Generator) -> None:
    """Write /joint_states as two publishers share it: the arm at 100 Hz and its gripper at 20 Hz."""
    shutil.rmtree(folder, ignore_errors=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    joints = [name[:-2] for name in log if name.endswith(".q")]
    # A gear encoder of 17 bits a turn of 1 rad, speeds and torques as an arm's controller rounds them.
    steps = {"q": 2.0**-17, "v": 2.0**-12, "u": 2.0**-6}
    arm = {s: np.column_stack([np.round(log[f"{j}.{s}"] / h) * h for j in joints]) for s, h in steps.items()}
    messages = [(float(t), joints, [arm[s][i] for s in "qvu"]) for i, t in enumerate(log["t"])]
    for t in np.arange(0.003, log["t"][-1], 0.05):
        opening = np.array([round(0.4 + 0.4 * np.sin(t), 3)])
        messages.append((t, ["robotiq_85_left_knuckle_joint"], [opening, 0 * opening, 0 * opening]))
    messages.sort(key=lambda message: message[0])
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for t, names, columns in messages:
            now = START + round(t * 1e9)
            stamp = time(sec=now // 10**9, nanosec=now % 10**9)
            message = state(header(stamp=stamp, frame_id=""), names, *columns)
            late = now + int(rng.uniform(1e5, 2e6))  # the recorder's own clock
            writer.write(topic, late, bytes(store.serialize_cdr(message, state.__msgtype__)))


def arm(folder: Path, seconds: float = 16.0) -> None:
    """Write two motions of a healthy UR5, and one after the dry friction of its elbow has tripled."""
    machine, rng = pt.Machine.load("ur5"), np.random.default_rng(1)
    for name, seed, worn in (("excite", 1, None), ("other", 2, None), ("today", 3, "elbow_joint")):
        log = excited(machine, seconds, seed, worn)
        bag(folder / name, log, rng)


def imu(folder: Path, seconds: float = 8.0) -> None:
    """Write the trunnion on its flexure: servo log at 250 Hz and the IMU of its table on its own clock."""
    machine = VirtualMachine.load(pt.machines()["flexure_rig"])
    motion, fine = random_trajectory(machine, seconds, 1), machine.truth.control_rate
    recorded = machine.record(motion, seed=1, truth_rate=fine)
    write_log(folder / "servo.parquet", recorded.log)
    (link,) = (imu.link for imu in pt.Machine.load("flexure_rig").imus.values())
    write_log(folder / "imu.parquet", record_imu(recorded.truth, link, machine.truth.seed, 1, 1).channels)


def main() -> None:
    """Write all of them."""
    for make in (cnc, arm, imu):
        folder = DATA / make.__name__
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        make(folder)
    for path in sorted(p for p in DATA.rglob("*") if p.is_file()):
        print(f"{path.stat().st_size / 1e3:8.0f} kB  {path.relative_to(DATA)}")


if __name__ == "__main__":
    main()
