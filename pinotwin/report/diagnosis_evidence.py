"""The evidence of a diagnosis: log minus model over time, against speed and position, and where on the machine."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.result import Diagnosis, Traces
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.report import display
from pinotwin.report.blocks import Block, Group, Html, Plot, macro
from pinotwin.report.diagnosis_plots import against_figure, gap_figure, spectrum_figure
from pinotwin.report.diagnosis_verdict import SERIOUS, grade_of, machine_of, rotary_axes

if TYPE_CHECKING:
    from pinotwin.viewer.still import Still


def evidence_panels(d: Diagnosis, logs: Sequence[Log]) -> dict[str, Sequence[Block]]:
    """Return plots of the gap for every axis with one; for all axes when there is none."""
    rotary = rotary_axes(d)
    known = list(dict.fromkeys(t.axis for t in d.traces))
    shown = [a for a in known if a in d.gap and grade_of(d, a) in SERIOUS]
    axes = [*(a for a in shown if any(e.axis == a for e in d.effects)), *shown] or known
    axes = list(dict.fromkeys(axes))
    out: dict[str, Sequence[Block]] = {}
    motions: dict[int, Motion | None] = {}
    for axis in axes:
        given = next(t for t in d.traces if t.axis == axis)
        if len(given.t) < 2:
            continue
        if given.log not in motions:
            motions[given.log] = _motion(d, given.log)
        turns = rotary.get(axis, False)
        name = logs[given.log].source if given.log < len(logs) else f"log {given.log + 1}"
        plot = Plot(
            gap_figure(given, turns),
            f"Axis {axis}: log minus model",
            f"Over time, in {display.elided(name)}.",
        )
        spectrum = Plot(
            spectrum_figure(given, turns),
            "By frequency",
            "A peak is a vibration; a rise to the right, elasticity or delay.",
        )
        out[axis] = [plot, *_against(given, motions[given.log], turns), spectrum]
    return out


def _against(given: Traces, motion: Motion | None, rotary: bool) -> list[Block]:
    if motion is None or given.axis not in motion.names:
        return []
    j = motion.index(given.axis)
    plots = []
    for against, x, note in (
        ("velocity", motion.v, "Line: median. A curve is friction that the model does not have."),
        ("position", motion.q, "Line: median. A wave is ripple, cable or guideway."),
    ):
        at = np.interp(given.t, motion.t, x[:, j])
        word = "speed" if against == "velocity" else against
        plots.append(Plot(against_figure(given, at, rotary, against), f"Against {word}", note))
    return [Group(tuple(plots))]


def _motion(d: Diagnosis, k: int) -> Motion | None:
    """Return the motion of a log; None where log or machine are not at hand."""
    try:
        return d.prepared[k].motion if k < len(d.prepared) else None
    except PinotwinError:
        return None  # the plots against speed and position are left out, the rest stands


def machine_block(d: Diagnosis, log: Log | None = None) -> Html | None:
    """Return the machine with what was found on its axes; None where the diagnosis does not hold it.

    Args:
        d: the diagnosis.
        log: at whose middle the machine is shown, at rest at zero without it.
    """
    machine = machine_of(d)
    if machine is None:
        return None
    try:
        drawn = _drawn(d, machine, log)
    except (PinotwinError, ValueError, RuntimeError, OSError, ImportError):
        return None  # a picture is worth less than the page it belongs to
    return _figure(d, machine, drawn) if drawn.joints else None


def _drawn(d: Diagnosis, machine: Machine, log: Log | None) -> Still:
    from pinotwin.viewer.gap import COLOURS  # half a second of meshcat, which other pages do not need
    from pinotwin.viewer.meshes import GREY
    from pinotwin.viewer.scene import visual_model
    from pinotwin.viewer.still import still

    rigid = machine.with_rigid_joints()
    q = rigid.posture()
    if log is not None:
        for name, axis in rigid.axes.items():
            x = log.channels.get(f"{name}.q")
            if x is not None and np.isfinite(x).any():
                q[rigid.model.joints[rigid.model.getJointId(axis.joint)].idx_q] = float(np.nanmedian(x))
    colours = {axis.joint: COLOURS.get(grade_of(d, name), GREY) for name, axis in rigid.axes.items()}
    return still(rigid.model, visual_model(rigid.model, rigid.urdf, rigid.meshes), q, colours)


def _figure(d: Diagnosis, machine: Machine, drawn: Still, high: float = 24.0, wide: float = 8.5) -> Html:
    """Return the picture with names on it, placed so that none hides another.

    Args:
        d: the diagnosis.
        machine: the machine.
        drawn: its picture.
        high: between the names of two axes [px].
        wide: of a letter [px].
    """
    width, height = drawn.size
    places = (
        (drawn.joints[axis.joint], name) for name, axis in machine.axes.items() if axis.joint in drawn.joints
    )
    marks, last = [], {True: -1e9, False: -1e9}
    for (x, y), name in sorted(places, key=lambda place: place[0][1]):
        left = x < 0.5 * width
        low = last[left] = max(min(max(y, 16.0), height - 12.0), last[left] + high)
        word = f"{name} · {printed(grade_of(d, name))}"
        inner = min(wide * len(word), 0.4 * width)
        edge, to = (6, 10.0 + inner) if left else (width - 6, width - 10.0 - inner)
        anchor = "start" if left else "end"
        marks.append((round(x), round(y), round(to), round(low), edge, anchor, word))
    return macro("machine", machine.name, base64.b64encode(drawn.png).decode(), drawn.size, marks)
