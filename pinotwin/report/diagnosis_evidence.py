"""The evidence of a diagnosis: log minus model over time, and against speed and position."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.diagnosis.result import Diagnosis, Traces
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.motion import Motion
from pinotwin.report import display
from pinotwin.report.blocks import Block, Group, Plot
from pinotwin.report.diagnosis_plots import against_figure, gap_figure, spectrum_figure
from pinotwin.report.diagnosis_verdict import SERIOUS, grade_of, rotary_axes


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
