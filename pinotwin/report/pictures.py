"""What a result draws of itself: its page's figure, a small still for a notebook (:class:`pinotwin.notebook.Drawn`)."""

from __future__ import annotations

import re
from functools import singledispatch
from pathlib import Path
from typing import Any

import plotly.graph_objects as go

from pinotwin.analysis.comparison import Comparison
from pinotwin.analysis.diagnoses import Diagnoses
from pinotwin.arrays import mapped
from pinotwin.diagnosis.result import Diagnosis
from pinotwin.errors import InputError
from pinotwin.logs.files import LogLike, as_log
from pinotwin.reconstruction import Vibration
from pinotwin.report.closed_loop_plots import response_figure
from pinotwin.report.comparison import comparison_report, diagnoses_report
from pinotwin.report.diagnosis_verdict import rotary_axes
from pinotwin.report.first_screen import gap_figure
from pinotwin.report.identification import effort_figure, identification_report
from pinotwin.report.saved import diagnosis_html, save_diagnosis
from pinotwin.report.simulation import simulation_report
from pinotwin.report.still import still
from pinotwin.report.vibration import vibration_report
from pinotwin.simulation.prediction import Prediction
from pinotwin.studies.evidence import evidence
from pinotwin.system.templates import asset
from pinotwin.system.writing import write_text
from pinotwin.twin import Twin

THEME = dict(re.findall(r"--(\w+):(#\w+)", asset("pinotwin.report", "page.css").partition("}")[0]))
"""Colours of the light style sheet, for figures outside a page."""


def plot(result: Any, *given: Any) -> go.Figure:
    """Return the figure of a result, with colours that need no style sheet."""
    drawn = figure(result, *given)
    for trace in drawn.data:
        looks = {k: trace[k] for k in ("line", "marker") if k in trace}
        trace.update({k: mapped(look.to_plotly_json(), _literal) for k, look in looks.items()})
    return drawn.update_layout(mapped(drawn.layout.to_plotly_json(), _literal))


def _literal(value: Any) -> Any:
    """Return a value of a figure, a text with the colours of the style sheet written out."""
    return re.sub(r"var\(--(\w+)\)", lambda m: THEME[m[1]], value) if isinstance(value, str) else value


def report(result: Any, path: Path, *given: Any) -> Path:
    """Write the page of a result (.html) and return its path."""
    if path.suffix not in (".html", ".htm"):
        raise InputError(f"{path}: a page is written as .html")
    write_text(path, page(result, *given))
    return path


def picture(result: Any) -> str:
    """Return a still of a result's figure as HTML; nothing where it has none."""
    try:
        drawn = plot(result)
    except InputError:
        return ""
    return still(drawn)


save = save_diagnosis


@singledispatch
def figure(result: Any, *given: Any) -> go.Figure:
    """Return the figure of a result as on its page."""
    raise InputError(f"a {type(result).__name__} has no figure; see its page, .report(path)")


@singledispatch
def page(result: Any, *given: Any) -> str:
    """Return the page of a result."""
    raise TypeError(f"no page of a {type(result).__name__}")


@figure.register
def _(twin: Twin, log: LogLike | None = None) -> go.Figure:
    if log is not None:
        return effort_figure(evidence(twin, as_log(log)))
    if twin.misfit is None:
        raise InputError("this twin holds none of its logs: give one, twin.plot(log)")
    return effort_figure(evidence(twin, twin.misfit.motion))


@page.register
def _(twin: Twin, *logs: LogLike) -> str:
    if not logs:
        raise InputError("the page of a twin needs the log: twin.report(path, log)")
    return identification_report(twin, [as_log(log) for log in logs])


@figure.register
def _(found: Diagnosis, axis: str | None = None) -> go.Figure:
    """Return log minus model over time, of an axis or of the one with the first named cause."""
    rotary = rotary_axes(found)
    wanted = [axis] if axis else [*(str(e.axis) for e in found.effects), *rotary]
    shown = {t.axis: t for t in reversed(found.traces) if len(t.t) > 1}
    for name in wanted:
        if name in shown:
            return gap_figure(shown[name], rotary.get(name, False))
    raise InputError(f"nothing to draw of {', '.join(wanted) or 'this diagnosis'}")


figure.register(Prediction, lambda found: response_figure(found.twin.machine, found.command, found))
page.register(Prediction, lambda found: simulation_report(found))
page.register(Diagnosis, lambda found: diagnosis_html(found))
page.register(Comparison, comparison_report)
page.register(Diagnoses, diagnoses_report)
page.register(Vibration, vibration_report)
