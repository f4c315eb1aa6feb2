"""The closed loop in a report: prediction from the command alone, poles, gains, causes of the error.

Of a flexible machine also its vibration from the command alone, spring and poles (thesis 7.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import plotly.graph_objects as go

from pinotwin.analysis.decomposition import Decomposition, decompose
from pinotwin.analysis.modal import modes
from pinotwin.columns import bind
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.loop.servo import LOST, SHAPES, Servo
from pinotwin.machine import Machine
from pinotwin.report import closed_loop_plots as plots
from pinotwin.report import display
from pinotwin.report.blocks import Block, Html, Plot, Tabs, chip, table
from pinotwin.report.display import DEGREES, SI, Scale, percent, scale_of
from pinotwin.report.figures import ACCENT, MEASURED, SOFT, Line, Panel, over_time
from pinotwin.simulation import wide_loops
from pinotwin.simulation.score import compare, measured
from pinotwin.twin import Twin
from pinotwin.units import rounded

Scores = Mapping[str, Mapping[str, Mapping[str, float]]]
"""Axis -> signal -> errors, as :func:`pinotwin.simulation.score.compare` returns them."""
Column = Callable[[str, str, Mapping[str, float]], object]
"""A cell of a score table, of axis, signal and their errors."""


def closed_loop_content(twin: Twin, log: Log) -> dict[str, Any]:
    """Return what templates/closed_loop.html shows of the loops along a command, and flexible.html of joints."""
    if not twin.loops:
        return {"closed": {}, "bent": {}}
    machine, axes = twin.machine, [name for name in twin.machine.axes if name in twin.loops]
    closed: dict[str, Any] = {"poles": {axis: loop.pole_table() for axis, loop in twin.loops.items()}}
    closed["gains"] = servo_table(twin) if twin.servos else ""
    try:
        predicted, parts, log = twin.simulate(log), decompose(twin, log), bind(log, machine.columns)
    except PinotwinError as error:
        return {"closed": {**closed, "error": error}, "bent": {}}
    closed |= {
        "source": display.elided(log.source),
        "response": plots.response_figure(machine, log, predicted, axes),
        "errors": score_table(twin, log, predicted) if any(measured(machine, log, x) for x in axes) else "",
        "notes": dict.fromkeys(predicted.notes),
        "shares": plots.cause_shares_figure(parts),
        "causes": cause_tabs(twin, parts),
    }
    return {"closed": closed, "bent": flexible_content(twin, log, predicted)}


def scores_table(
    machine: Machine, scores: Scores, columns: Mapping[str, Column], last: Sequence[Sequence[object]] = ()
) -> Html:
    """Return a row for each signal of each axis, RMS error and ``columns`` (header -> cell), and ``last`` below."""
    rows: list[Sequence[object]] = []
    for axis, signals in scores.items():
        for signal, row in signals.items():
            rms = scale_of(signal, machine.axes[axis].rotary, row["rms"]).text(row["rms"])
            cells = (cell(axis, signal, row) for cell in columns.values())
            rows.append([axis, display.SIGNALS[signal], rms, *cells])
    header = ("axis", "signal", "RMS error", *columns)
    numeric = [k for k, name in enumerate(header) if k > 1 and name != "grade"]
    return table(header, [*rows, *last], numeric)


def score_table(twin: Twin, log: Log, predicted: Log) -> Html:
    """Return the normalised RMS errors of the prediction, and their mean."""
    scores = compare(twin.machine, log, predicted)
    scores = {axis: row for axis, row in scores.items() if axis in twin.loops}
    each = [row["nrmse"] for signals in scores.values() for row in signals.values()]
    mean = [["mean", "", "", display.percent(math.fsum(each) / len(each)), "", ""]] if len(each) > 1 else []
    columns: dict[str, Column] = {
        "of RMS": lambda axis, signal, row: display.percent(row["nrmse"]),
        "of standard deviation": lambda axis, signal, row: display.percent(row["nrmse_std"]),
        # with the disturbance taken from the measured motion
        "loop alone, held out": lambda axis, s, row: share(held_out_error(twin, axis, s, "loops")),
    }
    return scores_table(twin.machine, scores, columns, mean)


def held_out_error(twin: Twin, axis: str, signal: str, kind: str) -> float | None:
    """Return the held-out error of an axis' loop, of ``loops`` or ``servos``, over its RMS [-]."""
    row: Mapping[str, Any] = (twin.quality.get(kind) or {}).get(axis) or {}
    return (row.get("held_out") or {}).get(signal)


def share(x: float | None) -> str:
    """Return a share [-] in per cent; a dash where it is not known."""
    return "–" if x is None or x != x else percent(x)


def cause_tabs(twin: Twin, parts: Decomposition) -> Tabs:
    """Return the disturbances and what they make of the tracking error over time, axis by axis."""
    load = "What the motor must work against beside the axis' own mean inertia and damping."
    each = "Each part, sent through the identified loop on its own; the parts add up."
    panels: dict[str, list[Block]] = {}
    for axis in parts.axes:
        turns = twin.machine.axes[axis].rotary
        loads, errors = (plots.causes_figure(parts, axis, turns, what) for what in ("disturbance", "error"))
        first = Plot(loads, f"{axis}: disturbance by cause", load)
        panels[axis] = [first, Plot(errors, f"{axis}: tracking error by cause", each)]
    return Tabs(panels)


def servo_table(twin: Twin) -> Html:
    """Return gains and lags of the controllers, 90 % intervals, and sums and products of what is known only so."""
    rows: list[list[object]] = []
    for axis, servo in twin.servos.items():
        told, determined, service = servo.intervals(), servo.determined(), servo.service()
        turns = twin.machine.axes[axis].rotary
        gains = ("ffv",) if servo.form == "pid" else ("kp", "rate")  # what a combination is made of
        known = all(determined.get(name, True) for name in gains)
        both = {} if known else {k: x for k, x in servo.combined().items() if k in told}
        numbers = {name: (x, *told.get(name, (x, x))) for name, x in {**servo.named(), **both}.items()}
        numbers |= {name: service[name] for name in ("Kv", "reset time", LOST) if name in service}
        for k, (name, number) in enumerate(numbers.items()):
            scale = scale_of("e", turns, number[0]) if name == LOST else _UNITS.get(name, SI)
            value, low, high = (scale.factor * x for x in number)
            endless = name == "Kv" and not math.isfinite(value)
            shown = "no following error" if endless else f"{value:.4g} {scale.unit}".strip()
            between = "" if low == high or math.isnan(low) else f"{low:.4g} to {high:.4g}"
            remark = _remark(servo, name, determined)
            rows.append(["" if k else axis, _SERVO.get(name, name), shown, between, remark])
    return table(("axis", "gain", "value", "90 % interval", ""), rows, numeric=(2, 3))


def _remark(servo: Servo, name: str, determined: Mapping[str, bool]) -> Html:
    if determined.get(name, True):
        return chip("determined", "good", "within a tenth of itself") if name in determined else Html("")
    if name in ("kp", "rate") and servo.tied:
        return chip("tied", "fair", f"or {servo.other[name]:.4g}: kp and 1/ti exchanged fit equally well")
    return chip("not determined", "fair", "its interval is wider than a tenth of it on either side")


_UNITS = {"Kv": Scale(1.0, "1/s"), "reset time": Scale(1.0, "s"), **dict.fromkeys(SHAPES, Scale(1e3, "ms"))}
_SERVO = {
    "kp": "position gain kp",
    "kv": "velocity gain kv",
    "rate": "1/ti",
    "ki": "integral gain ki",
    "kd": "derivative gain kd",
    "ffv": "velocity feed-forward",
    "ffa": "acceleration feed-forward",
    "weight": "set-point weight",
    "velocity_lag": "lag of the velocity",
    "output_lag": "lag of the current loop",
    "dead": "dead time",
    "kp + rate": "kp + 1/ti",
    "kp * rate": "kp / ti",
}


def flexible_content(twin: Twin, log: Log, black: Log) -> dict[str, Any]:
    """Return what templates/flexible.html shows of passive joints, measured and simulated; {} without any."""
    found = [name for name in twin.machine.passive if f"{name}.spring" in twin.keys]
    if not found:
        return {}
    joints = {joint: (vibration_figure(twin, log, black, joint), _spring(twin, joint)) for joint in found}
    loops = wide_loops(twin)
    poles = {axis: loop.pole_table() for axis, loop in loops.items()}
    return {"joints": joints, "poles": poles, **(_compared(twin, log, black, list(loops)) if loops else {})}


def vibration_figure(twin: Twin, log: Log, predicted: Log, joint: str) -> go.Figure:
    """Return velocity of a passive joint, tracking errors and posture over one time axis."""
    axes = {name: axis.rotary for name, axis in twin.machine.axes.items() if name in twin.loops}
    v = f"{joint}.v"
    lines = [Line("measured", log[v], MEASURED, 2.4)] if v in log else []
    lines.append(Line("predicted", predicted[v], ACCENT, 1.1))
    panels = [Panel(f"<b>{joint}</b> velocity", lines, replace(DEGREES, unit="°/s"))]
    panels += [plots.response_panel(twin.machine, log, predicted, name, "e", "error") for name in axes]
    tilts = [Line(name, log[f"{name}.qr"], SOFT, 1.2, legend=False) for name, turns in axes.items() if turns]
    panels += [Panel("posture", tilts, DEGREES)] if tilts else []
    return over_time(log.t, panels, 70 + 165 * len(panels), points=2500)


def _spring(twin: Twin, joint: str) -> list[list[object]]:
    """Return stiffness and damping of a passive joint, and the modes that they make: rows of a table."""
    rows: list[list[object]] = []
    for name, word in (("k", "stiffness"), ("c", "damping")):
        p = twin.parameter(f"{joint}.spring.{name}")
        shown, doubt = rounded(p.value, 1.96 * p.error)
        rows.append([word, f"{shown} ± {doubt}", p.unit])
    for k, m in enumerate(modes(twin).modes, 1):
        rows.append([f"mode {k}, motors held", f"{m.frequency:.2f}, ζ {m.damping:.4f}", "Hz"])
    row = twin.quality.get("springs", {}).get(joint)
    if row and row["load"] > 0.0:
        share = percent(row["residual"] / row["load"])
        rows.append(["residual of the joint's equation", share, "of its spring"])
    return rows


def _compared(twin: Twin, log: Log, black: Log, axes: list[str]) -> dict[str, Any]:
    """Return how well the loops that hold the vibration as an output predict, beside the others."""
    try:
        wide = twin.simulate(log, controller="vibration")
    except PinotwinError as error:
        return {"wide_error": str(error)}
    scores = [compare(twin.machine, log, x) for x in (black, wide)]
    rows = [
        [axis, signal, *(percent(s[axis][signal]["nrmse"]) for s in scores)]
        for axis in axes
        for signal in scores[0].get(axis, {})
    ]
    return {"compared": rows}
