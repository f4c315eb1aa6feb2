"""The page of ``pinotwin compare``: what moved, how each twin predicts the same log, the series over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.analysis.comparison import Z90, Comparison, Row, effect_title
from pinotwin.analysis.diagnoses import Diagnoses
from pinotwin.diagnosis.conclusion.sizes import size_text, told
from pinotwin.diagnosis.grade import KIND, grade, printed
from pinotwin.diagnosis.result import Size
from pinotwin.report.blocks import Block, Group, Html, Plot, Tile, chip, notes, paragraph, table, tiles
from pinotwin.report.diagnosis_plots import signal_scale
from pinotwin.report.display import Scale, elided
from pinotwin.report.display import rounded as with_error
from pinotwin.report.figures import effect_colour, style
from pinotwin.report.page import Page

KINDS: dict[str, str] = {str(word): kind for word, kind in KIND.items()}
"""Grade -> colour of its chip."""
SI = Scale(1.0, "")
"""As the number stands in the file."""
WORDS = {"simulated e": "tracking error, simulated", "simulated u": "effort, simulated"}
_SHOWN = 12
"""Parameters drawn over the series; the table has them all."""


def comparison_report(found: Comparison) -> str:
    """Return the page of twins side by side as one HTML text."""
    series = len(found.labels) > 2
    title = f"{found.machine}: {' · '.join(found.labels)}"
    page = Page("What moved", title)
    page = page.section("", paragraph(found.sentence, "verdict"), _tiles(found))
    page = page.section(
        "Parameters that moved",
        *_moved(found, series),
        intro="Most significant first. At most one in twenty is due to chance (false discovery rate 5 %). Intervals "
        "include the twins' prediction error on held-out data. Table knots are not tested one by one.",
    )
    page = page.section(
        "Effort of each effect", *_shifts(found), intro=f"Along {found.log}, last against first."
    )
    page = page.section("Errors on the same log", *_errors(found), intro=found.log)
    plain = tuple(row for row in found.rows if np.isfinite(row.p))
    knots = tuple(row for row in found.rows if not np.isfinite(row.p))
    page = page.section("All parameters", _table(found, plain), *_folded(found, knots))
    page = page.section("To note", *_notes(found))
    page = page.section("How this was made", *_made(found))
    return page.html()


def diagnoses_report(found: Diagnoses) -> str:
    """Return the page of diagnoses side by side as one HTML text."""
    page = Page("Diagnoses side by side", " · ".join(found.labels))
    verdicts = [
        Tile(label, str(d.get("verdict", "")).replace("_", " "), str(d.get("sentence", "")))
        for label, d in zip(found.labels, found.documents, strict=True)
    ]
    page = page.section("", paragraph(found.sentence, "verdict"), tiles(verdicts))
    rows = [
        (effect_title(effect), axis, *(_cause(held.get(label)) for label in found.labels))
        for (effect, axis), held in found.causes.items()
    ]
    if rows:
        page = page.section("Causes", table(("effect", "axis", *found.labels), rows))
    gaps = [
        (axis, signal, *(_gap(held.get(label)) for label in found.labels))
        for axis, signals in found.gap.items()
        for signal, held in signals.items()
    ]
    if len(found.labels) > 2:
        page = page.section("Over time", *_gap_series(found))
    head = ("axis", "signal", *found.labels)
    intro = "RMS of log minus model in SI, its share of the signal, and the grade of each diagnosis."
    page = page.section("Gaps", table(head, gaps), intro=intro)
    return page.section("How these were made", _diagnoses_made(found)).html()


def _gap_series(found: Diagnoses) -> list[Block]:
    """Return the gap of every axis' effort from diagnosis to diagnosis, each point with its grade."""
    plots: list[Block] = []
    for axis, signals in found.gap.items():
        held = signals.get("u", {})
        if not held:
            continue
        rows = [held.get(label, {}) for label in found.labels]
        shares = [100.0 * row["nrmse"] if row.get("nrmse") is not None else None for row in rows]
        words = [printed(str(row.get("grade", ""))) for row in rows]
        figure = go.Figure(
            go.Scatter(
                x=list(found.labels),
                y=shares,
                text=words,
                mode="lines+markers+text",
                textposition="top center",
                cliponaxis=False,
                marker={"size": 8},
                line={"width": 1.5},
            )
        )
        figure.update_yaxes(title="residual of the effort [%]", rangemode="tozero")
        plots.append(Plot(style(figure, 240, legend=False), f"Axis {axis}", "RMS over the RMS of the effort"))
    return [Group(tuple(plots[k : k + 2])) for k in range(0, len(plots), 2)]


def _diagnoses_made(found: Diagnoses) -> Html:
    """Return version, date and logs of each diagnosis."""
    rows = []
    for label, document in zip(found.labels, found.documents, strict=True):
        made = document.get("provenance") or {}
        rows.append(
            (
                label,
                made.get("version", "–"),
                made.get("date", "–"),
                _logs(made.get("logs") or ()),
                _logs(made.get("twin_from") or ()) or "no twin: the machine itself",
            )
        )
    return table(("diagnosis", "pinotwin", "made", "of the logs", "twin identified from"), rows)


def _logs(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return names and fingerprints of logs."""
    return "; ".join(
        f"{elided(str(row.get('source', '')), 40)} ({row.get('fingerprint', '–')})" for row in rows
    )


def _made(found: Comparison) -> list[Block]:
    """Return what each twin was identified from."""
    from pinotwin import __version__

    rows = [
        (
            label,
            elided(str(row.get("source", "")), 60),
            row.get("samples", ""),
            f"{float(row['rate']):.6g} Hz" if row.get("rate") else "",
            row.get("fingerprint", ""),
        )
        for label, logs in found.data.items()
        for row in logs
    ]
    head = ("twin", "identified from", "samples", "rate", "fingerprint")
    out: list[Block] = [table(head, rows, numeric=(2, 3))] if rows else []
    return [*out, paragraph(f"pinotwin {__version__}.", "lead")]


def _cause(effect: object) -> str:
    if not isinstance(effect, dict):
        return "not named"
    sizes = "; ".join(size_text(size) for size in told(_sizes(effect.get("size")))[:2])
    sure = f"{float(effect.get('confidence') or 0.0):.0%}"
    return f"{sizes} ({sure})" if sizes else sure


def _sizes(rows: object) -> list[Size]:
    """Return the sizes of an effect of diagnosis.json; none of one that is not as it should be."""
    out = []
    for row in rows if isinstance(rows, list) else ():
        if isinstance(row, dict) and row.get("after") is not None:
            before = math.nan if row.get("before") is None else float(row["before"])
            low, high = (math.nan if x is None else float(x) for x in row.get("interval90") or (None, None))
            out.append(
                Size(
                    str(row.get("name", "")),
                    before,
                    float(row["after"]),
                    str(row.get("unit", "")),
                    (low, high),
                )
            )
    return out


def _gap(row: object, scale: Scale = SI) -> str | Html:
    if not isinstance(row, dict) or row.get("rms") is None:
        return ""
    text = f"{row['rms'] * scale.factor:.4g} {scale.unit}".strip()
    if row.get("nrmse") is not None:
        text = f"{text} ({row['nrmse']:.1%})"
    word = str(row.get("grade") or effort_grade(row))
    return Html(f"{text} {chip(printed(word), KINDS.get(word, '')).text}") if word else text


def effort_grade(row: Mapping[str, Any]) -> str:
    """Return the grade of a twin's error on a log, held against what it left of its own; "" where not known."""
    return grade(float(row["rms"]), float(row["misfit"]), None) if row.get("misfit") else ""


def _tiles(found: Comparison) -> Html:
    out = [
        Tile(
            effect_title(key),
            key.split(".")[0] if "." in key else "machine",
            f"{count} parameter{'s' if count > 1 else ''} moved",
        )
        for key, _, count in found.causes[:4]
    ]
    return tiles(out or [Tile("Parameters", "none moved", "differences are within what chance explains")])


def _moved(found: Comparison, series: bool) -> list[Block]:
    if not found.moved:
        return ["None."]
    plots = [_plot(found, row) for row in found.moved[:_SHOWN]] if series else [_changes(found)]
    groups: list[Block] = [Group(tuple(plots[k : k + 2])) for k in range(0, len(plots), 2)]
    return [_table(found, found.moved), *groups]


def _plot(found: Comparison, row: Row) -> Plot:
    figure = go.Figure(
        go.Scatter(
            x=list(found.labels),
            y=list(row.values),
            error_y={"type": "data", "array": [Z90 * e for e in row.errors], "thickness": 1.5},
            mode="lines+markers",
            marker={"size": 8, "color": effect_colour(row.effect)},
            line={"width": 1.5, "color": effect_colour(row.effect)},
        )
    )
    figure.update_yaxes(title=row.unit)
    return Plot(style(figure, 240, legend=False), row.name, "bars: 90 % interval")


def _changes(found: Comparison) -> Plot:
    rows = list(found.moved[:20])[::-1]
    z = [row.change / row.change_error for row in rows]
    figure = go.Figure(
        go.Bar(
            x=z,
            y=[row.name for row in rows],
            orientation="h",
            marker={"color": [effect_colour(row.effect) for row in rows]},
        )
    )
    figure.update_xaxes(title="change over its standard error")
    figure.update_yaxes(automargin=True)
    return Plot(style(figure, 80 + 24 * len(rows), legend=False), "How sure each change is")


def _table(found: Comparison, rows: tuple[Row, ...]) -> Html:
    head = ("parameter", "unit", *found.labels, "change", "90 % interval", "moved")
    body = []
    for row in rows:
        cells = [_value(x, e) for x, e in zip(row.values, row.errors, strict=True)]
        half = Z90 * row.change_error
        known = np.isfinite(row.change)
        change = f"{row.change:.4g}{_share(row)}" if known else ""
        interval = f"{row.change - half:.4g} to {row.change + half:.4g}" if known else ""
        body.append((row.name, row.unit, *cells, change, interval, "moved" if row.moved else ""))
    return table(head, body, numeric=range(2, 4 + len(found.labels)))


def _folded(found: Comparison, rows: tuple[Row, ...]) -> list[Block]:
    if not rows:
        return []
    title = f"{len(rows)} knots of tables, and what one twin alone determines"
    return [Html(f'<details class="big"><summary>{title}</summary>{_table(found, rows).text}</details>')]


def _value(x: float, error: float) -> str:
    return " ± ".join(with_error(x, Z90 * error)) if np.isfinite(x) else "not determined"


def _share(row: Row) -> str:
    first = row.values[0]
    return f" ({row.change / abs(first):+.0%})" if first and abs(row.change) < 100.0 * abs(first) else ""


def _shifts(found: Comparison) -> list[Block]:
    if not found.shifts:
        return []
    rows = [
        (key, effect_title(key.split(" on ")[0]), axis, f"{rms:.4g}", unit)
        for key, (axis, rms, unit) in found.shifts.items()
    ]
    return [table(("effect", "what", "axis", "change of effort, RMS", "unit"), rows[:20], numeric=(3,))]


def _errors(found: Comparison) -> list[Block]:
    units = {axis: unit for axis, _, unit in found.shifts.values()}
    rows = []
    for axis, signals in found.errors.items():
        for signal, held in signals.items():
            size = max(row["rms"] for row in held.values())
            scale = signal_scale(signal[-1] if " " in signal else "u", units.get(axis) == "N·m", size)
            rows.append(
                (axis, WORDS.get(signal, signal), *(_gap(held.get(label), scale) for label in found.labels))
            )
    head = ("axis", "signal", *(f"{label}: RMS (of the signal)" for label in found.labels))
    return [table(head, rows, numeric=range(2, len(head)))] if rows else []


def _notes(found: Comparison) -> list[Block]:
    lines = [*found.notes]
    for label, names in found.only.items():
        few = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
        lines.append(f"only in {label}: {few}")
    return [notes(lines)] if lines else []
