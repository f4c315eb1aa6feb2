"""The report of a simulation: what the twin foretells of a command, beside what was measured.

Where the log holds measurements, each error is held against what the identified closed loop left of rows
that were held out when the twin was identified. No cause is looked for here; that is ``pinotwin diagnose``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.phrases import joined
from pinotwin.diagnosis.rules import RULES
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.blocks import Block, Html, Plot, bullets, chip, notes, paragraph, table
from pinotwin.report.closed_loop_plots import measured_signals, response_figure, scale_of
from pinotwin.report.page import Page, files_block, provenance_blocks
from pinotwin.simulation.score import bound, compare
from pinotwin.twin import Twin

SIGNALS = {"e": "tracking error", "u": "effort"}

GRADES = {
    "within misfit": ("good", "no larger than the simulation error on held-out data of the twin"),
    "above misfit": ("fair", "above that error, as on a motion unlike those of the twin's data"),
    "far above misfit": (
        "bad",
        "the machine has changed, or the motion is outside the twin's data",
    ),
    "not judged": ("", "nothing was measured, or there is no validation error to compare with"),
}
"""Grade of a simulated signal -> colour of its chip, and what it says."""

FORMS = {
    "coupled": "identified controllers around the identified plant",
    "black": "identified transfer functions",
    "vibration": "transfer functions with the vibration of the passive joint",
}


def simulation_report(
    twin: Twin,
    log: Log,
    predicted: Log,
    form: str,
    files: Sequence[tuple[str, str]] = (),
    made: Mapping[str, Any] | None = None,
) -> str:
    """Return a self-contained HTML page about a simulated command.

    Args:
        twin: what was simulated.
        log: the command, with what was measured if anything was.
        predicted: what :func:`pinotwin.simulate` returned for it.
        form: closed loop that was used, see there.
        files: name and content of what lies beside the page, to link to.
        made: ``date``, ``seconds_taken`` and further ``options``, where they are known.
    """
    return simulation_page(twin, log, predicted, form, files, made or {}).html()


def simulation_page(
    twin: Twin,
    log: Log,
    predicted: Log,
    form: str,
    files: Sequence[tuple[str, str]],
    made: Mapping[str, Any],
) -> Page:
    """Return the same report as a :class:`Page`."""
    log = bound(twin.machine, log)
    scores = compare(twin.machine, log, predicted)
    page = Page(
        f"{twin.machine.name}: simulation",
        f"from the command of {display.elided(log.source)} alone · {FORMS.get(form, form)}",
    )
    page = page.section("Answer", *_answer(twin, predicted, scores, form))
    page = page.section("Over time", *_over_time(twin, log, predicted))
    page = page.section("Closed loop", _loop_table(twin, form), intro="What is simulated around each axis.")
    page = page.section("Files", *files_block(files))
    return page.section("How this was made", *provenance_blocks(_provenance(twin, log, form, made)))


def grade_of(error: float, expected: float | None) -> str:
    """Return the grade of a simulated signal.

    Args:
        error: of the prediction over the measured RMS.
        expected: the same on held-out rows of the twin's own logs; None where it is not known.
    """
    if expected is None or not math.isfinite(error) or not expected > 0.0:
        return "not judged"
    if error <= RULES.odd * expected:
        return "within misfit"
    return "above misfit" if error <= RULES.open_change * expected else "far above misfit"


def expected_error(twin: Twin, axis: str, signal: str, form: str) -> float | None:
    """Return what a simulation left of held-out rows of the twin's own logs, over their RMS; None: not known.

    The larger of what the whole simulation left, the mean over axes and signals, and of what the closed loop of
    this axis left by itself.
    """
    kind = "servos" if form == "coupled" else "loops"
    row: Mapping[str, Any] = (twin.quality.get(kind) or {}).get(axis) or {}
    whole: Mapping[str, Any] = (twin.quality.get("simulation") or {}).get("held_out") or {}
    known = [(row.get("held_out") or {}).get(signal), whole.get(form)]
    return max((float(x) for x in known if x is not None), default=None)


def judged_error(row: Mapping[str, float]) -> float:
    """Return the error that is graded: of rows in motion, of all where the command never moves."""
    return row["moving"] if math.isfinite(row["moving"]) else row["nrmse"]


def _answer(twin: Twin, predicted: Log, scores: Mapping[str, Any], form: str) -> list[Block]:
    rotary = dict(zip(twin.machine.names, twin.machine.rotary, strict=True))
    if not scores:
        head = ("axis", "signal", "RMS", "largest")
        rows = [
            [axis, SIGNALS[s], *_sizes(predicted[f"{axis}.{s}"], s, rotary[axis])]
            for axis in twin.machine.axes
            for s in SIGNALS
        ]
        said = "The log holds the command alone, so there is nothing to hold the prediction against."
        return [paragraph(said, "verdict"), table(head, rows, numeric=(2, 3)), *_said(predicted)]
    graded = [
        (axis, s, row, expected_error(twin, axis, s, form))
        for axis, signals in scores.items()
        for s, row in signals.items()
    ]
    words = {(axis, s): grade_of(judged_error(row), known) for axis, s, row, known in graded}
    table_rows = [_row(axis, s, row, known, rotary[axis]) for axis, s, row, known in graded]
    header = (
        "axis",
        "signal",
        "RMS error",
        "of the RMS",
        "moving",
        "at rest",
        "expected",
        "grade",
    )
    legend = [f"{printed(w).capitalize()}: {GRADES[w][1]}." for w in dict.fromkeys(words.values())]
    reading = Html(
        f"<details><summary>how to read this</summary>{bullets([*READING, *legend]).text}</details>"
    )
    out: list[Block] = [paragraph(text, "verdict") for text in _sentences(scores, words)]
    return [*out, table(header, table_rows, numeric=range(2, 7)), reading, *_said(predicted)]


READING = (
    "RMS error: predicted minus measured. Of the RMS: the same over the RMS of what was measured.",
    "Moving, at rest: rows whose command moves or stands, over the RMS of all rows. At rest dry friction holds "
    "any effort up to its level, so the command does not determine the effort there.",
    "Expected: the error on held-out data of the identification, the larger one of the whole simulation and of this "
    "axis' closed loop. The grade compares the error in motion with it.",
)


def _sentences(scores: Mapping[str, Any], words: Mapping[tuple[str, str], str]) -> list[str]:
    out: list[str] = []
    for signal, name in SIGNALS.items():
        each = {axis: row[signal]["nrmse"] for axis, row in scores.items() if signal in row}
        if each:
            sizes = joined([f"{display.percent(x)} on {axis}" for axis, x in each.items()])
            out.append(f"RMS error of the {name}, over its RMS: {sizes}.")
    far = [f"{SIGNALS[s]} of {axis}" for (axis, s), word in words.items() if word == "far above misfit"]
    if far:
        out.append(f"Much larger error than in validation: {joined(far)}. Run pinotwin diagnose.")
    return out


def _row(axis: str, signal: str, row: Mapping[str, float], known: float | None, turns: bool) -> list[object]:
    scale = scale_of(signal, turns, np.array([row["rms"]]))
    word = grade_of(judged_error(row), known)
    shares = [row["nrmse"], row["moving"], row["resting"], math.nan if known is None else known]
    return [
        axis,
        SIGNALS[signal],
        display.number(row["rms"] * scale.factor, scale.unit),
        *("–" if x != x else display.percent(x) for x in shares),
        chip(printed(word), *GRADES[word]),
    ]


def _sizes(x: np.ndarray, signal: str, turns: bool) -> list[str]:
    rms, most = float(np.sqrt(np.mean(x**2))), display.largest(x)
    scale = scale_of(signal, turns, np.array([most]))
    return [display.number(value * scale.factor, scale.unit) for value in (rms, most)]


def _said(predicted: Log) -> list[Block]:
    return [notes(dict.fromkeys(predicted.notes))] if predicted.notes else []


def _over_time(twin: Twin, log: Log, predicted: Log) -> list[Block]:
    rotary = dict(zip(twin.machine.names, twin.machine.rotary, strict=True))
    axes = {axis: rotary[axis] for axis in twin.machine.axes}
    drawn = "Grey: measured. Blue: predicted. " if any(measured_signals(log, axis) for axis in axes) else ""
    note = (
        f"{drawn}Nothing measured enters the prediction. Drag to zoom: all follow; double-click to go back."
    )
    return [Plot(response_figure(axes, log, predicted), "Tracking error and effort", note)]


def _loop_table(twin: Twin, form: str) -> Html:
    rows = []
    for axis in twin.machine.axes:
        servo, loop = twin.servos.get(axis), twin.loops.get(axis)
        if form == "coupled":
            what = (
                "follows its command exactly"
                if servo is None
                else f"controller: {LAWS.get(servo.form, servo.form)}"
            )
            told = "" if servo is None else ", ".join(f"{k} {v:.4g}" for k, v in servo.named().items() if v)
        else:
            what = "follows its command exactly" if loop is None else "transfer functions"
            told = "" if loop is None else "poles as in the report of identify"
        rows.append([axis, what, told])
    return table(("axis", "closed loop", "numbers (SI)"), rows)


LAWS = {
    "cascade": "position P around velocity PI",
    "pid": "position PID",
    "proportional": "cascade without an integral",
    "general": "cascade with a set-point weight",
}
"""Form of a controller -> its name."""


def _provenance(twin: Twin, log: Log, form: str, made: Mapping[str, Any]) -> dict[str, Any]:
    options = {"controller": form, **made.get("options", {})}
    rest = {"twin_from": [dict(row) for row in twin.data], **made, "options": options}
    return made_of(twin.machine, [(log, "command")], **rest)
