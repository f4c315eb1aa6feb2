"""A log or a simulation as a recording for the Rerun viewer (rerun.io; ``pip install rerun-sdk``)."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin

from pinotwin.errors import InputError
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.simulation.score import bound, measured
from pinotwin.system.writing import write_bytes
from pinotwin.viewer.scene import joint_poses, visual_model
from pinotwin.viewer.stage import triangles_of

SIGNALS = {"e": ("tracking error", "m", "rad"), "u": ("effort", "N", "N·m")}
"""Signal -> its name, and its units on a slide and on an axis that turns."""


def check_recording(path: str | Path) -> None:
    """Refuse a recording under another suffix, or where Rerun is not installed, by an InputError."""
    if Path(path).suffix != ".rrd":
        raise InputError(f"--rrd: {Path(path).name}: a recording for Rerun is written as .rrd")
    if importlib.util.find_spec("rerun") is None:
        raise InputError("--rrd: Rerun is not installed; pip install rerun-sdk, or leave --rrd out")


def write_recording(path: str | Path, machine: Machine, log: Log, predicted: Log | None = None) -> str:
    """Write a ``.rrd`` of the predicted motion, or the measured one, and all signals; return how to see it."""
    check_recording(path)
    import rerun as rr

    stream = rr.RecordingStream(f"pinotwin {machine.name}")
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "draft.rrd"
        stream.save(str(draft))
        _fill(rr, stream, machine, log, predicted)
        stream.disconnect()
        write_bytes(path, draft.read_bytes())
    return f"recording written to {path}; open it with: rerun {path}"


def _fill(rr: ModuleType, stream: Any, machine: Machine, log: Log, predicted: Log | None) -> None:
    _machine(rr, stream, machine, log if predicted is None else predicted)
    log = bound(machine, log)
    t = np.asarray(log.t - log.t[0])
    for axis in machine.axes:
        turns = machine.axis(axis).rotary
        for signal, (name, *units) in SIGNALS.items():
            lines = {} if predicted is None else {"predicted": predicted[f"{axis}.{signal}"]}
            if signal in (known := measured(machine, log, axis)):
                lines["measured"] = known[signal]
            for who, y in lines.items():
                entity = rr.new_entity_path([axis, name, who])
                label = rr.SeriesLines(names=f"{axis} {name} [{units[turns]}], {who}")
                stream.log(entity, label, static=True)
                time = rr.TimeColumn("time", duration=t)
                stream.send_columns(entity, indexes=[time], columns=rr.Scalars.columns(scalars=y))


def _machine(rr: ModuleType, stream: Any, machine: Machine, moves: Log, frames: int = 1500) -> None:
    """Write the shapes once, in the frames of their joints, and those of ``frames`` postures over time."""
    motion = prepare(machine, moves, decimate=1)
    model = machine.model
    rows = np.unique(np.linspace(0, len(motion) - 1, min(frames, len(motion))).astype(int))
    start = joint_poses(model, pin.neutral(model))
    stream.log("machine", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    shapes = triangles_of(model, visual_model(model, machine.urdf, machine.meshes), pin.neutral(model))
    for k, (joint, world, rgba) in enumerate(shapes):
        local = (world.reshape(-1, 3) - start[joint].translation) @ start[joint].rotation
        corners = np.arange(len(local)).reshape(-1, 3)
        mesh = rr.Mesh3D(vertex_positions=local, triangle_indices=corners, albedo_factor=rgba)
        stream.log(rr.new_entity_path(["machine", model.names[joint], f"shape {k}"]), mesh, static=True)
    poses = [joint_poses(model, motion.q[row]) for row in rows]
    time = rr.TimeColumn("time", duration=motion.t[rows] - motion.t[0])
    for joint in range(1, model.njoints):
        moved = rr.Transform3D.columns(
            translation=[pose[joint].translation for pose in poses],
            quaternion=[pin.Quaternion(pose[joint].rotation).coeffs() for pose in poses],
        )
        entity = rr.new_entity_path(["machine", model.names[joint]])
        stream.send_columns(entity, indexes=[time], columns=moved)
