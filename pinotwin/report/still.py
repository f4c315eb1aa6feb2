"""A figure as a still picture: an image of lines and bars that needs no script and no network.

A notebook on a code host shows no script's output; it does show an image.
"""

from __future__ import annotations

import base64
import html
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 760, 92, 12, 26, 38
"""Size and margins of the picture [px]."""


def still(figure: go.Figure) -> str:
    """Return lines and horizontal bars of a figure as an ``<img>`` element."""
    text = svg(figure)
    return f'<img alt="figure" src="data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode()}"/>'


def svg(figure: go.Figure) -> str:
    """Return lines and horizontal bars of a figure as SVG text."""
    height = int(figure.layout.height or 300)
    panels: dict[tuple[str, str], list[Any]] = {}
    for trace in figure.data:
        panels.setdefault((trace.xaxis or "x", trace.yaxis or "y"), []).append(trace)
    parts = [part for (x, y), traces in panels.items() for part in _panel(figure, x, y, traces, height)]
    parts.append(_legend(figure))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" font-size="12" '
        f'font-family="sans-serif" fill="#444"><rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>'
    )


def _panel(figure: go.Figure, x: str, y: str, traces: list[Any], height: int) -> list[str]:
    """Return one pair of axes with its traces."""
    across, up = (figure.layout[name.replace(name[0], f"{name[0]}axis")] for name in (x, y))
    low, high = up.domain or (0.0, 1.0)
    span = height - TOP - BOTTOM
    top, bottom = TOP + (1.0 - high) * span, TOP + (1.0 - low) * span
    out = [_rect(LEFT, top, WIDTH - LEFT - RIGHT, bottom - top, "none", "#ccc")]
    out.append(_text(14, 0.5 * (top + bottom), _plain(up.title.text), turned=True))
    lines = [t for t in traces if t.type == "scatter"]
    if not lines:
        return [*out, *(part for t in traces for part in _bars(t, top, bottom))]
    data = [(t, np.asarray(t.x, dtype=float), np.asarray(t.y, dtype=float)) for t in lines]
    if up.type == "log":
        data = [(t, tx, np.log10(np.where(ty > 0.0, ty, np.nan))) for t, tx, ty in data]
    box = [*_ends([d[1] for d in data]), *_ends([d[2] for d in data])]
    for value, place in zip(box[2:], (bottom - 3, top + 11), strict=True):
        shown = 10.0**value if up.type == "log" else value
        out.append(_text(LEFT - 4, place, f"{shown:.3g}", "end"))
    if across.title.text or len(figure.data) == len(traces):
        out.append(_text(LEFT, bottom + 14, f"{box[0]:.3g}"))
        out.append(_text(WIDTH - RIGHT, bottom + 14, f"{box[1]:.3g}", "end"))
        out.append(_text(0.5 * (LEFT + WIDTH), bottom + 28, _plain(across.title.text), "middle"))
    return [*out, *(_line(t, tx, ty, box, top, bottom) for t, tx, ty in data)]


def _ends(values: list[Floats]) -> tuple[float, float]:
    every = np.concatenate(values)
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _line(trace: Any, x: Floats, y: Floats, box: list[float], top: float, bottom: float) -> str:
    """Return a line that breaks where its values do, with the extremes of every pixel column."""
    px = LEFT + (x - box[0]) / (box[1] - box[0]) * (WIDTH - LEFT - RIGHT)
    py = bottom - (y - box[2]) / (box[3] - box[2]) * (bottom - top)
    kept = np.isfinite(px) & np.isfinite(py)
    cells = np.where(kept, np.nan_to_num(px), -1.0).astype(int)
    points, pen = [], "M"
    for rows in np.split(np.arange(len(px)), np.flatnonzero(np.diff(cells)) + 1):
        if not len(rows) or not kept[rows[0]]:
            pen = "M"
            continue
        for k in sorted({rows[int(np.argmin(py[rows]))], rows[int(np.argmax(py[rows]))]}):
            points.append(f"{pen}{px[k]:.1f} {py[k]:.1f}")
            pen = "L"
    colour, width = trace.line.color or trace.marker.color, trace.line.width or 1
    return f'<path d="{"".join(points)}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def _bars(trace: Any, top: float, bottom: float) -> list[str]:
    """Return horizontal bars with their names and values."""
    largest, step = max(*map(float, trace.x), 1e-300), (bottom - top) / max(len(trace.x), 1)
    out = []
    for k, (value, name, colour) in enumerate(zip(trace.x, trace.y, trace.marker.color, strict=True)):
        wide = 0.75 * (WIDTH - LEFT - RIGHT) * float(value) / largest
        out.append(_rect(LEFT, top + (k + 0.2) * step, wide, 0.6 * step, colour, "none"))
        out.append(_text(LEFT + wide + 6, top + (k + 0.6) * step, f"{name}: {float(value):.3g}"))
    return out


def _legend(figure: go.Figure) -> str:
    shown = {t.name: t for t in figure.data if t.type == "scatter" and t.name and t.showlegend is not False}
    out, at = [], LEFT
    for name, trace in shown.items():
        out.append(_rect(at, 11, 18, 3, trace.line.color or trace.marker.color, "none"))
        out.append(_text(at + 23, 17, name))
        at += 40 + 7 * len(name)
    return "".join(out)


def _plain(text: str | None) -> str:
    return (text or "").replace("<b>", "").replace("</b>", "")


def _rect(x: float, y: float, wide: float, high: float, fill: str, stroke: str) -> str:
    size = f'x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{high:.1f}"'
    return f'<rect {size} fill="{fill}" stroke="{stroke}"/>'


def _text(x: float, y: float, text: str, anchor: str = "start", *, turned: bool = False) -> str:
    turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    anchor = "middle" if turned else anchor
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turn}>{html.escape(text)}</text>'
