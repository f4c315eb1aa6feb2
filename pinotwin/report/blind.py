"""The report of the withheld bench: the table, what is confused with what, calibration; bad figures are marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from scipy.stats import binomtest

from pinotwin.report.blocks import Page, Tile, tiles
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, line, look, points, style
from pinotwin.system.phrases import BLIND

STATES = {"aim": ("aim", "good"), "must": ("must", "fair"), "below": ("missed", "bad")}
"""State of a row -> words and kind of its chip."""
FIRST = (  # Scores in large print
    "healthy machine accused of anything",
    "top-1 effect and axis, rho ≥ 0.1",
    "both of two, weaker rho ≥ 0.1",
    "outside the catalogue recognised",
    "expected calibration error",
)


def bench_page(d: Mapping[str, Any]) -> Page:
    """Return the page of a scored bench, of what ``bench.json`` holds."""
    kinds = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in d["cases"].items())
    found = d["calibration"]
    rows = {r["name"]: r for r in d["scores"]}
    large = []
    for row in (rows[name] for name in FIRST if rows[name]["value"] is not None):
        below = f"{row['counts']}; must {row['must']}"
        large.append(Tile(row["name"], row["figure"], below, *STATES.get(row["state"], ("", ""))))
    given = {
        "headline": _headline(d),
        "tiles_": tiles(large),
        "scores": [r for r in d["scores"] if r["value"] is not None],
        "states": STATES,
        "confusion": matrix_figure(d["confusion"]) if d["confusion"] else None,
        "calibration": found,
        "reliability": calibration_figure(found["bins"]) if found else None,
        "rho": rho_figure(d["answers"]) if any(map(_single, d["answers"])) else None,
        "errors": [f"case {x['case']}: {x['error']}" for x in d["errors"]],
    }
    said = f"{len(d['answers'])} of {d['planned']} cases: {kinds} · {', '.join(d['machines'])}"
    return Page("The withheld bench", said, template="blind", given=given)


def _headline(d: Mapping[str, Any]) -> str:
    held = [r for r in d["scores"] if r["must"] and r["value"] is not None]
    below = [r["name"].removeprefix("… ") for r in held if r["state"] == "below"]
    if not held:
        return BLIND["few"]
    if not below:
        return BLIND["all"].format(count=len(held))
    reached = len(held) - len(below)
    return BLIND["missed"].format(reached=reached, count=len(held), names="; ".join(below))


LAST = ("none", "unexplained", "partly_explained", "explained", "unknown", "error")
"""Answers that name no effect: to the right of the matrix."""


def matrix_figure(matrix: Mapping[str, Mapping[str, float]]) -> go.Figure:
    """Return true effect against answer; colour is the share of the row."""
    rows = list(matrix)
    names = {k for row in matrix.values() for k in row}
    columns = [r for r in rows if r in names]
    columns += sorted(names - set(columns) - set(LAST)) + [k for k in LAST if k in names]
    z = np.array([[matrix[r].get(c, 0.0) for c in columns] for r in rows], dtype=float)
    share, (i, j) = z / np.maximum(z.sum(axis=1, keepdims=True), 1e-12), np.nonzero(z)
    marks = go.Scatter(x=[columns[k] for k in j], y=[rows[k] for k in i], text=z[i, j], **look()["matrix"])
    figure = go.Figure(marks.update(marker_color=share[i, j]))  # squares: no heat map is in the small plotly
    style(figure, 130 + 24 * len(rows), legend=False)
    figure.update_xaxes(side="top", showgrid=False, categoryarray=columns, tickangle=-50, type="category")
    figure.update_yaxes(
        autorange="reversed", showgrid=False, zeroline=False, type="category", categoryarray=rows
    )
    return figure


def calibration_figure(bins: Sequence[Sequence[float]]) -> go.Figure:
    """Return the reliability diagram: stated probability against share right, with Wilson's 90 % intervals."""
    stated, right, _ = np.array(bins, dtype=float).T
    ends = [binomtest(round(r * n), int(n)).proportion_ci(0.9, "wilson") for _, r, n in bins]
    low, high = (np.array([getattr(x, end) for x in ends]) for end in ("low", "high"))
    even = line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "perfectly calibrated", MEASURED, width=1.2)
    figure = go.Figure(even.update(line_dash="dot", hoverinfo="skip"))
    marks = points(stated, right, "answers, in bins of equal number", ACCENT, (high - right, right - low))
    hover = "stated %{x:.2f}, right %{y:.2f}<extra></extra>"
    figure.add_trace(marks.update(mode="lines+markers", line_width=1.4, hovertemplate=hover))
    style(figure, 380, x="stated probability", y="share right")
    figure.update_xaxes(range=[0.0, 1.02])
    return figure.update_yaxes(range=[0.0, 1.05])


def rho_figure(answers: Sequence[Mapping[str, Any]]) -> go.Figure:
    """Return every single case: rho against effect, right or wrong."""
    single = [*filter(_single, answers)]
    names = sorted({a["truth"][0][0] for a in single})
    figure = go.Figure()
    kinds = (("named right", ACCENT, True), ("not", RESIDUAL, False))
    for words, colour, wanted in kinds:
        some = [a for a in single if bool(a["is_right"]) == wanted]
        sizes, effects = [max(a["sizes"][0], 1e-4) for a in some], [a["truth"][0][0] for a in some]
        named = [", ".join(f"{n[0]} on {n[1]}" for n in a["named"]) or a["verdict"] for a in some]
        text = [f"{a['machine']}, {a['situation']}: {said}" for a, said in zip(some, named, strict=True)]
        marks = points(sizes, effects, words, colour).update(text=text)
        hover = "%{text}, rho %{x:.2g}<extra></extra>"
        marks.update(marker_size=9, marker_symbol="circle" if wanted else "x", hovertemplate=hover)
        figure.add_trace(marks)
    style(figure, 120 + 22 * len(names))
    figure.update_xaxes(type="log", title_text="rho: power of the residual over that of the noise")
    figure.add_vline(x=0.1, line={"color": MEASURED, "width": 1, "dash": "dot"})
    return figure.update_yaxes(categoryorder="array", categoryarray=names[::-1], type="category")


def _single(a: Mapping[str, Any]) -> bool:
    return a["kind"] == "single" and bool(a["sizes"])
