"""Plots of a diagnosis: how far the residual falls, what it looks like over time and by frequency."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from scipy.signal import welch

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.result import Gap, Region, Traces
from pinotwin.report.display import scale_of
from pinotwin.report.figures import ACCENT, RESIDUAL, Line, Panel, line, longest, over_time, style

SHORT = {"u": "effort", "e": "error", "v": "vibration", "ql": "twist"}


def signal_name(axis: str, signal: str) -> str:
    """Return a signal of an axis in two words."""
    return f"{axis} {SHORT.get(signal, signal)}"


def density(r: Region) -> float:
    """Return how many times denser than even the squared residual lies in a region."""
    return max(r.share / max(r.time_share, 1e-6), 1e-6)


def bars(gap: Gap, *, acts: bool) -> dict[str, tuple[float, str]]:
    """Return the RMS [SI] and the colour of each bar of a signal; ``acts``: whether a named cause acts on it."""
    rows = {
        "residual today": (gap.rms, RESIDUAL),
        "with the causes": (gap.after if acts else 0.0, ACCENT),
        "validation error": (gap.misfit, "#8c9bb0"),
        "noise": (gap.noise, "#59a14f"),
    }
    return {name: row for name, row in rows.items() if row[0] > 0.0 or name == "residual today"}


def shrink_figure(gap: Gap, signal: str, rotary: bool, *, acts: bool) -> go.Figure:
    """Return the bars of one signal of one axis."""
    items = bars(gap, acts=acts)
    sizes, colours = np.array([size for size, _ in items.values()]), [colour for _, colour in items.values()]
    scale = scale_of(signal, rotary, sizes)
    figure = go.Figure(
        go.Bar(y=[*items], x=scale(sizes), orientation="h", marker_color=colours, hoverinfo="skip")
    )
    for name, (size, _) in items.items():
        looks = {"xanchor": "left", "xshift": 6, "showarrow": False}
        figure.add_annotation(x=size * scale.factor, y=name, text=scale.text(size), **looks)
    style(figure, 66 + 34 * len(items), x=f"RMS [{scale.unit}]", legend=False)
    figure.update_layout(bargap=0.35)
    figure.update_xaxes(range=[0, 1.4 * max(float(scale(sizes).max()), 1e-300)])
    return figure.update_yaxes(autorange="reversed", showgrid=False, zeroline=False)


def shown(given: Traces) -> list[tuple[str, Floats, str]]:
    """Return name, values and colour of log minus model, before and after the named effects."""
    size = float(np.max(np.abs(given.before), initial=0.0))
    same = np.allclose(given.before, given.after, rtol=0.0, atol=1e-4 * size)
    after = [] if same else [("with the cause", given.after, ACCENT)]
    return [("model today", given.before, RESIDUAL), *after]


def gap_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return log minus model over time, before and after the named effects."""
    scale = scale_of("u", rotary, given.before)
    panel = Panel("log minus model", [Line(*line) for line in shown(given)], scale)
    return over_time(given.t, [panel], 300, block=blocks(given.t))


def blocks(t: Floats) -> Ints:
    """Return the number of the unbroken stretch in which each row of t [s] (m,) lies."""
    step = np.diff(t)
    return np.r_[0, np.cumsum(step > 3.0 * np.median(step if len(step) else 1.0))].astype(np.intp)


def spectrum_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return the amplitude spectrum (Welch 1967) of log minus model over the longest stretch, in windows of 2 s."""
    step = np.diff(given.t)
    usual = float(np.median(step))
    stretch = longest(step > 1.5 * usual)
    width = min(stretch.stop - stretch.start, max(round(2.0 / usual), 16))
    scale = scale_of("u", rotary, given.before)
    figure = go.Figure()
    for name, y, colour in shown(given):
        f, power = welch(y[stretch], 1.0 / usual, nperseg=width)
        figure.add_trace(line(f[1:], scale(np.sqrt(power[1:])), name, colour))
    style(figure, 300, x="frequency [Hz]", y=f"log minus model [{scale.unit}/√Hz]")
    return figure.update_yaxes(type="log")
