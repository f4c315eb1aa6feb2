"""The page of ``pinotwin compare``: what moved, how each twin predicts the same log, the series over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.analysis.comparison import Z90, Comparison, Row, effect_title, with_interval
from pinotwin.analysis.diagnoses import Diagnoses
from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.sizes import size_text, told
from pinotwin.diagnosis.grade import KIND, grade, printed
from pinotwin.diagnosis.result import Size
from pinotwin.errors import some
from pinotwin.report.blocks import Block, Group, Html, Page, Plot, Tile, chip, macro, table, tiles
from pinotwin.report.display import SI, Scale, scale_of
from pinotwin.report.figures import ACCENT, effect_colour, points, style
from pinotwin.system.phrases import SIGNALS
from pinotwin.version import __version__

KINDS: dict[str, str] = {str(word): kind for word, kind in KIND.items()}  # Grade -> colour of its chip
WORDS = {"simulated e": "tracking error, simulated", "simulated u": "effort, simulated"}


def comparison_report(found: Comparison) -> str:
    """Return the page of twins side by side as one HTML text."""
    plain = [row for row in found.rows if np.isfinite(row.p)]
    knots = [row for row in found.rows if not np.isfinite(row.p)]
    given = {
        "found": found,
        "tiles_": _tiles(found),
        "moved": _table(found, found.moved) if found.moved else "",
        "controller": _table(found, found.controller) if found.controller else "",
        "plots": _moved(found),
        "effect_title": effect_title,
        "errors": _errors(found),
        "parameters": _table(found, plain),
        "knots": _table(found, knots) if knots else "",
        "knot_count": len(knots),
        "said": _notes(found),
        "twins": macro("logs", found.data),
        "version": __version__,
    }
    title = f"{found.machine}: {' · '.join(found.labels)}"
    return Page("What moved", title, template="comparison", given=given).html()


def diagnoses_report(found: Diagnoses) -> str:
    """Return the page of diagnoses side by side as one HTML text."""
    verdicts = [
        Tile(label, str(d.get("verdict", "")).replace("_", " "), str(d.get("sentence", "")))
        for label, d in zip(found.labels, found.documents, strict=True)
    ]
    causes = [
        (effect_title(effect), axis, *(_cause(held.get(label)) for label in found.labels))
        for (effect, axis), held in found.causes.items()
    ]
    gaps = [
        (axis, SIGNALS.get(signal, signal), *(_gap(held.get(label)) for label in found.labels))
        for axis, signals in found.gap.items()
        for signal, held in signals.items()
    ]
    given = {
        "found": found,
        "tiles_": tiles(verdicts),
        "causes": table(("effect", "axis", *found.labels), causes) if causes else "",
        "series": in_pairs(_gap_series(found)) if len(found.labels) > 2 else [],
        "gaps": table(("axis", "signal", *found.labels), gaps),
    }
    return Page("Diagnoses side by side", " · ".join(found.labels), template="diagnoses", given=given).html()


def in_pairs(plots: Sequence[Plot]) -> list[Block]:
    """Return plots side by side, two in a row."""
    return [Group(tuple(plots[k : k + 2])) for k in range(0, len(plots), 2)]


def over_labels(
    labels: Sequence[str], y: Sequence[float | None], colour: str, ends: tuple[Floats, Floats] | None = None
) -> go.Figure:
    """Return values from one twin, diagnosis or log to the next, as a line through marks with bars (n,) up and down."""
    marks = points(list(labels), list(y), "", colour, ends)
    return style(go.Figure(marks.update(mode="lines+markers", line_width=1.5)), 240, legend=False)


def _gap_series(found: Diagnoses) -> list[Plot]:
    """Return the gap of every axis' effort from diagnosis to diagnosis, each point with its grade."""
    plots = []
    for axis, signals in found.gap.items():
        held = signals.get("u", {})
        rows = [held.get(label, {}) for label in found.labels] if held else []
        shares = [100.0 * row["nrmse"] if row.get("nrmse") is not None else None for row in rows]
        if rows:
            words = [printed(str(row.get("grade", ""))) for row in rows]
            figure = over_labels(found.labels, shares, ACCENT)
            looks = {"mode": "lines+markers+text", "textposition": "top center", "cliponaxis": False}
            figure.update_traces(text=words, **looks)
            figure.update_yaxes(title_text="residual of the effort [%]", rangemode="tozero")
            plots.append(Plot(figure, f"Axis {axis}", "RMS over the RMS of the effort"))
    return plots


def _cause(effect: object) -> str:
    if not isinstance(effect, dict):
        return "not named"
    sizes = "; ".join(size_text(size) for size in told(sizes_of(effect.get("sizes", effect.get("size"))))[:2])
    sure = f"{float(effect.get('confidence') or 0.0):.0%}"
    return f"{sizes} ({sure})" if sizes else sure


def sizes_of(rows: object) -> list[Size]:
    """Return the sizes of an effect of diagnosis.json; none of one that is not as it should be."""
    out = []
    for row in rows if isinstance(rows, list) else ():
        if isinstance(row, dict) and row.get("after") is not None:
            before = math.nan if row.get("before") is None else float(row["before"])
            low, high = (math.nan if x is None else float(x) for x in row.get("interval90") or (None, None))
            name, unit = str(row.get("name", "")), str(row.get("unit", ""))
            out.append(Size(name, before, float(row["after"]), unit, (low, high)))
    return out


def _gap(row: object, scale: Scale = SI) -> str | Html:
    if not isinstance(row, dict) or row.get("rms") is None:
        return ""
    text = f"{row['rms'] * scale.factor:.4g} {scale.unit}".strip()
    if row.get("nrmse") is not None:
        text = f"{text} ({row['nrmse']:.1%})"
    word = str(row.get("grade") or effort_grade(row))
    return macro("beside", text, chip(printed(word), KINDS.get(word, ""))) if word else text


def effort_grade(row: Mapping[str, Any]) -> str:
    """Return the grade of a twin's error on a log, held against what it left of its own; "" where not known."""
    return grade(float(row["rms"]), float(row["misfit"]), None) if row.get("misfit") else ""


def _tiles(found: Comparison) -> Html:
    """Return the change of each effect's most significant parameter in large print."""
    out = []
    for key, title, count in found.causes[:4]:
        row, (axis, dot, _) = next(row for row in found.moved if row.effect == key), key.partition(".")
        change = _share(row).strip(" ()") or f"{row.change:+.3g} {row.unit}"
        more = f" and {count - 1} more" if count > 1 else ""
        out.append(Tile(f"{title} on {axis}" if dot else title, change, f"{row.name}{more}"))
    return tiles(out or [Tile("Parameters", "none moved", "differences are within what chance explains")])


def _moved(found: Comparison, most: int = 12) -> list[Block]:
    """Return plots of what moved: of a series each parameter, ``most`` at most, else all changes in one."""
    if len(found.labels) <= 2:
        return in_pairs([_changes(found)]) if found.moved else []
    plots = []
    for row in (*found.moved[:most], *found.retuned):
        error = Z90 * np.array(row.errors)
        figure = over_labels(found.labels, row.values, effect_colour(row.effect), (error, error))
        plots.append(Plot(figure.update_yaxes(title_text=row.unit), row.name, "bars: 90 % interval"))
    return in_pairs(plots)


def _changes(found: Comparison) -> Plot:
    rows = list(found.moved[:20])[::-1]
    z, names = [row.change / row.change_error for row in rows], [row.name for row in rows]
    colours = [effect_colour(row.effect) for row in rows]
    figure = go.Figure(go.Bar(x=z, y=names, orientation="h", marker={"color": colours}))
    figure.update_xaxes(title_text="change over its standard error")
    return Plot(style(figure, 80 + 24 * len(rows), legend=False), "How sure each change is")


def _table(found: Comparison, rows: Sequence[Row]) -> Html:
    head = ("parameter", "unit", *found.labels, "change", "90 % interval", "moved")
    body = []
    for row in rows:
        cells = [_value(x, e) for x, e in zip(row.values, row.errors, strict=True)]
        half, known = Z90 * row.change_error, np.isfinite(row.change + row.change_error)
        change = f"{row.change:z.4g}{_share(row)}" if known else ""
        interval = f"{row.change - half:z.4g} to {row.change + half:z.4g}" if known else ""
        body.append((row.name, row.unit, *cells, change, interval, "moved" if row.moved else ""))
    return table(head, body, numeric=range(2, 4 + len(found.labels)))


def _value(x: float, error: float) -> str:
    if np.isinf(x):
        return "no following error"
    return with_interval(x, error) if np.isfinite(x) else "not determined"


def _share(row: Row) -> str:
    first = row.values[0]
    if not first or abs(row.change) >= 100.0 * abs(first):
        return ""
    return f" ({row.change / abs(first):+z.0%})".replace("+0%", "0%")


def _errors(found: Comparison) -> Html | str:
    units = {axis: unit for axis, _, unit in found.shifts.values()}
    rows = []
    for axis, signals in found.errors.items():
        for signal, held in signals.items():
            size = max(row["rms"] for row in held.values())
            scale = scale_of(signal[-1] if " " in signal else "u", units.get(axis) == "N·m", size)
            cells = [_gap(held.get(label), scale) for label in found.labels]
            rows.append((axis, WORDS.get(signal, signal), *cells))
    head = ("axis", "signal", *(f"{label}: RMS (of the signal)" for label in found.labels))
    return table(head, rows, numeric=range(2, len(head))) if rows else ""


def _notes(found: Comparison) -> list[str]:
    return [*found.notes, *(f"only in {label}: {some(names, 6)}" for label, names in found.only.items())]
