"""The report of a simulation: what the twin predicts of a command, beside what was measured.

Errors are held against what the closed loop left of held-out rows; causes are those of ``pinotwin diagnose``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.rules import RULES
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report import display
from pinotwin.report.blocks import Files, Html, Page, chip, table
from pinotwin.report.closed_loop import Column, Scores, held_out_error, scores_table, servo_table, share
from pinotwin.report.closed_loop_plots import response_figure
from pinotwin.report.display import SIGNALS, scale_of
from pinotwin.signals import rms
from pinotwin.simulation.prediction import Prediction
from pinotwin.simulation.score import bound, compare, measured
from pinotwin.system.phrases import LOOPS, SERVOS, SIMULATED, SIMULATED_GRADES, joined
from pinotwin.twin import Twin


def simulation_report(predicted: Prediction, files: Files = (), made: Mapping[str, Any] | None = None) -> str:
    """Return the page of a simulated command and its log, as HTML; ``files``: content by name, ``made``: how."""
    twin, form, known = predicted.twin, predicted.controller, dict(made or {})
    machine = twin.machine
    log = bound(machine, predicted.command)
    scores = compare(machine, log, predicted)
    grades = {
        (axis, s): grade_of(  # of rows in motion, of all where the command never moves
            row["moving"] if math.isfinite(row["moving"]) else row["nrmse"],
            expected_error(twin, axis, s, form),
        )
        for axis, signals in scores.items()
        for s, row in signals.items()
    }
    legend = {printed(word).capitalize(): SIMULATED_GRADES[word][1] for word in grades.values()}
    content = {
        "sentences": _sentences(scores, grades),
        "table_": _score_table(twin, scores, grades, form) if scores else _sizes(machine, predicted),
        "legend": legend,
        "said": list(dict.fromkeys(predicted.notes)),
        "response": response_figure(machine, log, predicted),
        "measured": any(measured(machine, log, axis) for axis in machine.axes),
        "twin": twin,
        "coupled": form == "coupled",
        "laws": SERVOS,
        "gains": servo_table(twin) if form == "coupled" and twin.servos else "",
    }
    options = {"controller": form, **known.get("options", {})}
    facts = {"twin_from": [dict(row) for row in twin.data], **known, "options": options}
    subtitle = f"from the command of {display.elided(log.source)} alone · {LOOPS.get(form, form)}"
    facts = made_of(machine, [(log, "command")], **facts)
    return Page(f"{machine.name}: simulation", subtitle, (), "simulation", content, files, facts).html()


def grade_of(error: float, expected: float | None) -> str:
    """Return the grade of a simulated signal: its error over the measured RMS beside that of held-out rows."""
    if expected is None or not math.isfinite(error) or not expected > 0.0:
        return "not judged"
    if error <= RULES.odd * expected:
        return "within misfit"
    return "above misfit" if error <= RULES.open_change * expected else "far above misfit"


def expected_error(twin: Twin, axis: str, signal: str, form: str) -> float | None:
    """Return the error on held-out rows over their RMS, the larger of the whole simulation's and this loop's."""
    own = held_out_error(twin, axis, signal, "servos" if form == "coupled" else "loops")
    whole: Mapping[str, Any] = (twin.quality.get("simulation") or {}).get("held_out") or {}
    known = [own, whole.get(form)]
    return max((float(x) for x in known if x is not None), default=None)


def _score_table(twin: Twin, scores: Scores, grades: Mapping[tuple[str, str], str], form: str) -> Html:
    columns: dict[str, Column] = {
        "of the RMS": lambda axis, s, row: share(row["nrmse"]),
        "at rest": lambda axis, s, row: share(row["resting"]),
        "moving": lambda axis, s, row: share(row["moving"]),
        "expected": lambda axis, s, row: share(expected_error(twin, axis, s, form)),
        "grade": lambda axis, s, row: chip(printed(grades[axis, s]), *SIMULATED_GRADES[grades[axis, s]]),
    }
    return scores_table(twin.machine, scores, columns)


def _sentences(scores: Scores, grades: Mapping[tuple[str, str], str]) -> list[str]:
    if not scores:
        return [SIMULATED["alone"]]
    out: list[str] = []
    for signal, name in SIGNALS.items():
        each = {axis: row[signal]["nrmse"] for axis, row in scores.items() if signal in row}
        if each:
            sizes = joined([f"{display.percent(x)} on {axis}" for axis, x in each.items()])
            out.append(SIMULATED["errors"].format(signal=name, sizes=sizes))
    far = [f"{SIGNALS[s]} of {axis}" for (axis, s), word in grades.items() if word == "far above misfit"]
    if far:
        out.append(SIMULATED["far"].format(signals=joined(far)))
    return out


def _sizes(machine: Machine, predicted: Log) -> Html:
    """Return how large each predicted signal is."""
    rows = []
    for axis, of in machine.axes.items():
        for signal, name in SIGNALS.items():
            x = predicted[f"{axis}.{signal}"]
            scale = scale_of(signal, of.rotary, x)
            rows.append([axis, name, scale.text(rms(x)), scale.text(display.largest(x))])
    return table(("axis", "signal", "RMS", "largest"), rows, numeric=(2, 3))
