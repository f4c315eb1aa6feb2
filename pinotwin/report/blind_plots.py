"""Plots of the withheld bench: confusion matrix, reliability diagram, right and wrong by size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, style

LAST = ("none", "unexplained", "partly_explained", "explained", "unknown", "error")
"""Answers that name no effect: to the right of the matrix."""


def matrix_figure(matrix: Mapping[str, Mapping[str, float]]) -> go.Figure:
    """Return true effect against answer; colour is the share of the row."""
    rows = list(matrix)
    names = {k for row in matrix.values() for k in row}
    columns = [r for r in rows if r in names]
    columns += sorted(names - set(columns) - set(LAST)) + [k for k in LAST if k in names]
    z = np.array([[matrix[r].get(c, 0.0) for c in columns] for r in rows], dtype=float)
    share = z / np.maximum(z.sum(axis=1, keepdims=True), 1e-12)
    text = [[_cell(v) for v in row] for row in z]
    figure = go.Figure(
        go.Heatmap(
            x=columns,
            y=rows,
            z=np.where(z > 0.0, share, np.nan),
            text=text,
            texttemplate="%{text}",
            textfont={"color": "#1b1f24", "size": 12},
            xgap=2,
            ygap=2,
            zmin=0.0,
            zmax=1.0,
            hoverongaps=False,
            showscale=False,
            colorscale=[[0.0, "#fdf0d5"], [0.5, "#8fc1c5"], [1.0, "#2fa6a0"]],
            hovertemplate="%{y} → %{x}: %{z:.0%}<extra></extra>",
        )
    )
    style(figure, 130 + 24 * len(rows), legend=False)
    figure.update_xaxes(side="top", showgrid=False, tickangle=-50, type="category")
    figure.update_yaxes(autorange="reversed", showgrid=False, zeroline=False, type="category")
    return figure


def _cell(value: float) -> str:
    if value <= 0.0:
        return ""
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.2f}"


def calibration_figure(bins: Sequence[Sequence[float]]) -> go.Figure:
    """Return the reliability diagram: stated probability against share right, with 90 % intervals."""
    stated = np.array([b[0] for b in bins], dtype=float)
    right = np.array([b[1] for b in bins], dtype=float)
    count = np.array([b[2] for b in bins], dtype=float)
    low, high = _interval(right * count, count)
    figure = go.Figure(
        go.Scatter(
            x=[0.0, 1.0],
            y=[0.0, 1.0],
            mode="lines",
            name="perfectly calibrated",
            line={"color": MEASURED, "dash": "dot", "width": 1.2},
            hoverinfo="skip",
        )
    )
    figure.add_trace(
        go.Scatter(
            x=stated,
            y=right,
            mode="lines+markers",
            name="answers, in bins of equal number",
            line={"color": ACCENT, "width": 1.4},
            marker={"size": 8},
            error_y={
                "type": "data",
                "symmetric": False,
                "array": high - right,
                "arrayminus": right - low,
                "thickness": 1.2,
            },
            hovertemplate="stated %{x:.2f}, right %{y:.2f}<extra></extra>",
        )
    )
    style(figure, 380)
    figure.update_xaxes(title_text="stated probability", range=[0.0, 1.02])
    return figure.update_yaxes(title_text="share right", range=[0.0, 1.05])


def _interval(hits: np.ndarray, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Wilson's 90 % interval of shares (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""
    z = 1.645
    p = hits / of
    centre = (p + z * z / (2.0 * of)) / (1.0 + z * z / of)
    half = z * np.sqrt(p * (1.0 - p) / of + z * z / (4.0 * of * of)) / (1.0 + z * z / of)
    return np.minimum(centre - half, p), np.maximum(centre + half, p)


def rho_figure(answers: Sequence[Mapping[str, Any]]) -> go.Figure:
    """Return every single case: rho against effect, right or wrong."""
    single = [a for a in answers if a["kind"] == "single" and a["sizes"]]
    names = sorted({a["truth"][0][0] for a in single})
    figure = go.Figure()
    kinds = (("named right", ACCENT, True), ("not", RESIDUAL, False))
    for words, colour, wanted in kinds:
        some = [a for a in single if bool(a["is_right"]) == wanted]
        figure.add_trace(
            go.Scatter(
                x=[max(a["sizes"][0], 1e-4) for a in some],
                y=[a["truth"][0][0] for a in some],
                mode="markers",
                name=words,
                marker={"color": colour, "size": 9, "symbol": "circle" if wanted else "x"},
                text=[_said(a) for a in some],
                hovertemplate="%{text}, rho %{x:.2g}<extra></extra>",
            )
        )
    style(figure, 120 + 22 * len(names))
    figure.update_xaxes(type="log", title_text="rho: power of the residual over that of the noise")
    figure.add_vline(x=0.1, line={"color": MEASURED, "width": 1, "dash": "dot"})
    return figure.update_yaxes(categoryorder="array", categoryarray=names[::-1], type="category")


def _said(a: Mapping[str, Any]) -> str:
    named = ", ".join(f"{n[0]} on {n[1]}" for n in a["named"]) or a["verdict"]
    return f"{a['machine']}, {a['situation']}: {named}"
