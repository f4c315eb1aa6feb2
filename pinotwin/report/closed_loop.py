"""The closed loop in a report: prediction from the command alone, poles, gains, causes of the error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.analysis.decomposition import Decomposition, decompose
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.logs.columns import bind
from pinotwin.report import display
from pinotwin.report.blocks import (
    Block,
    Html,
    Plot,
    Tabs,
    bullets,
    chip,
    heading,
    paragraph,
    table,
)
from pinotwin.report.closed_loop_plots import (
    cause_shares_figure,
    causes_figure,
    measured_signals,
    response_figure,
    scale_of,
)
from pinotwin.report.controllers import servo_table
from pinotwin.simulation.score import compare
from pinotwin.twin import Twin

Scores = Mapping[str, Mapping[str, Mapping[str, float]]]


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a twin foretells of a command, beside what was measured.

    Attributes:
        log: what was measured, in the names of the contract.
        black: simulated with the identified transfer functions.
        parts: disturbances and tracking errors by cause.
        notes: of the simulations.
    """

    log: Log
    black: Log
    parts: Decomposition
    notes: tuple[str, ...]


def predict(twin: Twin, log: Log) -> Predicted:
    """Simulate a log's command, and tell the causes of the error apart.

    Raises:
        PinotwinError: the command is missing, or the simulated machine leaves it.
    """
    black = twin.simulate(log)
    return Predicted(bind(log, twin.machine.columns), black, decompose(twin, log), black.notes)


def closed_loop_blocks(twin: Twin, log: Log) -> list[Block]:
    """Return the blocks of the section on the closed loop; none when the twin has no loop.

    Args:
        twin: what was identified.
        log: whose command is simulated and whose measurement is drawn beside.
    """
    if not twin.loops:
        return []
    try:
        found = predict(twin, log)
    except PinotwinError as error:
        said: list[Block] = [paragraph(f"The command could not be simulated: {error}")]
        return [*said, *structure_blocks(twin)]
    return [*response_blocks(twin, found), *structure_blocks(twin), *cause_blocks(twin, found)]


def response_blocks(twin: Twin, found: Predicted) -> list[Block]:
    """Return the response beside the measurement, and its errors."""
    rotary = _rotary(twin)
    figure = response_figure(rotary, found.log, found.black)
    out: list[Block] = [
        Plot(
            figure,
            f"Predicted from the command of {display.elided(found.log.source)}",
            "Nothing measured enters the prediction. Drag to zoom: all follow.",
        ),
    ]
    if any(measured_signals(found.log, axis) for axis in rotary):
        out += [heading("Error of the prediction"), score_table(twin, found)]
    if found.notes:
        out.append(bullets(dict.fromkeys(found.notes)))
    return out


def score_table(twin: Twin, found: Predicted) -> Html:
    """Return the normalised RMS errors of the prediction, and their mean."""
    black = compare(twin.machine, found.log, found.black)
    rows: list[list[object]] = []
    each = []
    for axis, turns in _rotary(twin).items():
        for signal, score in black.get(axis, {}).items():
            scale = scale_of(signal, turns, np.array([score["rms"]]))
            each.append(score["nrmse"])
            rows.append(
                [
                    axis,
                    "tracking error" if signal == "e" else "effort",
                    display.number(score["rms"] * scale.factor, scale.unit),
                    display.percent(score["nrmse"]),
                    display.percent(score["nrmse_std"]),
                    _held_out(twin.quality, axis, signal),
                ]
            )
    if len(rows) > 1:
        rows.append(["mean", "", "", display.percent(math.fsum(each) / len(each)), "", ""])
    header = (
        "axis",
        "signal",
        "RMS error",
        "of RMS",
        "of standard deviation",
        "loop alone, held out",
    )
    return table(header, rows, numeric=range(2, 6))


def _held_out(quality: Mapping[str, Any], axis: str, signal: str) -> str:
    """Return the loop's own held-out error, with the disturbance taken from the measured motion."""
    loops = quality.get("loops") or {}
    value = ((loops.get(axis) or {}).get("held_out") or {}).get(signal)
    return "–" if value is None else display.percent(float(value))


def structure_blocks(twin: Twin) -> list[Block]:
    """Return poles and gains of every axis."""
    out: list[Block] = [
        heading("Poles"),
        paragraph(
            "Poles of the closed loop of each axis, with the bounds within which they were "
            "searched. ζ is the damping ratio.",
            "lead",
        ),
        pole_table(twin),
    ]
    if twin.servos:
        out += [
            heading("Controller"),
            paragraph(
                "The law that is simulated around the axis; effort in N or N·m. Determined: the 90 % interval "
                "reaches no further than a tenth of the gain. Tied: position gain and 1/ti cannot be "
                "separated; only their sum and product, shown below, are identified.",
                "lead",
            ),
            servo_table(twin.servos),
        ]
    return out


def pole_table(twin: Twin) -> Html:
    """Return the poles of all axes (thesis Tables 4-4 and 7-3)."""
    rows = []
    for axis, loop in twin.loops.items():
        loop_rows = loop.pole_table()
        for row in loop_rows:
            unit = "" if row["unit"] == "-" else row["unit"]
            bounds = "" if "lower" not in row else f"{row['lower']:.3g} to {row['upper']:.3g}"
            pair = row.get("interval")
            interval = "" if pair is None else f"{pair[0]:.4g} to {pair[1]:.4g}"
            first = row is loop_rows[0]
            rows.append(
                [
                    axis if first else "",
                    _pole_name(row["name"]),
                    f"{row['value']:.4g}",
                    unit,
                    bounds,
                    interval,
                    _pole_chip(row),
                ]
            )
    header = ("axis", "pole", "value", "unit", "searched", "95 % interval", "")
    return table(header, rows, numeric=(2, 4, 5))


def _pole_name(name: str) -> str:
    for start, words in (
        ("zeta", "damping ratio ζ"),
        ("wn", "pole pair ω"),
        ("pff", "feed-forward pole "),
    ):
        if name.startswith(start):
            return f"{words}{name.removeprefix(start)}"
    return f"real pole {name}"


def _pole_chip(row: Mapping[str, Any]) -> Html:
    if row["preassigned"]:
        return chip("given", "", "fixed before the search")
    if row.get("at_bound"):
        return chip(f"at its {row['at_bound']} bound", "fair", "no interval can be given there")
    return Html("")


def cause_blocks(twin: Twin, found: Predicted) -> list[Block]:
    """Return which cause makes how much of the tracking error, and the disturbances over time."""
    panels: dict[str, list[Block]] = {}
    for axis in found.parts.axes:
        turns = twin.machine.axes[axis].rotary
        panels[axis] = [
            Plot(
                causes_figure(found.parts, axis, turns, "disturbance"),
                f"{axis}: disturbance by cause",
                "What the motor must work against beside the axis' own mean inertia and damping.",
            ),
            Plot(
                causes_figure(found.parts, axis, turns, "error"),
                f"{axis}: tracking error by cause",
                "Each part, sent through the identified loop on its own; the parts add up.",
            ),
        ]
    return [
        heading("Causes of the tracking error"),
        Plot(cause_shares_figure(found.parts)),
        Tabs(panels),
    ]


def _rotary(twin: Twin) -> dict[str, bool]:
    return {name: axis.rotary for name, axis in twin.machine.axes.items() if name in twin.loops}
