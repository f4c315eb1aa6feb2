"""One page of our own around meshcat: sliders with limits, names and legend, time with linked plots.

What moves is computed in the page: a slider needs no server. Nothing is loaded, and two runs write the same bytes.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import meshcat.geometry as mg
import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import joint_axis
from pinotwin.machine import Machine
from pinotwin.system.templates import asset, environment
from pinotwin.viewer.scene import ROOT, Scene, add_copy, place_joints, visual_model
from pinotwin.viewer.stage import corners, framing, set_stage, still
from pinotwin.viewer.tracks import Tracks

GHOST, OTHER = "ghost", "overlay"


def panel(
    drawn: Scene,
    machine: Machine,
    *,
    tracks: Tracks | None = None,
    overlay: Machine | None = None,
    subtitle: str = "",
) -> str:
    """Return the page of a machine drawn where it starts, playing a log, with a second machine drawn through it."""
    rows = drawn.q[None]  # the postures that the camera must see
    if tracks is not None:
        rows = tracks.q[:: max(1, len(tracks.q) // 24)]
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
        visual = visual_model(overlay.model, overlay.urdf, overlay.meshes)
        add_copy(scene, overlay.model, visual, OTHER, (0.17, 0.42, 0.69, 0.45))
        place = {name: k for k, name in enumerate(machine.names)}
        bodies.append(_body(overlay.model, OTHER, [place.get(name, -1) for name in overlay.names]))
    data = {
        "q": scene.q.tolist(),
        "bodies": bodies,
        "axes": _axes(machine, tracks),
        "postures": _postures(machine, scene.q),
        "layers": _layers(scene, tracks, overlay),
        "stage": framing(points),
        "still": base64.b64encode(still(scene.model, scene.visual, scene.q).png).decode(),
        "frames": None if tracks is None else tracks.frames(),
    }
    packed, commands = scene.page.commands()
    page = environment("pinotwin.viewer").get_template("panel.html")
    return page.render(
        title=drawn.name,
        subtitle=subtitle,
        css=asset("pinotwin.viewer", "panel.css"),
        script=asset("pinotwin.viewer", "panel.js"),
        meshcat=scene.page.script(),
        packed=packed,
        commands=commands,
        data=json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"),
    )


def _body(model: pin.Model, root: str, columns: Sequence[int] | None = None) -> dict[str, Any]:
    """Return the tree of a drawn model; its joints take other ``columns`` than their own where these are given."""
    joints = []
    for i in range(1, model.njoints):
        column = int(model.idx_vs[i])
        rotary, axis = joint_axis(model, i)
        joints.append(
            {
                "path": f"{root}/{model.names[i]}",
                "parent": int(model.parents[i]) - 1,
                "column": column if columns is None else columns[column],
                "rotary": rotary,
                "axis": axis.tolist(),
                "place": model.jointPlacements[i].homogeneous.T.ravel().tolist(),
            }
        )
    return {"root": root, "joints": joints}


def _axes(machine: Machine, tracks: Tracks | None) -> list[dict[str, Any]]:
    out, ends = [], (machine.model.lowerPositionLimit, machine.model.upperPositionLimit)
    for part in machine.parts:
        low, high = (float(x[part.index]) for x in ends)
        limited = max(abs(low), abs(high)) < 1e3
        if not limited:
            low, high = (-np.pi, np.pi) if part.rotary else (-0.5, 0.5)
        kind = ("°", float(np.rad2deg(1.0)), "N·m", "mdeg") if part.rotary else ("mm", 1e3, "N", "µm")
        row: dict[str, Any] = dict(zip(("unit", "scale", "effort_unit", "error_unit"), kind, strict=True))
        row |= {"name": part.name, "path": f"{ROOT}/{part.joint}", "column": part.index, "digits": 1}
        row |= {"low": low, "high": high, "limited": limited}
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


def _layers(scene: Scene, tracks: Tracks | None, overlay: Machine | None) -> list[dict[str, Any]]:
    """Return what can be shown or hidden, with its colour: the legend."""
    joints = [f"{ROOT}/{name}" for name in list(scene.model.names)[1:]]
    drawn = {path for _, path, _ in scene.page.messages}
    rows: list[dict[str, Any]] = []

    def add(text: str, shade: str, paths: Sequence[str] = (), *, on: bool = False, **more: bool) -> None:
        rows.append({"text": text, "colour": shade, "on": on, "paths": [*paths], **more})

    add("names of the axes", "#b9c0c9", on=True, labels=True)
    for part, text, shade in (
        ("frame", "joint frames: x red, y green, z blue", "#3e9b5f"),
        ("mass", "centres of mass, volume as the mass", "#c2378b"),
        ("inertia", "inertia ellipsoids: same inertia, even density", "#6b5bd2"),
    ):
        paths = [f"{j}/{part}" for j in joints if any(p.startswith(f"/meshcat/{j}/{part}") for p in drawn)]
        if paths:
            add(text, shade, paths, on=part == "frame")
    if tracks is not None and tracks.qr is not None:
        add("command, the error enlarged", "#f29e26", [GHOST])
    if tracks is not None and tracks.full:
        add("colour: effort residual, red where large", "#cc211a", tint=True)
    if overlay is not None:
        add(f"overlaid: {overlay.name}", "#2b6cb0", [OTHER], on=True)
    return rows


def _ellipsoids(scene: Scene) -> None:
    """Draw each body's ellipsoid of even density: half axes a_i = sqrt(5 (I_j + I_k - I_i) / (2 m))."""
    for joint, body in enumerate(scene.model.inertias):
        if joint == 0 or body.mass <= 0.0:
            continue
        moments, turn = np.linalg.eigh(body.inertia)
        half = np.sqrt(np.maximum(2.5 * (moments.sum() - 2.0 * moments) / body.mass, 1e-8))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn @ np.diag(half), body.lever
        node = scene.node(joint)["inertia"]
        shine = mg.MeshLambertMaterial(color=0x6B5BD2, opacity=0.35, transparent=True)
        node.set_object(mg.Sphere(1.0), shine)
        node.set_transform(pose)
