"""Figures of the thesis' studies (Fig. 3-6, 3-7, 3-9, 3-10, 4-10, 4-11)."""

from __future__ import annotations

from functools import singledispatch

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.report.display import scale_of
from pinotwin.report.figures import (
    ACCENT,
    MEASURED,
    RESIDUAL,
    Line,
    Panel,
    dots,
    line,
    over_time,
    points,
    some_rows,
    style,
    visible_rows,
)
from pinotwin.studies.amount import ErrorAgainstData
from pinotwin.studies.coupling import CoupledAgainstDecoupled
from pinotwin.studies.overlay import Overlay
from pinotwin.studies.removal import WithAndWithout


@singledispatch
def figure_of(given: object) -> go.Figure:
    """Return a study's result as an interactive plot."""
    raise TypeError(f"no figure of {type(given).__name__}")


@figure_of.register
def overlay_figure(given: Overlay) -> go.Figure:
    """Return the extracted data with the fitted curve over them."""
    across = scale_of("v" if given.against == "velocity" else "q", given.rotary, given.x)
    up = scale_of("u", given.rotary, given.extracted)
    rows, bins = some_rows(len(given.x)), given.bins
    cloud = dots(across(given.x[rows]), up(given.extracted[rows]), "measured minus all other effects")
    ends = up(bins.high - bins.median), up(bins.median - bins.low)
    medians = points(across(bins.x), up(bins.median), "median of the data", MEASURED, ends, unit=up.unit)
    model = line(across(given.grid), up(given.curve), "model", ACCENT, width=2.2)
    figure = go.Figure([cloud, medians, model])
    style(figure, 330, x=f"{given.against} [{across.unit}]", y=f"{given.axis} [{up.unit}]")
    low, high = np.percentile(given.extracted, [0.5, 99.5])
    low, high = min(low, given.curve.min()), max(high, given.curve.max())
    margin = 0.12 * max(high - low, 1e-12)
    return figure.update_yaxes(range=[float(x * up.factor) for x in (low - margin, high + margin)])


@figure_of.register
def removal_figure(given: WithAndWithout) -> go.Figure:
    """Return measured effort, and predictions with and without some effects, over time."""
    words = ", ".join(key.rpartition(".")[2] for key in given.left_out)
    lines = [
        Line("measured", given.measured, MEASURED),
        Line(f"without {words}", given.without, RESIDUAL),
        Line("all effects", given.complete, ACCENT),
    ]
    scale = scale_of("u", given.rotary, given.measured)
    return over_time(given.t, [Panel(given.axis, lines, scale)], 330)


@figure_of.register
def amount_figure(given: ErrorAgainstData) -> go.Figure:
    """Return the normalised error against the amount of data."""
    figure = go.Figure()
    for y, name, colour, dash in (
        (given.fitted, "on the data fitted", MEASURED, "dot"),
        (given.held_out, "on held-out data", ACCENT, None),
    ):
        trace = line(given.seconds, 100.0 * y, name, colour, width=2, unit="%")
        figure.add_trace(trace.update(mode="lines+markers", line_dash=dash))
    style(figure, 330, x="length of the data fitted [s]", y="error norm / effort norm [%]")
    figure.update_xaxes(rangemode="tozero")
    top = 130.0 * float(np.nanmedian(given.held_out))
    worst = 105.0 * float(np.nanmax(np.r_[given.fitted, given.held_out]))
    return figure.update_yaxes(range=[0, min(3 * top, worst)])


@figure_of.register
def coupling_figure(given: CoupledAgainstDecoupled, axis: str | None = None) -> go.Figure:
    """Return both models' errors on every axis, and their predictions of one."""
    names = list(given.axes)
    chosen = axis if axis in given.axes else max(given.gain, key=lambda name: given.gain[name])
    figure = make_subplots(
        rows=1,
        cols=2,
        column_widths=[0.27, 0.73],
        horizontal_spacing=0.09,
        subplot_titles=("held-out error", f"effort of {chosen}"),
    )
    hover = "%{y:.3g} %<extra>%{x}</extra>"
    for name, colour in (("decoupled", RESIDUAL), ("coupled", ACCENT)):
        errors = [100.0 * getattr(given.axes[a], f"{name}_error")["nrmse_std"] for a in names]
        bar = go.Bar(x=names, y=errors, name=name, legendgroup=name, marker_color=colour, hovertemplate=hover)
        figure.add_trace(bar, row=1, col=1)
    row = given.axes[chosen]
    rows = visible_rows([row.u, row.decoupled])
    scale = scale_of("u", row.rotary, row.u)
    t = row.t[rows] - row.t[0]
    for y, name, colour in (
        (row.u, "measured", MEASURED),
        (row.decoupled, "decoupled", RESIDUAL),
        (row.coupled, "coupled", ACCENT),
    ):
        trace = line(t, scale(y[rows]), name, colour, legend=name == "measured", unit=scale.unit)
        figure.add_trace(trace, row=1, col=2)
    style(figure, 380)
    figure.update_layout(barmode="group", margin_t=64, legend_y=1.1)
    figure.update_yaxes(title_text="RMS error / standard deviation [%]", row=1, col=1)
    figure.update_xaxes(title_text="time [s]", row=1, col=2)
    return figure.update_yaxes(title_text=f"[{scale.unit}]", row=1, col=2)
