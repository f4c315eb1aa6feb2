"""What all plots share: colours, layout, and how a long log is thinned for the screen.

Colours written ``var(--...)`` follow the page's theme; the colours of effects are fixed, so that an
effect looks the same in every plot. They are mid-tones that read on white and on black.
"""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats, Ints
from pinotwin.effects import EFFECTS

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
POINTS = 3000
"""Points of a line that a page holds; more would not be seen."""
_SCATTER = 1800


def effect_name(key: str) -> str:
    """Return the plain name of an effect from its key, ``Y.ripple#2`` -> ``ripple``."""
    return key.rsplit(".", 1)[-1].split("#")[0]


def effect_colour(key: str) -> str:
    """Return the colour of an effect; one that the table does not know gets one by its name."""
    name = effect_name(key)
    return _EFFECTS.get(name, _OTHERS[sum(map(ord, name)) % len(_OTHERS)])


def style(figure: go.Figure, height: int, *, x: str = "", y: str = "", legend: bool = True) -> go.Figure:
    """Give a figure the look of the page, and its axes their titles."""
    figure.update_layout(
        template="none",
        height=height,
        showlegend=legend,
        hovermode="closest",
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        margin={"l": 64, "r": 16, "t": 34 if legend else 14, "b": 44},
        font={"size": 12.5, "family": "system-ui, sans-serif"},
        legend={
            "orientation": "h",
            "x": 0,
            "y": 1,
            "yanchor": "bottom",
            "xanchor": "left",
            "bgcolor": "rgba(0,0,0,0)",
            "itemsizing": "constant",
        },
    )
    both = {
        "showgrid": True,
        "ticks": "",
        "automargin": True,
        "title_standoff": 8,
        "title_font": {"size": 12.5},
    }
    figure.update_xaxes(zeroline=False, **both, **({"title_text": x} if x else {}))
    figure.update_yaxes(zeroline=True, **both, **({"title_text": y} if y else {}))
    return figure


def line(
    x: Floats,
    y: Floats,
    name: str,
    colour: str,
    *,
    width: float = 1.3,
    legend: bool = True,
    unit: str = "",
) -> go.Scatter:
    """Return a line; in single precision, which halves the page."""
    return go.Scatter(
        x=x.astype(np.float32),
        y=y.astype(np.float32),
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
        y=y.astype(np.float32),
        name=name,
        mode="markers",
        hoverinfo="skip",
        marker={"color": colour, "size": 3.5, "opacity": 0.4, "line": {"width": 0}},
    )


def visible_rows(signals: list[Floats], points: int = POINTS) -> Ints:
    """Return the rows that a screen needs: the extremes of every signal per pixel, shape (k,).

    Peaks survive, unlike when every so many-th row is taken.

    Args:
        signals: each of shape (m,), drawn over the same abscissa.
        points: how many rows to keep at most, roughly.
    """
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


def broken(rows: Ints, block: Ints, *arrays: Floats) -> list[Floats]:
    """Return arrays at ``rows`` with a NaN where the log breaks, so that no line bridges it."""
    breaks = np.flatnonzero(np.diff(block[rows])) + 1
    return [np.insert(np.asarray(x[rows], dtype=float), breaks, np.nan) for x in arrays]


def some_rows(count: int, among: Ints | None = None, points: int = _SCATTER) -> Ints:
    """Return rows for a cloud of points, at random so that no pattern of the log is aliased."""
    rows = np.arange(count) if among is None else among
    if len(rows) <= points:
        return rows
    return np.sort(np.random.default_rng(0).choice(rows, points, replace=False))
