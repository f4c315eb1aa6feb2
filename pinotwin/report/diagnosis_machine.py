"""Where on the machine: its picture, every axis in the colour of its grade, with a name and a word."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.result import Diagnosis
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report.blocks import Html
from pinotwin.report.diagnosis_verdict import grade_of, machine_of

if TYPE_CHECKING:
    from pinotwin.viewer.still import Still

_HIGH = 24  # pixels between the names of two axes
_WIDE = 8.5  # of a letter


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
    return Html(_figure(d, machine, drawn)) if drawn.joints else None


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


def _figure(d: Diagnosis, machine: Machine, drawn: Still) -> str:
    """Return the picture with names on it, placed so that none hides another."""
    width, height = drawn.size
    packed = base64.b64encode(drawn.png).decode()
    marks = sorted(
        (drawn.joints[axis.joint][1], drawn.joints[axis.joint][0], name)
        for name, axis in machine.axes.items()
        if axis.joint in drawn.joints
    )
    texts, last = [], {True: -1e9, False: -1e9}
    for y, x, name in marks:
        left = x < 0.5 * width
        low = last[left] = max(min(max(y, 16.0), height - 12.0), last[left] + _HIGH)
        word = f"{name} · {printed(grade_of(d, name))}"
        inner = min(_WIDE * len(word), 0.4 * width)
        edge, to = (6.0, 10.0 + inner) if left else (width - 6.0, width - 10.0 - inner)
        texts.append(
            f'<circle cx="{x:.0f}" cy="{y:.0f}" r="3.5"/><path d="M{x:.0f} {y:.0f}L{to:.0f} {low:.0f}"/>'
            f'<text x="{edge:.0f}" y="{low + 4:.0f}" text-anchor="{"start" if left else "end"}">{escape(word)}</text>'
        )
    return (
        f'<figure class="machine"><svg viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{escape(machine.name)}, axes in the colour of what was found">'
        f'<image href="data:image/png;base64,{packed}" width="{width}" height="{height}"/>'
        f"{''.join(texts)}</svg></figure>"
    )
