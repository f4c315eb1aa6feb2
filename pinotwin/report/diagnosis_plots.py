"""Plots of a diagnosis: how far the residual falls, what it looks like over time and by frequency."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from scipy.signal import welch

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.result import Region, Traces
from pinotwin.report.display import scale_of
from pinotwin.report.figures import ACCENT, RESIDUAL, Line, Panel, line, longest, over_time, style


def density(r: Region) -> float:
    """Return how many times denser than even the squared residual lies in a region."""
    return max(r.share / max(r.time_share, 1e-6), 1e-6)


def shown(given: Traces) -> list[tuple[str, Floats, str]]:
    """Return name, values and colour of log minus model, before and after the named effects."""
    size = float(np.max(np.abs(given.before), initial=0.0))
    same = np.allclose(given.before, given.after, rtol=0.0, atol=1e-4 * size)
    if same:
        return [("residual", given.before, RESIDUAL)]
    return [("without the cause", given.before, RESIDUAL), ("with the cause", given.after, ACCENT)]


def gap_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return log minus model over time, before and after the named effects."""
    scale = scale_of("u", rotary, given.before)
    panel = Panel("residual", [Line(*line) for line in shown(given)], scale)
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
    style(figure, 300, x="frequency [Hz]", y=f"residual [{scale.unit}/√Hz]")
    return figure.update_yaxes(type="log")
