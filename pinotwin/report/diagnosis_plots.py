"""Plots of a diagnosis: where the gap lies, how far it shrinks, what it looks like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy.signal import welch

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Gap, Region, Traces
from pinotwin.report import display
from pinotwin.report.figures import ACCENT, RESIDUAL, Line, Panel, clouds, line, over_time, style


@dataclass(frozen=True)
class Bar:
    """One bar of the shrinking gap: an RMS in SI."""

    name: str
    value: float
    colour: str


def closes(given: Traces) -> bool:
    """Whether a named cause makes any difference to a gap that can be seen."""
    size = float(np.max(np.abs(given.before), initial=0.0))
    return not np.allclose(given.before, given.after, rtol=0.0, atol=1e-4 * size)


SHORT = {"u": "effort", "e": "error", "v": "vibration", "ql": "twist"}


def signal_name(axis: str, signal: str) -> str:
    """Return a signal of an axis in two words."""
    return f"{axis} {SHORT.get(signal, signal)}"


def density(r: Region) -> float:
    """Return how many times denser than even the gap lies in a region."""
    return max(r.share / max(r.time_share, 1e-6), 1e-6)


def bars(gap: Gap, *, acts: bool) -> list[Bar]:
    """Return the gap today, with the named causes, the model's own misfit and the noise [SI, RMS].

    Args:
        gap: of one signal of one axis.
        acts: whether a named cause acts on it.
    """
    out = [Bar("residual today", gap.rms, RESIDUAL)]
    if acts:
        out.append(Bar("with the causes", gap.after, ACCENT))
    if np.isfinite(gap.misfit):
        out.append(Bar("validation error", gap.misfit, "#8c9bb0"))
    if gap.noise > 0.0:
        out.append(Bar("noise", gap.noise, "#59a14f"))
    return out


def shrink_figure(items: Sequence[Bar], signal: str, rotary: bool) -> go.Figure:
    """Return the bars of one axis."""
    scale = signal_scale(signal, rotary, max(b.value for b in items))
    values, names = [b.value * scale.factor for b in items], [b.name for b in items]
    colours = [b.colour for b in items]
    figure = go.Figure(go.Bar(y=names, x=values, orientation="h", marker_color=colours, hoverinfo="skip"))
    for name, value in zip(names, values, strict=True):
        text = f"{value:.3g} {scale.unit}"
        figure.add_annotation(x=value, y=name, text=text, xanchor="left", xshift=6, showarrow=False)
    style(figure, 66 + 34 * len(items), x=f"RMS [{scale.unit}]", legend=False)
    figure.update_layout(bargap=0.35)
    figure.update_xaxes(range=[0, 1.3 * max(*values, 1e-300)])
    return figure.update_yaxes(autorange="reversed", showgrid=False, zeroline=False)


def signal_scale(signal: str, rotary: bool, largest: float) -> display.Scale:
    """Return the scale of an effort, a tracking error or a vibration."""
    of = {"e": display.position, "ql": display.position, "v": display.velocity}.get(signal, display.effort)
    return of(rotary, largest)


def _shown(given: Traces) -> list[tuple[str, Floats, str]]:
    """Return name, values and colour of log minus model, before and after the named effects."""
    after = [("with the cause", given.after, ACCENT)] if closes(given) else []
    return [("model today", given.before, RESIDUAL), *after]


def gap_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return log minus model over time, before and after the named effects."""
    step = np.diff(given.t)
    usual = float(np.median(step)) if len(step) else 1.0
    block = np.r_[0, np.cumsum(step > 3.0 * usual)].astype(np.intp)
    scale = display.effort(rotary, display.largest(given.before))
    panel = Panel("log minus model", [Line(*line) for line in _shown(given)], scale)
    return over_time(given.t, [panel], 300, block=block)


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
    for name, y, colour in _shown(given):
        f, power = welch(y[stretch], 1.0 / usual, nperseg=width)
        figure.add_trace(line(f[1:], scale(np.sqrt(power[1:])), name, colour))
    style(figure, 300, x="frequency [Hz]", y=f"log minus model [{scale.unit}/√Hz]")
    return figure.update_yaxes(type="log")


def against_figure(given: Traces, x: Floats, rotary: bool, against: str) -> go.Figure:
    """Return log minus model against ``velocity`` or ``position``, with medians.

    Args:
        given: the gap of an axis.
        x: position or velocity at its rows [SI], shape (m,).
        rotary: whether the axis turns.
        against: ``velocity`` or ``position``.
    """
    across = signal_scale("v" if against == "velocity" else "e", rotary, display.largest(x))
    up = display.effort(rotary, display.largest(given.before))
    figure = clouds(x, _shown(given), across, up)
    return style(figure, 300, x=f"{against} [{across.unit}]", y=f"log minus model [{up.unit}]")
