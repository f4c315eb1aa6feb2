"""The evidence of a diagnosis: log minus model over time, against speed and position, and where on the machine."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Diagnosis, Traces
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report import display
from pinotwin.report.blocks import Block, Group, Html, Plot, macro
from pinotwin.report.diagnosis_plots import gap_figure, shown, spectrum_figure
from pinotwin.report.diagnosis_verdict import SERIOUS, grade_of, machine_of, rotary_axes
from pinotwin.report.figures import against_figure
from pinotwin.studies.overlay import Against
from pinotwin.system.phrases import AGAINST, STATES

if TYPE_CHECKING:
    from pinotwin.viewer.still import Still


def evidence_panels(d: Diagnosis, logs: Sequence[Log]) -> dict[str, Sequence[Block]]:
    """Return plots of the residual for every axis with one; for all axes when there is none."""
    rotary, traces = rotary_axes(d), {t.axis: t for t in reversed(d.traces)}
    known = list(dict.fromkeys(t.axis for t in d.traces))
    shown = [a for a in known if a in d.gap and grade_of(d, a) in SERIOUS]
    named = {e.axis for e in d.effects}
    axes = sorted(shown, key=lambda a: a not in named) or known
    return {a: _panel(d, logs, traces[a], rotary.get(a, False)) for a in axes if len(traces[a].t) > 1}


def _panel(d: Diagnosis, logs: Sequence[Log], given: Traces, turns: bool) -> list[Block]:
    name = logs[given.log].source if given.log < len(logs) else f"log {given.log + 1}"
    title, note = f"Axis {given.axis}: residual", f"Over time, in {display.elided(name)}."
    peak = "A peak is a vibration; a rise to the right, elasticity or delay."
    spectrum = Plot(spectrum_figure(given, turns), "By frequency", peak)
    return [Plot(gap_figure(given, turns), title, note), *_against(d, given, turns), spectrum]


def _against(d: Diagnosis, given: Traces, turns: bool) -> list[Block]:
    try:
        motion = d.prepared[given.log].motion if given.log < len(d.prepared) else None
    except PinotwinError:
        return []  # the log or the machine is not at hand; the rest stands
    if motion is None or given.axis not in motion.names:
        return []
    j = motion.index(given.axis)

    def against(of: Against, x: Floats) -> go.Figure:
        at = np.interp(given.t, motion.t, x[:, j])
        return against_figure(of, turns, at, shown(given), "residual", given.before)

    speed = Plot(against("velocity", motion.v), "Against speed", AGAINST["velocity"])
    return [Group((speed, Plot(against("position", motion.q), "Against position", AGAINST["position"])))]


def machine_block(d: Diagnosis, log: Log | None = None) -> Html | None:
    """Return the machine with what was found on its axes, in the middle of a log; None where the diagnosis has none."""
    machine = machine_of(d)
    if machine is None:
        return None
    try:
        drawn = _drawn(d, machine, log)
    except (PinotwinError, ValueError, RuntimeError, OSError, ImportError):
        return None  # a picture is worth less than the page it belongs to
    return _figure(d, machine, drawn) if drawn.joints else None


def _drawn(d: Diagnosis, machine: Machine, log: Log | None) -> Still:
    from pinotwin.viewer.gap import shade  # half a second of meshcat, which other pages do not need
    from pinotwin.viewer.scene import visual_model
    from pinotwin.viewer.still import still

    rigid = machine.with_rigid_joints()
    q = rigid.posture()
    if log is not None:
        for name, axis in rigid.axes.items():
            x = log.channels.get(f"{name}.q")
            if x is not None and np.isfinite(x).any():
                q[rigid.model.joints[rigid.model.getJointId(axis.joint)].idx_q] = float(np.nanmedian(x))
    colours = {axis.joint: shade(d, name) for name, axis in rigid.axes.items()}
    return still(rigid.model, visual_model(rigid.model, rigid.urdf, rigid.meshes), q, colours)


def _figure(d: Diagnosis, machine: Machine, drawn: Still, high: float = 24.0, wide: float = 8.5) -> Html:
    """Return the picture with names on it, ``high`` apart, of letters ``wide`` [px]: none hides another."""
    width, height = drawn.size
    places = (
        (drawn.joints[axis.joint], name) for name, axis in machine.axes.items() if axis.joint in drawn.joints
    )
    marks, last = [], {True: -1e9, False: -1e9}
    for (x, y), name in sorted(places, key=lambda place: place[0][1]):
        left = x < 0.5 * width
        low = last[left] = max(min(max(y, 16.0), height - 12.0), last[left] + high)
        word = f"{name} · {STATES[d.situation][d.state(name)]}"
        inner = min(wide * len(word), 0.4 * width)
        edge, to = (6, 10.0 + inner) if left else (width - 6, width - 10.0 - inner)
        anchor = "start" if left else "end"
        marks.append((round(x), round(y), round(to), round(low), edge, anchor, word))
    return macro("machine", machine.name, base64.b64encode(drawn.png).decode(), drawn.size, marks)
