"""The machine playing a log, every axis in the colour of its grade, with the plots of its residual beside it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.conclusion.sizes import place_of
from pinotwin.diagnosis.conclusion.where import along
from pinotwin.diagnosis.grade import Grade
from pinotwin.diagnosis.result import Diagnosis
from pinotwin.dynamics.parameters import joint_axis
from pinotwin.machine import Machine
from pinotwin.system.phrases import STATES
from pinotwin.twin import Twin
from pinotwin.viewer.meshes import GREY, Colour
from pinotwin.viewer.panel import panel
from pinotwin.viewer.scene import Scene, arrow, colour, draw, place_mark, visual_model
from pinotwin.viewer.stage import corners, diagonal
from pinotwin.viewer.tracks import Tracks, tracks_of

COLOURS: dict[Grade, Colour] = {  # Grade -> colour of the axis; grey where nothing was found
    "gap explained": (0.90, 0.52, 0.20),
    "partly explained": (0.90, 0.52, 0.20),
    "not explained": (0.80, 0.27, 0.22),
    "above misfit": (0.85, 0.74, 0.42),
}


def gap_page(found: Diagnosis, machine: Machine) -> str:
    """Return the page of a diagnosed machine, playing the first log: the same bytes for the same diagnosis."""
    twin = found.subject if isinstance(found.subject, Twin) else None
    motion = found.prepared[0].motion
    tracks = with_causes(tracks_of(machine, motion, twin), found, float(motion.t[0]))
    visual = visual_model(machine.model, machine.urdf, machine.meshes)
    shades = {str(name): (*GREY, 1.0) for name in machine.model.names}
    shades |= {axis.joint: (*shade(found, name), 1.0) for name, axis in machine.axes.items()}
    drawn = colour(draw(machine.model, visual, name=machine.name), shades)
    mark(drawn, found, machine)  # in a colour of its own
    states = ", ".join(f"{name} {STATES[found.situation][found.state(name)]}" for name in machine.axes)
    return panel(drawn, machine, tracks=tracks, subtitle=f"playing the diagnosed log; {states}")


def shade(found: Diagnosis, axis: str) -> Colour:
    """Return the colour of an axis: of what is open or near it, of what changed, else grey."""
    if found.state(axis) == "cannot say":
        return GREY
    changed = COLOURS["gap explained"] if found.state(axis) == "changed" else GREY
    graded = found.grade(axis, "u") if "u" in found.gap.get(axis, {}) else "not judged"
    return COLOURS.get(graded, changed)


def mark(drawn: Scene, found: Diagnosis, machine: Machine) -> None:
    """Draw where a defect is along the travel, and which way a force on an axis acts, where that was found."""
    size = diagonal(corners(drawn.model, drawn.visual, drawn.q))
    for e in found.effects:
        axis = machine.axes.get(str(e.axis))
        place, region = place_of(e), along(e, found.where)
        if region is not None:
            place = sum(region.range) / 2.0
        if axis is not None and place is not None:
            place_mark(drawn, axis.joint, place, 0.02 * size)
        elif axis is not None and e.effect == "external_force" and e.size:
            line = joint_axis(drawn.model, drawn.model.getJointId(axis.joint))[1]
            arrow(drawn, axis.joint, math.copysign(1.0, e.size[0].after) * line, 0.25 * size)


def with_causes(tracks: Tracks, found: Diagnosis, begin: float, near: float = 0.05) -> Tracks:
    """Return a playback from ``begin`` [s] on with the residual that causes leave ``near`` [s] judged rows."""
    named = {str(e.axis) for e in found.effects}
    series = {name: dict(held) for name, held in tracks.series.items()}
    for trace in found.traces:
        if trace.log == 0 and trace.axis in named and "gap" in series.get(trace.axis, {}) and len(trace.t):
            at = tracks.t + begin
            away = np.abs(trace.t[np.searchsorted(trace.t, at).clip(max=len(trace.t) - 1)] - at)
            left = np.where(away < near, np.interp(at, trace.t, trace.after), np.nan)
            series[trace.axis]["gap"] = [*series[trace.axis]["gap"], ("with the causes", "#2b6cb0", left)]
    return replace(tracks, series=series)
