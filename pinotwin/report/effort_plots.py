"""Plots of measured and predicted effort, of the residual, and of what the effort is made of."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats
from pinotwin.report import display
from pinotwin.report.figures import (
    ACCENT,
    MEASURED,
    RESIDUAL,
    Line,
    Panel,
    clouds,
    effect_colour,
    effect_name,
    line,
    over_time,
    share_bars,
    style,
)
from pinotwin.signals import autocorrelation, welch
from pinotwin.studies.evidence import Evidence


def effort_figure(given: Evidence) -> go.Figure:
    """Return measured and predicted effort with the residual below, all axes on one time axis."""
    count = len(given.measured)
    panels = [panel for j in given.measured for panel in _effort_pair(given, j)]
    points = max(3000 // max(count // 2, 1), 1200)
    return over_time(given.t, panels, 70 + 285 * count, block=given.block, points=points)


def _effort_pair(given: Evidence, j: int) -> tuple[Panel, Panel]:
    u, predicted, residual = given.u[:, j], given.predicted[:, j], given.residual[:, j]
    scale = display.effort(given.rotary[j], display.largest(u))
    lines = [Line("residual", np.where(given.use[:, j], residual, np.nan), RESIDUAL, 1)]
    still = np.where(given.use[:, j], np.nan, residual)
    if np.isfinite(still).any():
        lines.append(Line("residual, not fitted", still, MEASURED, 1))
    both = [Line("measured", u, MEASURED, 2.6), Line("predicted", predicted, ACCENT, 1.1)]
    name = f"<b>{given.names[j]}</b>"
    return Panel(name, both, scale, 2.3), Panel("residual", lines, display.Scale(scale.factor, ""))


def shares(given: Evidence, j: int, least: float = 0.002) -> dict[str, float]:
    """Return the RMS of every effect on one joint, residual last, strongest effect first [SI].

    The effects of one name are summed; effects below a ``least`` share of all are left out.
    """
    use = given.use[:, j]
    total: dict[str, Floats] = {}
    for key, part in given.parts.items():
        name = effect_name(key)
        total[name] = total.get(name, 0.0) + part[use, j]
    size = {name: float(np.sqrt(np.mean(x**2))) for name, x in total.items()}
    everything = sum(size.values())
    ranked = sorted(size.items(), key=lambda item: -item[1])
    out = {name: rms for name, rms in ranked if rms > least * everything}
    out["residual"] = float(np.sqrt(np.mean(given.residual[use, j] ** 2)))
    return out


def shares_figure(given: Evidence) -> go.Figure:
    """Return the effects' shares of every axis' effort as stacked bars."""
    rms = {given.names[j]: shares(given, j) for j in given.measured}
    units = {given.names[j]: "N·m" if given.rotary[j] else "N" for j in given.measured}
    rows = {axis: {k: x / sum(row.values()) for k, x in row.items()} for axis, row in rms.items()}
    names = dict.fromkeys(name for row in rms.values() for name in row if name != "residual")
    looks = {name: (name.replace("_", " "), effect_colour(name)) for name in names}
    return share_bars(
        rows,
        {**looks, "residual": ("residual", RESIDUAL)},
        "share of the summed RMS [%]",
        lambda axis, name: f"{rms[axis][name]:.3g} {units[axis]} rms",
    )


def breakdown_figure(given: Evidence, j: int) -> go.Figure:
    """Return each effect's contribution to one axis' effort over time."""
    sums = {name: np.zeros(len(given.t)) for name in shares(given, j) if name != "residual"}
    for key, part in given.parts.items():
        if effect_name(key) in sums:
            sums[effect_name(key)] += part[:, j]
    lines = [Line("measured", given.u[:, j], MEASURED, 1.2)]
    lines += [Line(name.replace("_", " "), x, effect_colour(name), 1.5) for name, x in sums.items()]
    scale = display.effort(given.rotary[j], display.largest(given.u[:, j]))
    return over_time(given.t, [Panel("effort", lines, scale)], 360, block=given.block, points=2000)


def residual_figure(given: Evidence, j: int, against: str) -> go.Figure:
    """Return one axis' residual against its ``"velocity"`` or ``"position"``, with its median."""
    use = given.use[:, j]
    x = (given.v if against == "velocity" else given.q)[:, j]
    of = display.velocity if against == "velocity" else display.position
    across = of(given.rotary[j], display.largest(x))
    up = display.effort(given.rotary[j], display.largest(given.u[:, j]))
    figure = clouds(x[use], [("residual", given.residual[use, j], RESIDUAL)], across, up)
    return style(figure, 290, x=f"{against} [{across.unit}]", y=f"residual [{up.unit}]")


def spectrum_figure(given: Evidence, j: int) -> go.Figure:
    """Return the amplitude spectral density of one axis' effort and residual."""
    longest, unit = _longest(given), "N·m" if given.rotary[j] else "N"
    figure = style(go.Figure(), 290, x="frequency [Hz]", y=f"density [{unit}/√Hz]")
    top = -np.inf
    for name, x, colour in (
        ("measured effort", given.u[longest, j], MEASURED),
        ("residual", given.residual[longest, j], RESIDUAL),
    ):
        spectrum = welch(x, given.rate, length=min(2048, max(len(x) // 4, 16)))
        y = np.sqrt(spectrum.density[spectrum.f > 0.0])
        top = max(top, np.log10(max(float(y.max()), 1e-300)))
        figure.add_trace(line(spectrum.f[spectrum.f > 0.0], y, name, colour))
    figure.update_xaxes(type="log", dtick=1, minor={"showgrid": False})
    return figure.update_yaxes(type="log", tickformat="~g", dtick=1, range=[top - 4.5, top + 0.3])


def correlation_figure(given: Evidence, j: int) -> go.Figure:
    """Return the autocorrelation of one axis' residual with the band that white noise stays in."""
    residual = given.residual[_longest(given), j]
    lags = min(len(residual) // 4, int(max(1.0 * given.rate, 50)), 1500)
    r = autocorrelation(residual, lags)
    band = 1.96 / np.sqrt(len(residual))
    figure = go.Figure(line(np.arange(lags + 1) / given.rate, r, "residual", RESIDUAL))
    figure.add_hrect(y0=-band, y1=band, fillcolor=MEASURED, opacity=0.3, line_width=0)
    style(figure, 290, x="lag [s]", y="correlation", legend=False)
    return figure.update_yaxes(range=[min(-0.25, float(r.min()) - 0.05), 1.05])


def _longest(given: Evidence) -> slice:
    """Return the rows of the longest unbroken stretch."""
    edges = np.r_[0, np.flatnonzero(np.diff(given.block)) + 1, len(given.block)]
    k = int(np.argmax(np.diff(edges)))
    return slice(int(edges[k]), int(edges[k + 1]))


def can_correlate(given: Evidence, j: int) -> bool:
    """Return whether the residual is long enough, and alive, for a spectrum."""
    longest = _longest(given)
    return longest.stop - longest.start >= 64 and bool(np.ptp(given.residual[longest, j]) > 0.0)
