"""One page of our own around meshcat: sliders with limits, names and legend, time with linked plots.

The picture is meshcat's; what moves in it is computed in the page from the tree that is written here, so
that a slider needs no server. Nothing is loaded from elsewhere, and two runs write the same bytes.
"""

from __future__ import annotations

import base64
import html
import json
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

import meshcat.geometry as mg
import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.machine import Machine
from pinotwin.viewer.meshes import Rgba
from pinotwin.viewer.scene import ROOT, Scene, add_copy, place_joints
from pinotwin.viewer.stage import corners, framing, set_stage
from pinotwin.viewer.still import still
from pinotwin.viewer.tracks import Tracks

_Layer = tuple[str, str, bool, list[str], dict[str, bool]]
"""Text, colour, whether shown at first, nodes, and what else it does."""
GHOST, OTHER = "ghost", "overlay"
_POSTURES = 24  # so many of a motion's postures decide how far away the camera stands
FLAT = "This browser has no WebGL: a still picture of the first posture."
TITLES = {
    "effort": "Effort",
    "gap": "Residual: measured minus model",
    "error": "Tracking error",
    "parts": "Effort by cause",
}
_SHELL = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<title>{title}</title><link rel="icon" href="data:,"><style>{css}</style></head>
<body><div id="view"><div id="pane"></div><img id="still" alt="" hidden><p id="flat" hidden>{flat}</p>
<div id="labels"></div></div>
<aside><h1>{title}</h1><p>{subtitle}</p>
<h2>Posture</h2><div id="sliders"></div><div id="postures"></div>
<h2>Shown</h2><div id="layers"></div>
<div id="ghosted" hidden><h2>Tracking error enlarged <span id="times"></span></h2>
<input id="factor" type="range" min="0" max="4" step="0.05"></div></aside>
<footer><div id="bar"><button id="play">play</button><select id="axis"></select>
<input id="time" type="range" min="0" value="0"><span id="now"></span></div><div id="plots"></div></footer>
<script>{meshcat}</script>
<script>
{loader}
const DATA = {data};
{script}
</script></body></html>
"""


@dataclass(frozen=True)
class Overlay:
    """A second machine in the same picture.

    Attributes:
        machine: with the same axes.
        visual: its shapes.
        colour: red, green, blue, opacity.
    """

    machine: Machine
    visual: pin.GeometryModel
    colour: Rgba = (0.17, 0.42, 0.69, 0.45)


def panel(
    drawn: Scene,
    machine: Machine,
    *,
    tracks: Tracks | None = None,
    overlay: Overlay | None = None,
    subtitle: str = "",
) -> str:
    """Return the page of a drawn machine.

    Args:
        drawn: the scene, at the posture where it starts.
        machine: whose axes the sliders move.
        tracks: what a log played back holds, with its plots.
        overlay: a second machine, drawn through the first.
        subtitle: line below the name.
    """
    rows = drawn.q[None] if tracks is None else tracks.q[:: max(1, len(tracks.q) // _POSTURES)]
    scene = replace(drawn, page=drawn.page.copy(), q=rows[0])
    points = np.concatenate([corners(scene.model, scene.visual, row) for row in rows])
    set_stage(scene.viewer(), points)
    place_joints(scene)
    _ellipsoids(scene)
    bodies = [_body(drawn.model, ROOT)]
    if tracks is not None and tracks.qr is not None:
        add_copy(scene, drawn.model, drawn.visual, GHOST, (0.95, 0.62, 0.15, 0.35))
        bodies.append(_body(drawn.model, GHOST) | {"ghost": True})
    if overlay is not None:
        add_copy(scene, overlay.machine.model, overlay.visual, OTHER, overlay.colour)
        bodies.append(_body(overlay.machine.model, OTHER, machine, overlay.machine))
    data = {
        "q": scene.q.tolist(),
        "bodies": bodies,
        "axes": _axes(machine, tracks),
        "postures": _postures(machine, scene.q),
        "layers": _layers(scene, tracks, overlay),
        "titles": TITLES,
        "factor": 100,
        "stage": framing(points),
        "still": base64.b64encode(still(scene.model, scene.visual, scene.q).png).decode(),
        "frames": None if tracks is None else tracks.frames(),
    }
    folder = files("pinotwin.viewer")
    return _SHELL.format(
        title=html.escape(drawn.name),
        subtitle=html.escape(subtitle),
        css=(folder / "panel.css").read_text(encoding="utf-8"),
        script=(folder / "panel.js").read_text(encoding="utf-8"),
        meshcat=scene.page.script(),
        loader=scene.page.loader(),
        flat=FLAT,
        data=json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"),
    )


def _body(
    model: pin.Model, root: str, leader: Machine | None = None, follower: Machine | None = None
) -> dict[str, Any]:
    """Return the tree of a drawn model; a follower's joints take the columns of the leader's axes."""
    column = {int(model.idx_vs[i]): int(model.idx_vs[i]) for i in range(1, model.njoints)}
    if leader is not None and follower is not None:
        place = {name: k for k, name in enumerate(leader.names)}
        column = {part.index: place.get(part.name, -1) for part in follower.parts}
    joints = []
    for i in range(1, model.njoints):
        joint = model.joints[i]
        frame = joint.createData()
        joint.calc(frame, np.zeros(joint.nq) if joint.nq == 1 else pin.neutral(model)[: joint.nq])
        S = np.asarray(frame.S).reshape(6, -1)[:, 0]
        rotary = bool(np.any(S[3:]))
        joints.append(
            {
                "path": f"{root}/{model.names[i]}",
                "parent": int(model.parents[i]) - 1,
                "column": column[int(model.idx_vs[i])],
                "rotary": rotary,
                "axis": (S[3:] if rotary else S[:3]).tolist(),
                "place": model.jointPlacements[i].homogeneous.T.ravel().tolist(),
            }
        )
    return {"root": root, "joints": joints}


def _axes(machine: Machine, tracks: Tracks | None) -> list[dict[str, Any]]:
    out = []
    for part in machine.parts:
        low, high = (
            float(x[part.index]) for x in (machine.model.lowerPositionLimit, machine.model.upperPositionLimit)
        )
        limited = max(abs(low), abs(high)) < 1e3
        if not limited:
            low, high = (-np.pi, np.pi) if part.rotary else (-0.5, 0.5)
        row: dict[str, Any] = {
            "name": part.name,
            "path": f"{ROOT}/{part.joint}",
            "column": part.index,
            "low": low,
            "high": high,
            "limited": limited,
            "unit": "°" if part.rotary else "mm",
            "scale": float(np.rad2deg(1.0)) if part.rotary else 1e3,
            "digits": 1,
            "effort_unit": "N·m" if part.rotary else "N",
            "error_unit": "mrad" if part.rotary else "µm",
        }
        if tracks is not None and part.name in tracks.series:
            row["series"], row["full"] = tracks.lines(part.name), tracks.full.get(part.name)
        out.append(row)
    return out


def _postures(machine: Machine, q: Floats) -> dict[str, list[float]]:
    """Return the postures that a button sets: as drawn, zero or next to it, and both ends of the travel."""
    model = machine.model
    bounded = np.maximum(np.abs(model.lowerPositionLimit), np.abs(model.upperPositionLimit)) < 1e3
    rest = machine.posture()
    out = {"as drawn": q.tolist(), "within limits, nearest to zero" if rest.any() else "zero": rest.tolist()}
    if np.any(bounded):
        out["low ends"] = np.where(bounded, model.lowerPositionLimit, 0.0).tolist()
        out["high ends"] = np.where(bounded, model.upperPositionLimit, 0.0).tolist()
    return out


def _layers(scene: Scene, tracks: Tracks | None, overlay: Overlay | None) -> list[dict[str, Any]]:
    """Return what can be shown or hidden, with its colour: the legend."""
    joints = [f"{ROOT}/{name}" for name in list(scene.model.names)[1:]]
    drawn = {path for _, path, _ in scene.page.messages}

    def having(part: str) -> list[str]:
        return [f"{j}/{part}" for j in joints if any(p.startswith(f"/meshcat/{j}/{part}") for p in drawn)]

    rows: list[_Layer] = [("names of the axes", "#b9c0c9", True, [], {"labels": True})]
    for part, text, shade, on in (
        ("frame", "joint frames: x red, y green, z blue", "#3e9b5f", True),
        ("mass", "centres of mass, volume as the mass", "#c2378b", False),
        ("inertia", "inertia ellipsoids: same inertia, even density", "#6b5bd2", False),
    ):
        if having(part):
            rows.append((text, shade, on, having(part), {}))
    if tracks is not None and tracks.qr is not None:
        rows.append(("command, the error enlarged", "#f29e26", False, [GHOST], {}))
    if tracks is not None and tracks.full:
        rows.append(("colour: effort residual, red where large", "#cc211a", False, [], {"tint": True}))
    if overlay is not None:
        rows.append((f"overlaid: {overlay.machine.name}", "#2b6cb0", True, [OTHER], {}))
    return [{"text": t, "colour": c, "on": on, "paths": paths} | more for t, c, on, paths, more in rows]


def _ellipsoids(scene: Scene) -> None:
    """Draw the ellipsoid of even density that has the inertia of each body.

    Its half axes are a_i = sqrt(5 (I_j + I_k - I_i) / (2 m)).
    """
    for joint, body in enumerate(scene.model.inertias):
        if joint == 0 or body.mass <= 0.0:
            continue
        moments, turn = np.linalg.eigh(body.inertia)
        half = np.sqrt(np.maximum(2.5 * (moments.sum() - 2.0 * moments) / body.mass, 1e-8))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn @ np.diag(half), body.lever
        node = scene.node(joint)["inertia"]
        node.set_object(
            mg.Sphere(1.0), mg.MeshLambertMaterial(color=0x6B5BD2, opacity=0.35, transparent=True)
        )
        node.set_transform(pose)
