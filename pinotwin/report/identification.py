"""The report of an identification: verdict, evidence, parameters, and what the data cannot tell.

Plots show measured and predicted effort, the residual, and what the effort is made of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.effects import effect_name
from pinotwin.log import Log
from pinotwin.report import display, figures
from pinotwin.report.blocks import Block, Group, Html, Page, Plot, Tabs, bullets, macro, paragraph, table
from pinotwin.report.closed_loop import closed_loop_content
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, Line, Panel, line, over_time, style
from pinotwin.report.parameter_table import parameter_table
from pinotwin.report.study_plots import overlay_figure
from pinotwin.report.verdict import axis_tiles, bodies, cautions, headline, known
from pinotwin.signals import autocorrelation, rms, welch
from pinotwin.studies.evidence import Evidence, evidence, split_rigid_body
from pinotwin.studies.improvement import Improvement, ratio
from pinotwin.studies.overlay import KINDS, Against, effect_keys_of, explained, overlay
from pinotwin.system.phrases import IMPROVED
from pinotwin.twin import Twin


def identification_report(
    twin: Twin,
    logs: Log | Sequence[Log],
    validate: Sequence[Log] = (),
    made: Mapping[str, Any] | None = None,
    steps: Sequence[Block] = (),
) -> str:
    """Return a self-contained HTML page about an identified machine; DataError where no row can be compared.

    ``steps``: how the model was found, to stand first, see :func:`steps_blocks`.
    """
    given, fitted = evidence(twin, logs), [logs] if isinstance(logs, Log) else list(logs)
    split, first = split_rigid_body(twin, given), [*validate, *fitted][0]
    tied, (head, weights, price) = {name for group in twin.groups for name in group}, bodies(twin)
    content = {
        "headline": headline(twin),
        "steps": steps,
        "tiles_": axis_tiles(twin),
        "cautions": cautions(twin),
        "validation": effort_figure(evidence(twin, validate)) if validate else None,
        "effort": effort_figure(given),
        "causes": shares_figure(split),
        "panels": Tabs({given.names[j]: axis_panel(twin, given, split, j) for j in given.measured}),
        **closed_loop_content(twin, first),
        "seen": "a log that was not used to fit" if validate else "the log that was fitted",
        "bodies": table(head, weights, numeric=(1, 2, 3)) if weights else None,
        "price": "; ".join(price),
        "days": _days(twin),
        "parameters": parameter_table(twin.parameters, list(twin.machine.axes)),
        "groups": [", ".join(map(str, group)) for group in twin.groups],
        "alone": [row for row in twin.parameters if not row.determined and row.name not in tied],
        "logs": macro("logs", {"": twin.data}),
        "twin": twin,
        "rate": given.rate,
        "used": ", ".join(f"{given.names[j]} {int(given.use[:, j].sum())}" for j in given.measured),
        "condition": known(twin.quality, "condition"),
    }
    used = [*((log, "fitted") for log in fitted), *((log, "validation") for log in validate)]
    facts = made_of(twin.machine, used, **(made or {}))
    title, count = f"{twin.machine.name}: identification", int(given.use[:, given.measured].sum())
    length = display.seconds(float(given.t[-1] - given.t[0]))
    said = f"{display.elided(given.source)} · {length} · {count} rows compared"
    return Page(title, said, template="identification", given=content, made=facts).html()


def steps_blocks(found: Improvement) -> list[Block]:
    """Return what `improve` added to a model, with the errors on the sealed logs after every step."""
    kept = [step for step in found.steps if step.kept]
    added = [text for step in kept for text in step.added]
    falls = ratio(found.steps[0].errors, kept[-1].errors)
    said = IMPROVED["added" if added else "none"].format(added="; ".join(added), ratio=falls, end=found.end)
    lines = [f"Step {k}: {text}." for k, step in enumerate(found.steps) for text in step.added]
    lines += [f"End: {found.end}."] if added else []
    rows = table(found.head(), found.rows(), numeric=range(1, len(found.head())))
    return [paragraph(said, "verdict"), rows, paragraph(IMPROVED["errors"], "lead"), bullets(lines)]


def _days(twin: Twin) -> Html | None:
    """Return the table of what friction differs by from log to log; None of an old twin, or without friction."""
    days = twin.quality.get("days", {})
    rows = [[axis, name, display.percent(x)] for axis, row in days.items() for name, x in row.items()]
    return table(("axis", "friction", "standard deviation"), rows, numeric=(2,)) if rows else None


def axis_panel(twin: Twin, given: Evidence, split: Evidence, j: int) -> list[Block]:
    """Return the detailed plots of one axis."""
    name = given.names[j]
    hint = "Click a name in the legend to hide or show it."
    curve = "A curve in the median is friction that the model does not have."
    wave = "A curve or a wave in the median is ripple, cable or guideway."
    speed = Plot(residual_figure(given, j, "velocity"), "Residual against velocity", curve)
    place = Plot(residual_figure(given, j, "position"), "Residual against position", wave)
    breakdown = Plot(breakdown_figure(split, j), f"{name}: contribution of each effect", hint)
    out: list[Block] = [breakdown, *_overlays(twin, given, j), Group((speed, place))]
    if can_correlate(given, j):
        peak = "A peak in the residual is a resonance or a ripple at steady speed."
        white = "White noise stays within the grey band; the intervals allow for what does not."
        spectrum = Plot(spectrum_figure(given, j), "Spectrum", peak)
        correlation = Plot(correlation_figure(given, j), "Autocorrelation of the residual", white)
        out.append(Group((spectrum, correlation)))
    return out


def _overlays(twin: Twin, given: Evidence, j: int) -> list[Block]:
    name = given.names[j]
    out: list[Block] = []
    for title, (names, against) in KINDS.items():
        if not effect_keys_of(twin, name, names) or not given.use[:, j].any():
            continue
        found = overlay(twin, given, name, names, against)
        share = explained(found["extracted"], found["fitted"])
        note = (
            "Points: measured effort minus all other effects of the twin; line: the model, which "
            f"explains {display.percent(max(share, 0.0))} of their power."
        )
        out.append(Plot(overlay_figure(found), f"{title} of {name}", note))
    return out


def effort_figure(given: Evidence) -> go.Figure:
    """Return measured and predicted effort with the residual below, all axes on one time axis."""
    count = len(given.measured)
    panels = [panel for j in given.measured for panel in _effort_pair(given, j)]
    points = max(700 // max(count // 2, 1), 400)
    return over_time(given.t, panels, 70 + 285 * count, block=given.block, points=points)


def _effort_pair(given: Evidence, j: int) -> tuple[Panel, Panel]:
    u, predicted, residual = given.u[:, j], given.predicted[:, j], given.residual[:, j]
    scale = display.scale_of("u", given.rotary[j], u)
    lines = [Line("residual", np.where(given.use[:, j], residual, np.nan), RESIDUAL, 1)]
    still = np.where(given.use[:, j], np.nan, residual)
    if np.isfinite(still).any():
        lines.append(Line("residual, not fitted", still, MEASURED, 1))
    both = [Line("measured", u, MEASURED, 2.6), Line("predicted", predicted, ACCENT, 1.1)]
    name = f"<b>{given.names[j]}</b>"
    return Panel(name, both, scale, 2.3), Panel("residual", lines, display.Scale(scale.factor, ""))


def shares(given: Evidence, j: int, least: float = 0.002) -> dict[str, float]:
    """Return the RMS [SI] of every kind of effect on a joint above a share of all, strongest first, residual last."""
    use = given.use[:, j]
    size = {name: rms(x[use]) for name, x in _by_name(given, j).items()}
    ranked = sorted(size.items(), key=lambda item: -item[1])
    out = {name: x for name, x in ranked if x > least * sum(size.values())}
    return {**out, "residual": rms(given.residual[use, j])}


def _by_name(given: Evidence, j: int) -> dict[str, Floats]:
    """Return the effort (m,) of every kind of effect on one joint [SI]."""
    total: dict[str, Floats] = {}
    for key, part in given.parts.items():
        total[effect_name(key)] = total.get(effect_name(key), 0.0) + part[:, j]
    return total


def shares_figure(given: Evidence) -> go.Figure:
    """Return the effects' shares of every axis' effort as stacked bars."""
    sizes = {given.names[j]: shares(given, j) for j in given.measured}
    units = {given.names[j]: display.effort_unit(given.rotary[j]) for j in given.measured}
    rows = {axis: {k: x / sum(row.values()) for k, x in row.items()} for axis, row in sizes.items()}
    names = dict.fromkeys(name for row in sizes.values() for name in row if name != "residual")
    looks = {name: (name.replace("_", " "), figures.effect_colour(name)) for name in names}
    return figures.share_bars(
        rows,
        {**looks, "residual": ("residual", RESIDUAL)},
        "share of the summed RMS [%]",
        lambda axis, name: f"{sizes[axis][name]:.3g} {units[axis]} rms",
    )


def breakdown_figure(given: Evidence, j: int) -> go.Figure:
    """Return each effect's contribution to one axis' effort over time."""
    sums = _by_name(given, j)
    drawn = [name for name in shares(given, j) if name != "residual"]
    lines = [Line("measured", given.u[:, j], MEASURED, 1.2)]
    lines += [Line(name.replace("_", " "), sums[name], figures.effect_colour(name), 1.5) for name in drawn]
    scale = display.scale_of("u", given.rotary[j], given.u[:, j])
    return over_time(given.t, [Panel("effort", lines, scale)], 360, block=given.block, points=600)


def residual_figure(given: Evidence, j: int, against: Against) -> go.Figure:
    """Return one axis' residual against its ``"velocity"`` or ``"position"``, with its median."""
    use = given.use[:, j]
    x = (given.v if against == "velocity" else given.q)[:, j]
    clouds = [("residual", given.residual[use, j], RESIDUAL)]
    return figures.against_figure(against, given.rotary[j], x[use], clouds, given.u[:, j])


def spectrum_figure(given: Evidence, j: int) -> go.Figure:
    """Return the amplitude spectral density of one axis' effort and residual."""
    rows, unit = _longest(given), display.effort_unit(given.rotary[j])
    figure = style(go.Figure(), 290, x="frequency [Hz]", y=f"density [{unit}/√Hz]")
    top = -np.inf
    for name, x, colour in (
        ("measured effort", given.u[rows, j], MEASURED),
        ("residual", given.residual[rows, j], RESIDUAL),
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
    return figures.longest(np.diff(given.block) != 0)


def can_correlate(given: Evidence, j: int) -> bool:
    """Return whether the residual is long enough, and alive, for a spectrum."""
    rows = _longest(given)
    return rows.stop - rows.start >= 64 and bool(np.ptp(given.residual[rows, j]) > 0.0)
