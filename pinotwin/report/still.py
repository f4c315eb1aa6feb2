"""A figure as a still picture without script or network, which a notebook on a code host shows: lines and bars."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import plotly.graph_objects as go

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def still(figure: go.Figure) -> str:
    """Return lines and horizontal bars of a figure as an ``<img>`` element."""
    text = svg(figure)
    return f'<img alt="figure" src="data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode()}"/>'


def svg(figure: go.Figure, wide: int = 760) -> str:
    """Return lines and horizontal bars of a figure as SVG text, ``wide`` pixels wide."""
    import matplotlib
    from matplotlib.figure import Figure

    high, out = int(figure.layout.height or 300), io.StringIO()
    drawn = Figure(figsize=(wide / 96.0, high / 96.0))
    left, low, tall = 92.0 / wide, 42.0 / high, 1.0 - 72.0 / high
    panels: dict[tuple[str, str], list[Any]] = {}
    for trace in figure.data:
        panels.setdefault((trace.xaxis or "x", trace.yaxis or "y"), []).append(trace)
    for (x, y), traces in panels.items():
        across, up = (figure.layout[name.replace(name[0], f"{name[0]}axis")] for name in (x, y))
        bottom, top = up.domain or (0.0, 1.0)
        axes = drawn.add_axes((left, low + tall * bottom, 0.98 - left, tall * (top - bottom)))
        for k, trace in enumerate(traces):
            _draw(axes, trace, f"trace-{y}-{k}")
        if up.type == "log":
            axes.set_yscale("log")
        axes.set_ylabel(_plain(up.title.text), fontsize=9)
        axes.set_xlabel(_plain(across.title.text), fontsize=9)
        axes.tick_params(labelsize=8, labelbottom=bool(across.title.text) or len(panels) == 1)
    handles = [
        line for axes in drawn.axes for line in axes.lines if not str(line.get_label()).startswith("_")
    ]
    if handles:
        drawn.legend(handles=handles, loc="upper left", ncols=6, fontsize=9, frameon=False)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "pinotwin"}):
        drawn.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue().partition("<!DOCTYPE")[2].partition(">")[2].strip()


def _draw(axes: Axes, trace: Any, name: str) -> None:
    """Draw a line, or bars with their values."""
    if trace.type == "scatter":
        label = trace.name if trace.name and trace.showlegend is not False else "_"
        width, colour = trace.line.width or 1, trace.line.color or trace.marker.color
        axes.plot(trace.x, trace.y, color=colour, linewidth=width, label=label, gid=name)
        return
    bars = axes.barh(trace.y, trace.x, color=trace.marker.color)
    axes.bar_label(bars, [f"{float(x):.3g}" for x in trace.x], padding=4, fontsize=8)
    axes.margins(x=0.2)
    axes.invert_yaxis()


def _plain(text: str | None) -> str:
    return (text or "").replace("<b>", "").replace("</b>", "")
