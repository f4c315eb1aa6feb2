"""Playback of a trajectory as an animation, and where a scene goes: to a file or a browser."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import meshcat
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.system.writing import write_text
from pinotwin.viewer.scene import Scene, joint_path, joint_poses, place_joints
from pinotwin.viewer.stage import corners, set_stage

MAX_FRAMES = 1800
"""Longest animation; a longer log is shown at fewer frames per second."""

_POSTURES = 24  # so many of its postures decide how far away the camera stands


def play(drawn: Scene, t: Floats, q: Floats, fps: float = 30.0) -> Scene:
    """Return the scene with a trajectory as animation, in real time.

    Args:
        drawn: the scene.
        t: time [s], increasing, shape (n,).
        q: configurations in the model's order, shape (n, nq); rows with NaN are left out.
        fps: frames per second; less where the trajectory is long.

    Raises:
        DataError: shapes do not fit, or fewer than two usable rows.
    """
    times, rows, rate = _resampled(drawn.model, np.asarray(t, float), np.asarray(q, float), fps)
    playing = replace(drawn, page=drawn.page.copy(), q=rows[0])
    some = rows[:: max(1, len(rows) // _POSTURES)]
    set_stage(playing.viewer(), np.concatenate([corners(drawn.model, drawn.visual, row) for row in some]))
    place_joints(playing)
    clips = Animation(default_framerate=rate)
    for k in range(len(times)):
        frame = clips.at_frame(playing.viewer(), k)
        for joint, pose in enumerate(joint_poses(drawn.model, rows[k])):
            if joint:
                node = frame[joint_path(drawn.model, joint)]
                node.set_property("position", "vector3", pose.translation.tolist())
                turn = pin.Quaternion(pose.rotation).coeffs()
                node.set_property("quaternion", "quaternion", turn.tolist())
    playing.viewer().set_animation(clips, play=True, repetitions=1000)
    return playing


def _resampled(model: pin.Model, t: Floats, q: Floats, fps: float) -> tuple[Floats, Floats, float]:
    """Return times (k,), configurations (k, nq) and frames per second of the animation."""
    if q.ndim != 2 or q.shape != (len(t), model.nq):
        raise DataError(f"playback: q has shape {q.shape}, expected ({len(t)}, {model.nq})")
    good = np.isfinite(t) & np.all(np.isfinite(q), axis=1)
    t, q = t[good], q[good]
    if len(t) < 2 or np.any(np.diff(t) <= 0):
        raise DataError("playback: needs at least two rows with increasing time")
    rate = min(fps, MAX_FRAMES / (t[-1] - t[0]))
    times = np.arange(t[0], t[-1], 1.0 / rate)
    rows = np.column_stack([np.interp(times, t, column) for column in q.T])
    # Between two samples the cosine and sine of a continuous joint leave the circle a little.
    return times, np.array([pin.normalize(model, row) for row in rows]), rate


def save_html(path: str | Path, drawn: Scene, *, controls: bool = True) -> Path:
    """Write the scene as one self-contained page that opens without network; return its path.

    Args:
        path: the file; its folder is made.
        drawn: the scene.
        controls: whether to keep meshcat's control panel (needed to pause a playback).

    Raises:
        InputError: the file cannot be written.
    """
    path = Path(path)
    write_text(path, drawn.page.html(drawn.name, controls))
    return path


@dataclass(frozen=True)
class Live:
    """A scene in a browser; ends with the program, or earlier by ``close``.

    Attributes:
        url: where the browser finds it.
        window: meshcat's connection to its server.
    """

    url: str
    window: Any

    def close(self) -> None:
        """Stop the server of this window."""
        server = self.window.server_proc
        server.kill()
        server.wait()
        for stream in (server.stdout, server.stderr):
            stream.close()
        self.window.zmq_socket.close(linger=0)


def show(drawn: Scene, *, open_browser: bool = True) -> Live:
    """Serve the scene on this computer and open it in the browser."""
    with contextlib.redirect_stdout(io.StringIO()):  # meshcat announces its address by print
        viewer = meshcat.Visualizer()
    drawn.page.replay(viewer.window)
    if open_browser:
        viewer.open()
    return Live(viewer.url(), viewer.window)
