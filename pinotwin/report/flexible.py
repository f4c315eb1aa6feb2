"""The flexible machine in a report: vibration from the command alone, spring, poles (thesis 7.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import plotly.graph_objects as go

from pinotwin.analysis.modal import modes
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.report.closed_loop_plots import response_panel
from pinotwin.report.display import DEGREES, percent
from pinotwin.report.figures import ACCENT, MEASURED, SOFT, Line, Panel, over_time
from pinotwin.simulation import compare, wide_loops
from pinotwin.twin import Twin
from pinotwin.units import rounded


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
    panels += [response_panel(twin.machine, log, predicted, name, "e", "error") for name in axes]
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
