"""Figures of the thesis' studies (Fig. 3-6, 3-7, 3-9, 3-10, 4-10, 4-11)."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.diagnosis.phrases import effect_words
from pinotwin.report import figures
from pinotwin.report.display import scale_of
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, Line, Panel, line, over_time, style
from pinotwin.studies.study import Study
from pinotwin.system.phrases import joined


def overlay_figure(given: Study) -> go.Figure:
    """Return the extracted data with the fitted curve over them."""
    x, extracted, curve = given["x"], given["extracted"], given["curve"]
    across = scale_of("v" if given.against == "velocity" else "q", given.rotary, x)
    up = scale_of("u", given.rotary, extracted)
    rows, (centre, median, low, high) = figures.some_rows(len(x), 450), np.array(given.rows).reshape(-1, 4).T
    cloud = figures.dots(across(x[rows]), up(extracted[rows]), "measured minus all other effects")
    ends = up(high - median), up(median - low)
    medians = figures.points(across(centre), up(median), "median of the data", MEASURED, ends, unit=up.unit)
    at = figures.visible_rows([curve], 500)
    model = line(across(given["grid"][at]), up(curve[at]), "model", ACCENT, width=2.2)
    figure = go.Figure([cloud, medians, model])
    style(figure, 330, x=f"{given.against} [{across.unit}]", y=f"{given.axis} [{up.unit}]")
    low, high = np.percentile(extracted, [0.5, 99.5])
    low, high = min(low, curve.min()), max(high, curve.max())
    margin = 0.12 * max(high - low, 1e-12)
    return figure.update_yaxes(range=[float(x * up.factor) for x in (low - margin, high + margin)])


def removal_figure(given: Study) -> go.Figure:
    """Return measured effort, and predictions with and without some effects, over time."""
    lines = [
        Line("measured", given["measured"], MEASURED),
        Line(f"without {joined([*map(effect_words, given.effects)])}", given["without"], RESIDUAL),
        Line("all effects", given["complete"], ACCENT),
    ]
    scale = scale_of("u", given.rotary, given["measured"])
    return over_time(given["t"], [Panel(given.axis, lines, scale)], 330, block=figures.blocks(given["t"]))


def amount_figure(given: Study) -> go.Figure:
    """Return the normalised error against the amount of data."""
    figure = go.Figure()
    seconds, fitted, held_out = np.array(given.rows).T
    for y, name, colour, dash in (
        (fitted, "on the data fitted", MEASURED, "dot"),
        (held_out, "on held-out data", ACCENT, None),
    ):
        trace = line(seconds, 100.0 * np.where(y <= 1.0, y, np.nan), name, colour, width=2, unit="%")
        figure.add_trace(trace.update(mode="lines+markers", line_dash=dash))
    style(figure, 330, x="length of the data fitted [s]", y="error norm / effort norm [%]")
    figure.update_xaxes(rangemode="tozero")
    return figure.update_yaxes(type="log", tickformat="~g", dtick=1)


def coupling_figure(given: Study) -> go.Figure:
    """Return both models' errors on every axis, and their predictions of the one that needs coupling most."""
    figure = make_subplots(
        rows=1,
        cols=2,
        column_widths=[0.27, 0.73],
        horizontal_spacing=0.09,
        subplot_titles=("held-out error", f"effort of {given.axis}"),
    )
    hover = "%{y:.3g} %<extra>%{x}</extra>"
    names, *_, coupled, decoupled = zip(*given.rows, strict=True)
    for name, shares, colour in (("decoupled", decoupled, RESIDUAL), ("coupled", coupled, ACCENT)):
        errors = [100.0 * x if x <= 1.0 else None for x in map(float, shares)]  # type: ignore[arg-type]
        bar = go.Bar(x=names, y=errors, name=name, legendgroup=name, marker_color=colour, hovertemplate=hover)
        figure.add_trace(bar, row=1, col=1)
    u, lost = given["u"], decoupled[names.index(given.axis)]
    rows = figures.visible_rows([u, given["coupled"]])
    scale = scale_of("u", given.rotary, u)
    t = given["t"] - given["t"][0]
    for y, name, colour in (
        (u, "measured", MEASURED),
        *[(given["decoupled"], "decoupled", RESIDUAL)] * (float(lost) <= 1.0),  # type: ignore[arg-type]
        (given["coupled"], "coupled", ACCENT),
    ):
        at, y = figures.broken(rows, figures.blocks(given["t"]), t, scale(y))
        trace = line(at, y, name, colour, legend=name == "measured", unit=scale.unit)
        figure.add_trace(trace, row=1, col=2)
    style(figure, 380)
    figure.update_layout(barmode="group", margin_t=64, legend_y=1.1)
    figure.update_yaxes(title_text="RMS error / standard deviation [%]", row=1, col=1)
    figure.update_xaxes(title_text="time [s]", row=1, col=2)
    return figure.update_yaxes(title_text=f"[{scale.unit}]", row=1, col=2)
