"""Plots of the closed loop: the response to the command, and what its tracking error is made of."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import plotly.graph_objects as go

from pinotwin.analysis.decomposition import COMMAND, Decomposition
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report.display import SIGNALS, scale_of
from pinotwin.report.figures import ACCENT, MEASURED, SOFT, Line, Panel, over_time, share_bars
from pinotwin.signals import rms
from pinotwin.simulation.score import measured

CAUSES = {  # Cause -> its name and its colour, the same in every plot
    COMMAND: ("the command itself", "#7f8ea3"),
    "friction": ("friction", "#e15759"),
    "position": ("ripple and position tables", "#9c755f"),
    "gravity": ("gravity", "#59a14f"),
    "inertial_coupling": ("inertia of other axes", "#2fa6a0"),
    "coriolis_centrifugal": ("Coriolis and centrifugal", "#4e79a7"),
    "flexibility": ("flexible joints", "#b07aa1"),
    "external": ("external loads", "#d37295"),
    "other": ("other", "#b6992d"),
}


def response_panel(
    machine: Machine, log: Log, predicted: Log, axis: str, signal: str, title: str = ""
) -> Panel:
    """Return a measured and predicted signal of an axis, to be drawn over time."""
    lines = [Line("predicted", predicted[f"{axis}.{signal}"], ACCENT, 1.1)]
    known = measured(machine, log, axis).get(signal)
    if known is not None:
        lines.insert(0, Line("measured", known, MEASURED, 2.6))
    scale = scale_of(signal, machine.axes[axis].rotary, lines[0].y)
    return Panel(f"<b>{axis}</b> {title or SIGNALS[signal]}", lines, scale)


def response_figure(machine: Machine, log: Log, predicted: Log, axes: Iterable[str] = ()) -> go.Figure:
    """Return measured and predicted tracking error and effort over time, of some axes or of all."""
    names = list(axes) or list(machine.axes)
    panels = [response_panel(machine, log, predicted, name, s) for name in names for s in SIGNALS]
    return over_time(log.t, panels, 70 + 175 * len(panels), points=max(900 // len(names), 400))


def cause_shares_figure(parts: Decomposition, least: float = 0.002) -> go.Figure:
    """Return the share of each cause above ``least`` in every axis' tracking error as stacked bars (Fig. 4-16)."""
    rows = {axis: {k: x for k, x in parts.shares(axis).items() if x > least} for axis in parts.axes}
    looks = {cause: look for cause, look in CAUSES.items() if any(cause in row for row in rows.values())}
    return share_bars(rows, looks, "share of the summed integrals of |error| [%]")


def causes_figure(
    parts: Decomposition, axis: str, rotary: bool, what: Literal["disturbance", "error"], least: float = 0.002
) -> go.Figure:
    """Return the parts of one axis' disturbance (Fig. 4-15) or error (Fig. 4-14) over time, those above ``least``."""
    mine = (parts.disturbances if what == "disturbance" else parts.errors)[axis]
    total = parts.disturbance(axis) if what == "disturbance" else parts.error(axis)
    size = {cause: rms(x) for cause, x in mine.items()}
    drawn = [c for c in CAUSES if size.get(c, 0.0) > least * sum(size.values())]
    lines = [Line("sum", total, SOFT, 1.0), *(Line(CAUSES[c][0], mine[c], CAUSES[c][1]) for c in drawn)]
    scale = scale_of("u" if what == "disturbance" else "e", rotary, total)
    return over_time(parts.t, [Panel(what, lines, scale)], 330, points=600)
