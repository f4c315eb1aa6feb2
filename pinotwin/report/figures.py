"""What all plots share: colours, layout, the kinds of plot, and how a long log is thinned for the screen.

Colours ``var(--...)`` follow the page's theme; those of effects are fixed mid-tones that read on white and on black.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.effects import EFFECTS, effect_name
from pinotwin.report.display import SI, Scale, scale_of
from pinotwin.studies.overlay import Against, binned
from pinotwin.system.templates import asset

ACCENT = "var(--accent)"
MEASURED = "var(--measured)"
RESIDUAL = "#d2691e"
SOFT = "var(--soft)"

_EFFECTS = {
    **{name: effect.colour for name, effect in EFFECTS.items()},
    "inertia": "#4e79a7",
    "coupling": "#2fa6a0",
    "gravity": "#59a14f",
}
_OTHERS = ("#8c6bb1", "#41ab5d", "#c994c7", "#fd8d3c", "#6baed6", "#bd9e39")


def effect_colour(key: str) -> str:
    """Return the colour of an effect; one that the table does not know gets one by its name."""
    name = effect_name(key)
    return _EFFECTS.get(name, _OTHERS[sum(map(ord, name)) % len(_OTHERS)])


def style(figure: go.Figure, height: int, *, x: str = "", y: str = "", legend: bool = True) -> go.Figure:
    """Give a figure the look of the page, and its axes their titles."""
    looks = look()
    figure.update_layout(looks["layout"], height=height, showlegend=legend, margin_t=34 if legend else 14)
    figure.update_xaxes(looks["axis"], zeroline=False, **({"title_text": x} if x else {}))
    return figure.update_yaxes(looks["axis"], zeroline=True, **({"title_text": y} if y else {}))


@cache
def look() -> dict[str, Any]:
    """Return the look that all figures share: the style sheet of the plots."""
    return dict(json.loads(asset("pinotwin.report", "figure.json")))


def packable(y: Floats) -> npt.NDArray[np.float32]:
    """Return what is drawn (m,), any unit, in single precision and to 16 bits: more than a screen or a hint shows."""
    return ((y.astype(np.float32).view(np.uint32) + 0x40) & ~np.uint32(0x7F)).view(np.float32)


def line(
    x: Floats, y: Floats, name: str, colour: str, *, width: float = 1.3, legend: bool = True, unit: str = ""
) -> go.Scatter:
    """Return a line."""
    return go.Scatter(
        x=x.astype(np.float32),
        y=packable(y),
        name=name,
        mode="lines",
        showlegend=legend,
        legendgroup=name,
        line={"color": colour, "width": width},
        hovertemplate=f"%{{y:.4g}} {unit}<extra>{name}</extra>",
    )


def dots(x: Floats, y: Floats, name: str, colour: str = MEASURED) -> go.Scatter:
    """Return a cloud of points."""
    return go.Scatter(
        x=x.astype(np.float32),
        y=packable(y),
        name=name,
        mode="markers",
        hoverinfo="skip",
        marker={"color": colour, "size": 3.5, "opacity": 0.4, "line": {"width": 0}},
    )


def points(
    x: Floats | Sequence[object],
    y: Floats | Sequence[float | None],
    name: str,
    colour: str,
    error: tuple[Floats, Floats] | None = None,
    unit: str = "",
) -> go.Scatter:
    """Return marks with bars that reach ``error`` above and below them."""
    bars = None
    if error is not None:
        bars = {"type": "data", "symmetric": False, "array": error[0], "arrayminus": error[1]}
        bars |= {"thickness": 1, "width": 0, "color": colour}
    hover = f"%{{y:.4g}} {unit}<extra>{name}</extra>"
    looks = {"color": colour, "size": 7, "line": {"width": 0}}
    return go.Scatter(x=x, y=y, mode="markers", name=name, marker=looks, error_y=bars, hovertemplate=hover)


@dataclass(frozen=True)
class Line:
    """A line over time, values ``y`` [SI] of shape (m,), with times of its own [s] where they are not the plot's."""

    name: str
    y: Floats
    colour: str
    width: float = 1.3
    legend: bool = True
    t: Floats | None = None


@dataclass(frozen=True)
class Panel:
    """One of several plots over the same time, one line at least at the plot's times; ``tall`` beside the others."""

    title: str
    lines: Sequence[Line]
    scale: Scale = SI
    tall: float = 1.0


def over_time(
    t: Floats, panels: Sequence[Panel], height: int, *, block: Ints | None = None, points: int = 700
) -> go.Figure:
    """Return plots over t [s] (m,) that zoom together; no line leaves its ``block`` and keeps about ``points``."""
    count, named = len(panels), set[str]()
    tall = [panel.tall for panel in panels]
    figure = make_subplots(count, 1, shared_xaxes=True, row_heights=tall, vertical_spacing=0.04 / count**0.5)
    for row, panel in enumerate(panels, 1):
        together = visible_rows([x.y for x in panel.lines if x.t is None], points)
        for x in panel.lines:
            if x.t is None:
                at, y = broken(together, block, t, x.y)
            else:
                at, y = broken(visible_rows([x.y], points), None, x.t, x.y)
            shown = x.legend and x.name not in named
            named |= {x.name} if shown else set()
            trace = line(
                at, panel.scale(y), x.name, x.colour, width=x.width, legend=shown, unit=panel.scale.unit
            )
            figure.add_trace(trace, row, 1)
        unit = f" [{panel.scale.unit}]" if panel.scale.unit else ""
        few = 4 if panel.tall < max(tall) else None
        figure.update_yaxes(title_text=f"{panel.title}{unit}", nticks=few, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=count, col=1)
    return style(figure, height, legend=bool(named))


def share_bars(
    shares: Mapping[str, Mapping[str, float]],
    looks: Mapping[str, tuple[str, str]],
    title: str,
    said: Callable[[str, str], str] | None = None,
) -> go.Figure:
    """Return stacked bars of shares (0 to 1), axis -> part; ``looks``: part -> words and colour, residual hatched."""
    figure = go.Figure()
    for name, (words, colour) in looks.items():
        axes = [axis for axis, row in shares.items() if name in row]
        values = [100.0 * shares[axis][name] for axis in axes]
        hatch = {"shape": "/", "size": 6, "fgcolor": RESIDUAL, "fillmode": "replace"}
        figure.add_bar(
            y=axes,
            x=values,
            name=words,
            orientation="h",
            customdata=said and [said(axis, name) for axis in axes],
            marker={"color": colour, "pattern": hatch if colour == RESIDUAL else None},
            hovertemplate=("%{customdata}, " if said else "") + "%{x:.1f} %<extra>%{fullData.name}</extra>",
            text=[f"{x:.0f} %" if x >= 6 else "" for x in values],
            textposition="inside",
            insidetextanchor="middle",
            textangle=0,
            textfont={"color": SOFT if colour == RESIDUAL else "#fff"},
        )
    style(figure, 110 + 46 * len(shares), x=title)
    figure.update_layout(barmode="stack", bargap=0.35, legend_traceorder="normal")
    figure.update_xaxes(range=[0, 100])
    return figure.update_yaxes(autorange="reversed", showgrid=False, type="category")


def against_figure(
    against: Against, rotary: bool, x: Floats, series: Sequence[tuple[str, Floats, str]], size: Floats
) -> go.Figure:
    """Return residuals over position or speed, medians of forty bins; ``series``: name, values [SI] (m,), colour."""
    across = scale_of("v" if against == "velocity" else "q", rotary, x)
    up = scale_of("u", rotary, size)
    rows, single = some_rows(len(x), points=450), len(series) == 1
    figure = style(go.Figure(), 300, x=f"{against} [{across.unit}]", y=f"residual [{up.unit}]")
    for name, y, colour in series:
        cloud = dots(across(x[rows]), up(y[rows]), name, MEASURED if single else colour)
        figure.add_trace(cloud.update(legendgroup=name))
    if len(x) < 40 or np.ptp(x) <= 0.0:
        return figure
    for name, y, colour in series:
        at, median, low, high = binned(x, y, 40)
        if single:
            both, ends = np.r_[at, at[::-1]], np.r_[high, low[::-1]]
            band = line(across(both), up(ends), "middle half", colour, width=0)
            figure.add_trace(band.update(fill="toself", fillcolor=colour, opacity=0.22, hoverinfo="skip"))
        name = "median" if single else name
        figure.add_trace(line(across(at), up(median), name, colour, width=2.2, legend=single))
    return figure


def longest(breaks: Mask) -> slice:
    """Return the rows of the longest stretch without a break; ``breaks``, shape (m - 1,): whether one follows a row."""
    edges = np.r_[0, np.flatnonzero(breaks) + 1, len(breaks) + 1]
    k = int(np.argmax(np.diff(edges)))
    return slice(int(edges[k]), int(edges[k + 1]))


def blocks(t: Floats) -> Ints:
    """Return the number of the unbroken stretch in which each row of t [s] (m,) lies."""
    step = np.diff(t)
    return np.r_[0, np.cumsum(step > 3.0 * np.median(step if len(step) else 1.0))].astype(np.intp)


def visible_rows(signals: list[Floats], points: int = 800) -> Ints:
    """Return the rows (k,) that a screen needs, about ``points``: the extremes of every signal (m,) per pixel."""
    m = len(signals[0])
    if m <= points:
        return np.arange(m)
    buckets = max(points // (2 * len(signals)), 1)
    size = -(-m // buckets)
    keep = [np.array([0, m - 1])]
    for x in signals:
        padded = np.pad(np.nan_to_num(x), (0, size * buckets - m), mode="edge")
        shaped = padded.reshape(buckets, size)
        start = np.arange(buckets) * size
        keep += [start + shaped.argmin(axis=1), start + shaped.argmax(axis=1)]
    return np.unique(np.minimum(np.concatenate(keep), m - 1))


def broken(rows: Ints, block: Ints | None, *arrays: Floats) -> list[Floats]:
    """Return arrays at ``rows`` with a NaN where the log breaks, so that no line bridges it."""
    changes = np.zeros(max(len(rows) - 1, 0)) if block is None else np.diff(block[rows])
    breaks = np.flatnonzero(changes) + 1
    return [np.insert(np.asarray(x[rows], dtype=float), breaks, np.nan) for x in arrays]


def some_rows(count: int, points: int = 900) -> Ints:
    """Return rows for a cloud of points, at random so that no pattern of the log is aliased."""
    if count <= points:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, points, replace=False))
