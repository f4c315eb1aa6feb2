"""A small machine with a slide and an arm, and a log of it, for tests that spoil one of them."""

from __future__ import annotations

import functools
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinotwin.cli.main import main

URDF = """<robot name="rig">
  <link name="base"/>
  <link name="slide"><inertial><origin xyz="0 0 0"/><mass value="5"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.1 0 -0.2"/><mass value="2"/>
    <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.02"/></inertial></link>
  <joint name="jx" type="prismatic"><parent link="base"/><child link="slide"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="500" velocity="2"/></joint>
  <joint name="jb" type="revolute"><parent link="slide"/><child link="arm"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="10"/></joint>
</robot>
"""

YAML = """name: rig
urdf: rig.urdf
axes:
  X: {joint: jx}
  B: {joint: jb}
"""

# What least squares must find: mass and first moments from the URDF, friction from `good_log`.
TRUTH = {
    "rigid_body.m_jx*": 7.0,
    "rigid_body.mx_jb": 0.2,
    "rigid_body.mz_jb": -0.4,
    "X.viscous.b": 20.0,
    "X.coulomb.c": 8.0,
    "B.viscous.b": 0.5,
    "B.coulomb.c": 0.3,
}


@functools.cache
def _channels() -> Mapping[str, np.ndarray]:
    t = np.arange(2000) / 500.0
    x = 0.2 * np.sin(2 * np.pi * 0.9 * t) + 0.05 * np.sin(2 * np.pi * 2.3 * t)
    b = 0.6 * np.sin(2 * np.pi * 0.7 * t + 1) + 0.2 * np.sin(2 * np.pi * 1.9 * t)
    q = np.stack([x, b], axis=1)
    v = np.gradient(q, t, axis=0)
    a = np.gradient(v, t, axis=0)
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    u = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    u += v * [20.0, 0.5] + np.sign(v) * [8.0, 0.3]
    u += np.random.default_rng(1).normal(size=u.shape) * [0.5, 0.02]
    return {
        "t": t,
        "X.q": x,
        "X.u": u[:, 0],
        "X.qr": x + 1e-4 * v[:, 0],
        "B.q": b,
        "B.u": u[:, 1],
        "B.qr": b + 1e-4 * v[:, 1],
    }


def good_log() -> dict[str, np.ndarray]:
    """Return channels of a log with which everything works: 4 s at 500 Hz."""
    return {name: values.copy() for name, values in _channels().items()}


def write_log(path: Path, channels: Mapping[str, np.ndarray]) -> Path:
    table = np.column_stack(list(channels.values()))
    text = io.StringIO()
    np.savetxt(text, table, fmt="%.12g", delimiter=",", header=",".join(channels), comments="")
    path.write_text(text.getvalue())
    return path


def write_machine(folder: Path, urdf: str | bytes | None = URDF, yaml: str | bytes | None = YAML) -> Path:
    folder.mkdir()
    for name, content in (("rig.urdf", urdf), ("machine.yaml", yaml)):
        if content is not None:
            raw = content if isinstance(content, bytes) else content.encode()
            (folder / name).write_bytes(raw)
    return folder


def run(*words: object) -> int:
    """Run a command as the shell would and return its exit code."""
    try:
        return main([str(word) for word in words])
    except SystemExit as stop:  # argparse's own way out
        return int(stop.code or 0)
