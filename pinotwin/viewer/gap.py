"""The machine playing a log, every axis in the colour of its grade, with the plots of its residual beside it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.grade import Grade, printed
from pinotwin.diagnosis.result import Diagnosis
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.twin import Twin
from pinotwin.viewer.meshes import GREY, Colour
from pinotwin.viewer.panel import panel
from pinotwin.viewer.scene import colour, draw, visual_model
from pinotwin.viewer.tracks import Tracks, tracks_of

COLOURS: dict[Grade, Colour] = {
    "gap explained": (0.90, 0.52, 0.20),
    "partly explained": (0.90, 0.52, 0.20),
    "not explained": (0.80, 0.27, 0.22),
    "above misfit": (0.85, 0.74, 0.42),
}
"""Grade -> colour of the axis; grey where nothing was found."""


def gap_page(found: Diagnosis, machine: Machine, log: Log) -> str:
    """Return the page of a diagnosed machine, playing a log: the same bytes for the same diagnosis."""
    twin = found.subject if isinstance(found.subject, Twin) else None
    if found.prepared:
        motion = found.prepared[0].motion
    else:
        motion = prepare(machine, log, decimate=1) if twin is None else twin.motion(log)
    tracks = with_causes(tracks_of(machine, motion, twin), found, float(motion.t[0]))
    visual = visual_model(machine.model, machine.urdf, machine.meshes)
    shades = {str(name): (*GREY, 1.0) for name in machine.model.names}
    for name, axis in machine.axes.items():
        shades[axis.joint] = (*COLOURS.get(_grade(found, name), GREY), 1.0)
    drawn = colour(draw(machine.model, visual, frames=False, masses=False, name=machine.name), shades)
    return panel(drawn, machine, tracks=tracks, subtitle=_told(found, machine.axes))


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


def _grade(found: Diagnosis, axis: str) -> Grade:
    return found.grade(axis, "u") if "u" in found.gap.get(axis, {}) else "not judged"


def _told(found: Diagnosis, axes: Iterable[str]) -> str:
    words = ", ".join(f"{name} {printed(_grade(found, name))}" for name in axes)
    return f"playing the diagnosed log; motor effort: {words}"
