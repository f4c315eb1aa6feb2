"""Plots of a diagnosis: where the gap lies, how far it shrinks, what it looks like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy.signal import welch

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Gap, Region, Shrink, Traces
from pinotwin.report import display
from pinotwin.report.figures import (
    ACCENT,
    MEASURED,
    RESIDUAL,
    broken,
    dots,
    line,
    some_rows,
    style,
    visible_rows,
)
from pinotwin.report.plain_words import KINDS, region_words
from pinotwin.studies.overlay import binned


@dataclass(frozen=True)
class Bar:
    """One bar of the shrinking gap: an RMS with its interval, in SI."""

    name: str
    value: float
    colour: str
    low: float | None = None
    high: float | None = None


SHORT = {"u": "effort", "e": "error", "v": "vibration"}


def where_figure(regions: Sequence[Region], signals: Sequence[tuple[str, str]]) -> go.Figure:
    """Return signals of axes against kinds of regime; the colour says how much denser a gap is than even."""
    kinds = list(KINDS)
    best: dict[tuple[str, str, str], Region] = {}
    for r in regions:
        old = best.get((r.axis, r.signal, r.kind))
        if old is None or density(r) > density(old):
            best[(r.axis, r.signal, r.kind)] = r
    axes = [signal_name(*x) for x in signals]
    grid = [[best.get((*x, kind)) for kind in kinds] for x in signals]
    figure = go.Figure(
        go.Heatmap(
            x=[KINDS[k] for k in kinds],
            y=list(axes),
            z=[[None if r is None else np.log10(density(r)) for r in row] for row in grid],
            text=[["" if r is None else _cell(r) for r in row] for row in grid],
            customdata=[["" if r is None else region_words(r) for r in row] for row in grid],
            texttemplate="%{text}",
            textfont={"color": "#1b1f24", "size": 13},
            hovertemplate="%{y}: %{customdata}<extra></extra>",
            xgap=3,
            ygap=3,
            zmin=0.0,
            zmax=1.0,
            colorscale=[[0.0, "#fdf0d5"], [0.5, "#f7b267"], [1.0, "#e8743b"]],
            hoverongaps=False,
            colorbar={
                "title": {"text": "denser than even", "side": "right"},
                "thickness": 12,
                "outlinewidth": 0,
                "tickvals": [0.0, 0.301, 0.699, 1.0],
                "ticktext": ["1×", "2×", "5×", "10×"],
            },
        )
    )
    style(figure, 90 + 58 * len(axes), legend=False)
    figure.update_xaxes(side="top", showgrid=False)
    figure.update_yaxes(autorange="reversed", showgrid=False, zeroline=False, type="category")
    return figure.update_layout(margin_t=34, margin_b=14)


def signal_name(axis: str, signal: str) -> str:
    """Return a signal of an axis in two words."""
    return f"{axis} {SHORT.get(signal, signal)}"


def density(r: Region) -> float:
    """Return how many times denser than even the gap lies in a region."""
    return max(r.share / max(r.time_share, 1e-6), 1e-6)


def _cell(r: Region) -> str:
    of = "of band" if r.kind == "frequency" else "of time"
    return f"<b>{r.share:.0%}</b><br>in {max(r.time_share, 0.01):.0%} {of}"


def bars(gap: Gap, shrink: Shrink | None) -> list[Bar]:
    """Return gap before, promised, delivered and the noise [SI, RMS].

    A share s of the squared gap above the noise n leaves sqrt(n² + (1 - s)(before² - n²)).
    """
    out = [Bar("gap with the model today", gap.rms, RESIDUAL)]
    if shrink is not None:

        def left(share: float) -> float:
            return float(
                np.sqrt(gap.noise**2 + max(1.0 - share, 0.0) * max(shrink.before**2 - gap.noise**2, 0.0))
            )

        low, high = left(shrink.interval[1]), left(shrink.interval[0])
        out.append(Bar("promised by the fit", left(shrink.promised), MEASURED))
        out.append(Bar("delivered on new data", shrink.after, ACCENT, low, high))
    return [*out, Bar("noise floor", gap.noise, "#59a14f")]


def shrink_figure(items: Sequence[Bar], signal: str, rotary: bool) -> go.Figure:
    """Return the bars of one axis."""
    scale = signal_scale(signal, rotary, max(b.value for b in items))
    values = [b.value * scale.factor for b in items]
    figure = go.Figure(
        go.Bar(
            y=[b.name for b in items],
            x=values,
            orientation="h",
            marker_color=[b.colour for b in items],
            hoverinfo="skip",
        )
    )
    ends = [scale.factor * max(b.value, b.high or 0.0) for b in items]
    for b, value, end in zip(items, values, ends, strict=True):
        figure.add_annotation(
            x=end,
            y=b.name,
            text=f"{value:.3g} {scale.unit}",
            xanchor="left",
            xshift=6,
            showarrow=False,
        )
        if b.low is not None and b.high is not None:
            span = np.array([b.low, b.high]) * scale.factor
            figure.add_trace(
                go.Scatter(
                    x=span,
                    y=[b.name, b.name],
                    mode="lines",
                    hoverinfo="skip",
                    line={"color": "var(--ink)", "width": 3},
                )
            )
    style(figure, 66 + 34 * len(items), legend=False)
    figure.update_layout(bargap=0.35)
    figure.update_xaxes(title_text=f"RMS [{scale.unit}]", range=[0, 1.25 * max(*ends, 1e-300)])
    return figure.update_yaxes(autorange="reversed", showgrid=False, zeroline=False)


def signal_scale(signal: str, rotary: bool, largest: float) -> display.Scale:
    """Return the scale of an effort, a tracking error or a vibration."""
    of = {"e": display.position, "v": display.velocity}.get(signal, display.effort)
    return of(rotary, largest)


def gap_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return log minus model over time, before and after the named effects."""
    step = np.diff(given.t)
    usual = float(np.median(step)) if len(step) else 1.0
    block = np.r_[0, np.cumsum(step > 3.0 * usual)].astype(np.intp)
    rows = visible_rows([given.before, given.after])
    scale = display.effort(rotary, display.largest(given.before))
    t, before, after = broken(rows, block, given.t, given.before, given.after)
    figure = go.Figure(line(t, scale(before), "model today", RESIDUAL, unit=scale.unit))
    if not np.array_equal(given.before, given.after):
        trace = line(t, scale(after), "with the cause", ACCENT, width=1.1, unit=scale.unit)
        figure.add_trace(trace)
    style(figure, 300)
    figure.update_xaxes(title_text="time [s]")
    return figure.update_yaxes(title_text=f"log minus model [{scale.unit}]")


def spectrum_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return the amplitude spectrum of log minus model, before and after the named effects.

    Over the longest unbroken stretch, in windows of 2 s (Welch 1967, doi:10.1109/TAU.1967.1161901).
    """
    step = np.diff(given.t)
    usual = float(np.median(step))
    ends = np.r_[0, np.flatnonzero(step > 1.5 * usual) + 1, len(given.t)]
    k = int(np.argmax(np.diff(ends)))
    stretch = slice(int(ends[k]), int(ends[k + 1]))
    width = min(stretch.stop - stretch.start, max(round(2.0 / usual), 16))
    scale = display.effort(rotary, display.largest(given.before))
    figure = go.Figure()
    shown = [("model today", given.before, RESIDUAL)]
    if not np.array_equal(given.before, given.after):
        shown.append(("with the cause", given.after, ACCENT))
    for name, y, colour in shown:
        f, power = welch(y[stretch], 1.0 / usual, nperseg=width)
        figure.add_trace(line(f[1:], scale(np.sqrt(power[1:])), name, colour))
    style(figure, 300)
    figure.update_xaxes(title_text="frequency [Hz]")
    return figure.update_yaxes(title_text=f"log minus model [{scale.unit}/√Hz]", type="log")


def against_figure(given: Traces, x: Floats, rotary: bool, against: str) -> go.Figure:
    """Return log minus model against ``velocity`` or ``position``, with medians.

    Args:
        given: the gap of an axis.
        x: position or velocity at its rows [SI], shape (m,).
        rotary: whether the axis turns.
        against: ``velocity`` or ``position``.
    """
    of = display.velocity if against == "velocity" else display.position
    across = of(rotary, display.largest(x))
    up = display.effort(rotary, display.largest(given.before))
    rows = some_rows(len(x), points=1500)
    shown = [("model today", given.before, RESIDUAL)]
    if not np.array_equal(given.before, given.after):
        shown.append(("with the cause", given.after, ACCENT))
    figure = go.Figure()
    for name, y, colour in shown:
        cloud = dots(across(x[rows]), up(y[rows]), name, colour)
        figure.add_trace(cloud.update(legendgroup=name))
    for name, y, colour in shown:
        if len(x) >= 40 and np.ptp(x) > 0.0:
            bins = binned(x, y, 40)
            median = line(across(bins.x), up(bins.median), name, colour, width=2.4, legend=False)
            figure.add_trace(median)
    style(figure, 300)
    figure.update_xaxes(title_text=f"{against} [{across.unit}]")
    return figure.update_yaxes(title_text=f"log minus model [{up.unit}]")
