"""Plots of measured and predicted effort, of the residual, and of what the effort is made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.arrays import Floats
from pinotwin.report import display
from pinotwin.report.figures import (
    ACCENT,
    MEASURED,
    POINTS,
    RESIDUAL,
    broken,
    dots,
    effect_colour,
    effect_name,
    line,
    some_rows,
    style,
    visible_rows,
)
from pinotwin.signals import autocorrelation, welch
from pinotwin.studies.evidence import Evidence
from pinotwin.studies.overlay import binned

_LEAST_SHARE = 0.002


def effort_figure(given: Evidence) -> go.Figure:
    """Return measured and predicted effort with the residual below, all axes on one time axis."""
    count = len(given.measured)
    heights = [2.3, 1.0] * count
    figure = make_subplots(
        rows=2 * count,
        cols=1,
        shared_xaxes=True,
        row_heights=heights,
        vertical_spacing=0.028 / count**0.5,
    )
    points = max(POINTS // max(count // 2, 1), 1200)
    for k, j in enumerate(given.measured):
        _effort_pair(figure, given, j, 2 * k + 1, points)
    figure.update_xaxes(title_text="time [s]", row=2 * count, col=1)
    style(figure, 70 + 285 * count)
    return figure


def _effort_pair(figure: go.Figure, given: Evidence, j: int, row: int, points: int) -> None:
    u, predicted, residual = given.u[:, j], given.predicted[:, j], given.residual[:, j]
    still = np.where(given.use[:, j], np.nan, residual)
    rows = visible_rows([u, residual], points)
    scale = display.effort(given.rotary[j], display.largest(u))
    moving = np.where(given.use[:, j], residual, np.nan)
    t, *values = broken(rows, given.block, given.t, u, predicted, moving, still)
    shown = [scale(x) for x in values]
    first = row == 1
    for y, name, colour, width in (
        (shown[0], "measured", MEASURED, 2.6),
        (shown[1], "predicted", ACCENT, 1.1),
    ):
        trace = line(t, y, name, colour, width=width, legend=first, unit=scale.unit)
        figure.add_trace(trace, row=row, col=1)
    for y, name, colour in (
        (shown[2], "residual", RESIDUAL),
        (shown[3], "residual, not fitted", MEASURED),
    ):
        if name == "residual" or np.isfinite(y).any():
            trace = line(t, y, name, colour, width=1, legend=first, unit=scale.unit)
            figure.add_trace(trace, row=row + 1, col=1)
    figure.update_yaxes(title_text=f"<b>{given.names[j]}</b> [{scale.unit}]", row=row, col=1)
    figure.update_yaxes(title_text="residual", row=row + 1, col=1, nticks=4)


def shares(given: Evidence, j: int) -> dict[str, float]:
    """Return the RMS of every effect on one joint, residual last, strongest effect first [SI].

    The effects of one name are summed; effects below 0.2 % of all are left out.
    """
    use = given.use[:, j]
    total: dict[str, Floats] = {}
    for key, part in given.parts.items():
        name = effect_name(key)
        total[name] = total.get(name, 0.0) + part[use, j]
    size = {name: float(np.sqrt(np.mean(x**2))) for name, x in total.items()}
    everything = sum(size.values())
    ranked = sorted(size.items(), key=lambda item: -item[1])
    out = {name: rms for name, rms in ranked if rms > _LEAST_SHARE * everything}
    out["residual"] = float(np.sqrt(np.mean(given.residual[use, j] ** 2)))
    return out


def shares_figure(given: Evidence) -> go.Figure:
    """Return the effects' shares of every axis' effort as stacked bars."""
    figure = go.Figure()
    rows = {given.names[j]: shares(given, j) for j in given.measured}
    units = {given.names[j]: "N·m" if given.rotary[j] else "N" for j in given.measured}
    order = list(dict.fromkeys(name for row in rows.values() for name in row if name != "residual"))
    for name in [*order, "residual"]:
        axes = [axis for axis, row in rows.items() if name in row]
        values = [100.0 * rows[axis][name] / sum(rows[axis].values()) for axis in axes]
        text = [f"{rows[axis][name]:.3g} {units[axis]} rms" for axis in axes]
        colour = RESIDUAL if name == "residual" else effect_colour(name)
        pattern = {"shape": "/", "size": 6, "fgcolor": RESIDUAL, "fillmode": "replace"}
        figure.add_bar(
            y=axes,
            x=values,
            name=name.replace("_", " "),
            orientation="h",
            customdata=text,
            marker={"color": colour, "pattern": pattern if name == "residual" else None},
            hovertemplate="%{customdata}, %{x:.1f} %<extra>%{fullData.name}</extra>",
            text=[f"{x:.0f} %" if x >= 6 else "" for x in values],
            textposition="inside",
            insidetextanchor="middle",
            textangle=0,
            textfont={"color": "#fff" if name != "residual" else SOFT_TEXT},
        )
    style(figure, 110 + 46 * len(rows))
    figure.update_layout(barmode="stack", bargap=0.35, legend_traceorder="normal")
    figure.update_xaxes(title_text="share of the summed RMS [%]", range=[0, 100])
    figure.update_yaxes(autorange="reversed", showgrid=False, type="category")
    return figure


SOFT_TEXT = "var(--soft)"


def breakdown_figure(given: Evidence, j: int) -> go.Figure:
    """Return each effect's contribution to one axis' effort over time."""
    names = [name for name in shares(given, j) if name != "residual"]
    sums = {name: np.zeros(len(given.t)) for name in names}
    for key, part in given.parts.items():
        if effect_name(key) in sums:
            sums[effect_name(key)] += part[:, j]
    rows = visible_rows([given.u[:, j], *list(sums.values())[:3]], 2000)
    scale = display.effort(given.rotary[j], display.largest(given.u[:, j]))
    figure = go.Figure()
    for name, y, colour, width in [
        ("measured", given.u[:, j], MEASURED, 1.2),
        *((name, x, effect_colour(name), 1.5) for name, x in sums.items()),
    ]:
        t, shown = broken(rows, given.block, given.t, y)
        label = name.replace("_", " ")
        trace = line(t, scale(shown), label, colour, width=width, unit=scale.unit)
        figure.add_trace(trace)
    return style(figure, 360, x="time [s]", y=f"effort [{scale.unit}]")


def residual_figure(given: Evidence, j: int, against: str) -> go.Figure:
    """Return one axis' residual against its ``"velocity"`` or ``"position"``, with its median."""
    use = np.flatnonzero(given.use[:, j])
    raw = (given.v if against == "velocity" else given.q)[:, j]
    of = display.velocity if against == "velocity" else display.position
    across = of(given.rotary[j], display.largest(raw))
    up = display.effort(given.rotary[j], display.largest(given.u[:, j]))
    figure = go.Figure()
    rows = some_rows(0, use)
    figure.add_trace(dots(across(raw[rows]), up(given.residual[rows, j]), "residual"))
    _add_bins(figure, raw[use], given.residual[use, j], across, up)
    return style(figure, 290, x=f"{against} [{across.unit}]", y=f"residual [{up.unit}]")


def _add_bins(figure: go.Figure, x: Floats, y: Floats, across: display.Scale, up: display.Scale) -> None:
    if len(x) < 20 or np.ptp(x) <= 0.0:
        return
    bins = binned(x, y, 40)
    figure.add_trace(
        go.Scatter(
            x=across(np.r_[bins.x, bins.x[::-1]]),
            y=up(np.r_[bins.high, bins.low[::-1]]),
            fill="toself",
            fillcolor=RESIDUAL,
            opacity=0.22,
            line={"width": 0},
            mode="lines",
            name="middle half",
            hoverinfo="skip",
        )
    )
    figure.add_trace(line(across(bins.x), up(bins.median), "median", RESIDUAL, width=2))


def spectrum_figure(given: Evidence, j: int) -> go.Figure:
    """Return the amplitude spectral density of one axis' effort and residual."""
    longest = _longest(given)
    figure = go.Figure()
    top = -np.inf
    for name, x, colour in (
        ("measured effort", given.u[longest, j], MEASURED),
        ("residual", given.residual[longest, j], RESIDUAL),
    ):
        spectrum = welch(x, given.rate, length=min(2048, max(len(x) // 4, 16)))
        keep = spectrum.f > 0.0
        y = np.sqrt(spectrum.density[keep])
        top = max(top, np.log10(max(float(y.max()), 1e-300)))
        figure.add_trace(line(spectrum.f[keep], y, name, colour))
    style(figure, 290)
    unit = "N·m" if given.rotary[j] else "N"
    figure.update_xaxes(title_text="frequency [Hz]", type="log", dtick=1, minor={"showgrid": False})
    figure.update_yaxes(
        title_text=f"density [{unit}/√Hz]",
        type="log",
        tickformat="~g",
        dtick=1,
        range=[top - 4.5, top + 0.3],
    )
    return figure


def correlation_figure(given: Evidence, j: int) -> go.Figure:
    """Return the autocorrelation of one axis' residual with the band that white noise stays in."""
    longest = _longest(given)
    residual = given.residual[longest, j]
    lags = min(len(residual) // 4, int(max(1.0 * given.rate, 50)), 1500)
    r = autocorrelation(residual, lags)
    lag = np.arange(lags + 1) / given.rate
    band = 1.96 / np.sqrt(len(residual))
    figure = go.Figure(line(lag, r, "residual", RESIDUAL))
    figure.add_hrect(y0=-band, y1=band, fillcolor=MEASURED, opacity=0.3, line_width=0)
    style(figure, 290, legend=False)
    figure.update_xaxes(title_text="lag [s]")
    figure.update_yaxes(title_text="correlation", range=[min(-0.25, float(r.min()) - 0.05), 1.05])
    return figure


def _longest(given: Evidence) -> slice:
    """Return the rows of the longest unbroken stretch."""
    edges = np.r_[0, np.flatnonzero(np.diff(given.block)) + 1, len(given.block)]
    k = int(np.argmax(np.diff(edges)))
    return slice(int(edges[k]), int(edges[k + 1]))


def can_correlate(given: Evidence, j: int) -> bool:
    """Return whether the residual is long enough, and alive, for a spectrum."""
    longest = _longest(given)
    return longest.stop - longest.start >= 64 and bool(np.ptp(given.residual[longest, j]) > 0.0)


__all__: Sequence[str] = (
    "breakdown_figure",
    "can_correlate",
    "correlation_figure",
    "effort_figure",
    "residual_figure",
    "shares",
    "shares_figure",
    "spectrum_figure",
)
