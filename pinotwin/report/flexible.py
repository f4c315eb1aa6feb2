"""The flexible machine in a report: vibration from the command alone, spring, poles (thesis 7.3)."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.analysis.modal import modes
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.logs.columns import bind
from pinotwin.report import display
from pinotwin.report.blocks import Block, Html, Plot, heading, paragraph, table
from pinotwin.report.closed_loop_plots import measured_signals, scale_of
from pinotwin.report.figures import ACCENT, MEASURED, SOFT, line, style, visible_rows
from pinotwin.simulation import compare, wide_loops
from pinotwin.twin import Twin

_POINTS = 2500


def flexible_blocks(twin: Twin, log: Log) -> list[Block]:
    """Return the blocks on passive joints of a twin with closed loops; none without such joints.

    Args:
        twin: what was identified.
        log: whose command is simulated; its vibration is drawn beside where it holds one.
    """
    found = [name for name in twin.machine.passive if f"{name}.spring" in twin.keys]
    if not found or not twin.loops:
        return []
    log = bind(log, twin.machine.columns)
    try:
        black = twin.simulate(log)
    except PinotwinError as error:
        return [paragraph(f"The vibration could not be simulated: {error}")]
    out: list[Block] = []
    for joint in found:
        out.append(
            Plot(
                vibration_figure(twin, log, black, joint),
                f"Vibration of {joint}, and what it does to the axes",
                "From the command alone. Where one axis holds its speed and another accelerates, the "
                "ringing in its tracking error came through the structure; it changes with the "
                "posture of the lowest plot.",
            ),
        )
        out += [heading(f"Spring of {joint}"), spring_table(twin, joint)]
    return [*out, *_wide(twin, log, black)]


def vibration_figure(twin: Twin, log: Log, predicted: Log, joint: str) -> go.Figure:
    """Return velocity of a passive joint, tracking errors and posture over one time axis."""
    axes = [name for name in twin.machine.axes if name in twin.loops]
    tilting = [name for name in axes if twin.machine.axes[name].rotary]
    count = 2 + len(axes)
    figure = make_subplots(rows=count, cols=1, shared_xaxes=True, vertical_spacing=0.03)
    rows = visible_rows([predicted[f"{joint}.v"]], _POINTS)
    t = log.t[rows]

    def draw(row: int, y: np.ndarray, name: str, colour: str, width: float) -> None:
        trace = line(t, y[rows], name, colour, width=width, legend=row == 1)
        figure.add_trace(trace, row=row, col=1)

    if f"{joint}.v" in log:
        draw(1, np.degrees(log[f"{joint}.v"]), "measured", MEASURED, 2.4)
    draw(1, np.degrees(predicted[f"{joint}.v"]), "predicted", ACCENT, 1.1)
    figure.update_yaxes(title_text=f"<b>{joint}</b> velocity [deg/s]", row=1, col=1)
    for k, axis in enumerate(axes, 2):
        measured = measured_signals(log, axis).get("e")
        e = predicted[f"{axis}.e"]
        scale = scale_of("e", twin.machine.axes[axis].rotary, e if measured is None else measured)
        if measured is not None:
            draw(k, scale(measured), "measured", MEASURED, 2.4)
        draw(k, scale(e), "predicted", ACCENT, 1.1)
        figure.update_yaxes(title_text=f"<b>{axis}</b> error [{scale.unit}]", row=k, col=1)
    for axis in tilting:
        draw(count, np.degrees(log[f"{axis}.qr"]), axis, SOFT, 1.2)
    figure.update_yaxes(title_text="posture [deg]", row=count, col=1)
    figure.update_xaxes(title_text="time [s]", row=count, col=1)
    return style(figure, 70 + 165 * count)


def spring_table(twin: Twin, joint: str) -> Html:
    """Return stiffness and damping of a passive joint, and the mode that they make."""
    held = modes(twin)
    rows: list[list[object]] = []
    for name, word in (("k", "stiffness"), ("c", "damping")):
        p = twin.parameter(f"{joint}.spring.{name}")
        shown, doubt = display.rounded(p.value, 1.96 * p.error)
        rows.append([word, f"{shown} ± {doubt}", p.unit])
    rows += [
        [f"mode {k + 1}, motors held", f"{m.frequency:.2f}, ζ {m.damping:.4f}", "Hz"]
        for k, m in enumerate(held.modes)
    ]
    row = twin.quality.get("springs", {}).get(joint)
    if row and row["load"] > 0.0:
        share = display.percent(row["residual"] / row["load"])
        rows.append(["left of the joint's equation", share, "of its spring"])
    return table(("", "value, 95 %", "unit"), rows, numeric=(1,))


def _wide(twin: Twin, log: Log, black: Log) -> list[Block]:
    """Return the loops that hold the vibration as an output: poles, and how well they predict."""
    loops = wide_loops(twin)
    if not loops:
        return []
    out: list[Block] = [
        heading("Loops with the vibration as output"),
        paragraph(
            "The axis on a passive joint as one linear system with the link's disturbance as "
            "further input and its velocity as further output (thesis Eq. 5.8). The lightly "
            "damped pair is the structure.",
            "lead",
        ),
    ]
    rows = [
        [
            axis,
            row["name"].replace("wn", "pair ω").replace("zeta", "ζ"),
            f"{row['value']:.4g}",
            "" if row["unit"] == "-" else row["unit"],
        ]
        for axis, loop in loops.items()
        for row in loop.pole_table()
    ]
    out.append(table(("axis", "pole", "value", "unit"), rows, numeric=(2,)))
    try:
        wide = twin.simulate(log, controller="vibration")
    except PinotwinError as error:
        return [*out, paragraph(f"They could not be simulated: {error}")]
    scores = [compare(twin.machine, log, x) for x in (black, wide)]
    cells = [
        [axis, signal, *(display.percent(s[axis][signal]["nrmse"]) for s in scores)]
        for axis in loops
        for signal in scores[0].get(axis, {})
    ]
    header = ("axis", "signal", "spring with its own states", "loop with the vibration")
    return [*out, table(header, cells, numeric=(2, 3))]
