"""Plots of the closed loop: the response to the command, and what its tracking error is made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.analysis.decomposition import COMMAND, Decomposition
from pinotwin.arrays import Floats
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.figures import ACCENT, MEASURED, SOFT, line, style, visible_rows

CAUSES = {
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
"""Cause -> its name and its colour, the same in every plot."""

_LEAST = 0.002  # share of all below which a cause is not drawn
_DEGREE = 180.0 / np.pi


def error_scale(rotary: bool, largest: float) -> display.Scale:
    """Return the scale of a tracking error: µm or mm, mdeg or °, by its largest magnitude [SI]."""
    if rotary and largest * _DEGREE < 1.0:
        return display.Scale(1e3 * _DEGREE, "mdeg")
    return display.position(rotary, largest)


def measured_signals(log: Log, axis: str, predicted: Log | None = None) -> dict[str, Floats]:
    """Return what a log in contract names holds of an axis: ``e``, ``u``.

    A prediction that has ``<axis>.ql`` says that the loop is closed on the load's encoder.
    """
    out = {}
    position = f"{axis}.ql" if predicted is not None and f"{axis}.ql" in predicted else f"{axis}.q"
    if position in log and f"{axis}.qr" in log:
        out["e"] = log[f"{axis}.qr"] - log[position]
    if f"{axis}.u" in log:
        out["u"] = log[f"{axis}.u"]
    return out


def scale_of(signal: str, rotary: bool, x: Floats) -> display.Scale:
    """Return the scale of ``e`` or ``u``."""
    of = error_scale if signal == "e" else display.effort
    return of(rotary, display.largest(x))


def response_figure(rotary: Mapping[str, bool], log: Log, predicted: Log) -> go.Figure:
    """Return measured and predicted tracking error and effort of every axis over one time axis.

    Args:
        rotary: of each axis with a loop, in the order of drawing.
        log: what was measured, in the names of the contract.
        predicted: simulated from the command.
    """
    count = 2 * len(rotary)
    figure = make_subplots(
        rows=count, cols=1, shared_xaxes=True, vertical_spacing=0.03 / max(count / 2, 1) ** 0.5
    )
    points = max(3000 // max(len(rotary), 1), 1200)
    for k, (axis, turns) in enumerate(rotary.items()):
        measured = measured_signals(log, axis, predicted)
        for i, signal in enumerate(("e", "u")):
            lines = [("predicted", predicted[f"{axis}.{signal}"], ACCENT, 1.1)]
            if signal in measured:
                lines.insert(0, ("measured", measured[signal], MEASURED, 2.6))
            scale = scale_of(signal, turns, lines[0][1])
            rows = visible_rows([y for _, y, _, _ in lines], points)
            for name, y, colour, width in lines:
                trace = line(
                    log.t[rows], scale(y[rows]), name, colour, width=width, legend=k + i == 0, unit=scale.unit
                )
                figure.add_trace(trace, row=2 * k + i + 1, col=1)
            title = "tracking error" if signal == "e" else "effort"
            figure.update_yaxes(title_text=f"<b>{axis}</b> {title} [{scale.unit}]", row=2 * k + i + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=count, col=1)
    return style(figure, 70 + 175 * count)


def cause_shares_figure(parts: Decomposition) -> go.Figure:
    """Return the share of each cause in every axis' tracking error as stacked bars (Fig. 4-16)."""
    shares = {axis: parts.shares(axis) for axis in parts.axes}
    figure = go.Figure()
    for cause, (name, colour) in CAUSES.items():
        axes = [axis for axis in parts.axes if shares[axis].get(cause, 0.0) > _LEAST]
        if not axes:
            continue
        values = [100.0 * shares[axis][cause] for axis in axes]
        figure.add_bar(
            y=axes,
            x=values,
            name=name,
            orientation="h",
            marker_color=colour,
            hovertemplate="%{x:.1f} %<extra>%{fullData.name}</extra>",
            text=[f"{x:.0f} %" if x >= 6 else "" for x in values],
            textposition="inside",
            insidetextanchor="middle",
            textangle=0,
            textfont={"color": "#fff"},
        )
    style(figure, 110 + 46 * len(parts.axes))
    figure.update_layout(barmode="stack", bargap=0.35, legend_traceorder="normal")
    figure.update_xaxes(title_text="share of the summed integrals of |error| [%]", range=[0, 100])
    figure.update_yaxes(autorange="reversed", showgrid=False, type="category")
    return figure


def causes_figure(parts: Decomposition, axis: str, rotary: bool, what: str) -> go.Figure:
    """Return the parts of one axis' disturbance (Fig. 4-15) or error (Fig. 4-14) over time.

    Args:
        parts: disturbances and errors by cause.
        axis: axis.
        rotary: whether it turns.
        what: ``disturbance`` or ``error``.
    """
    mine = (parts.disturbances if what == "disturbance" else parts.errors)[axis]
    total = parts.disturbance(axis) if what == "disturbance" else parts.error(axis)
    size = {cause: float(np.sqrt(np.mean(x**2))) for cause, x in mine.items()}
    drawn = [c for c in CAUSES if size.get(c, 0.0) > _LEAST * sum(size.values())]
    scale = scale_of("u" if what == "disturbance" else "e", rotary, total)
    rows = visible_rows([total, *(mine[c] for c in drawn[:3])], 2000)
    t = parts.t[rows]
    figure = go.Figure(line(t, scale(total[rows]), "sum", SOFT, width=1.0, unit=scale.unit))
    for cause in drawn:
        name, colour = CAUSES[cause]
        figure.add_trace(line(t, scale(mine[cause][rows]), name, colour, unit=scale.unit))
    return style(figure, 330, x="time [s]", y=f"{what} [{scale.unit}]")
