"""The report of an identification: verdict, evidence, parameters, and what the data cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.blocks import Block, Group, Html, Plot, Tabs, bullets, macro, paragraph, table, tiles
from pinotwin.report.closed_loop import closed_loop_content
from pinotwin.report.effort_plots import (
    breakdown_figure,
    can_correlate,
    correlation_figure,
    effort_figure,
    residual_figure,
    shares_figure,
    spectrum_figure,
)
from pinotwin.report.page import Page
from pinotwin.report.parameter_table import parameter_table
from pinotwin.report.study_plots import overlay_figure
from pinotwin.report.verdict import axis_tiles, bodies, cautions, headline, known
from pinotwin.studies.evidence import Evidence, evidence, split_rigid_body
from pinotwin.studies.improvement import Improvement, ratio
from pinotwin.studies.overlay import KINDS, effect_keys_of, explained, overlay
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
        "tiles_": tiles(axis_tiles(twin)),
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
    title = f"{twin.machine.name}: identification"
    return Page(title, _subtitle(given), template="identification", given=content, made=facts).html()


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


def _subtitle(given: Evidence) -> str:
    """Return the line below the title: where the data came from and how much of it there is."""
    count = int(sum(given.use[:, j].sum() for j in given.measured))
    length = display.seconds(float(given.t[-1] - given.t[0]))
    return f"{display.elided(given.source)} · {length} · {count} rows compared"


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
