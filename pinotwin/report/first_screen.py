"""The first screen of a diagnosis: how sure it is, on which data, what to do now, and plots of the difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from scipy.signal import welch

from pinotwin.arrays import Floats
from pinotwin.diagnosis.grade import OPEN
from pinotwin.diagnosis.phrases import label_words, on_axis, rivals
from pinotwin.diagnosis.result import Diagnosis, Gap, Region, Traces
from pinotwin.errors import PinotwinError
from pinotwin.motion import Motion
from pinotwin.report import figures
from pinotwin.report.blocks import Plot
from pinotwin.report.diagnosis_verdict import event, rotary_axes
from pinotwin.report.display import scale_of
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, Line, Panel, line, over_time, style
from pinotwin.system.phrases import OTHERWISE, SCREEN, SIGNALS, joined
from pinotwin.twin import Twin


def how_sure(d: Diagnosis) -> list[str]:
    """Return how sure every cause is and what else it could be; without a cause, residual and expected error."""
    out = [
        SCREEN["sure"].format(sure=x["confidence"], cause=on_axis(x["fault"], x["axis"])) + "."
        for x in d.recording[:3]
    ]
    for e in d.effects[:3]:
        said = SCREEN["sure"].format(sure=e.confidence, cause=on_axis(e.effect, e.axis))
        if alike := d.alike(e):
            said += SCREEN["alike"].format(others=joined([*map(label_words, alike)]))
        told = {*(x.rpartition(".")[2] for x in alike), *OTHERWISE}
        others = rivals(
            replace(e, alternatives=[a for a in e.alternatives if a["effect"] not in told]), d.effects
        )
        rival, (chance, _) = max(others.items(), key=lambda x: x[1][0], default=("", (0.0, "")))
        if chance >= 0.005:  # what rounds to 1 %
            said += SCREEN["rival"].format(rival=rival, chance=chance)
        out.append(f"{said}.")
    return out or _held_against(d)


def _held_against(d: Diagnosis, most: int = 3) -> list[str]:
    """Return residual and expected error of every open signal, else of the one where they are nearest."""
    rows = [(axis, s, g) for axis, row in d.gap.items() for s, g in row.items()]
    still = [row for row in rows if d.grade(row[0], row[1]) in OPEN]
    efforts = [row for row in rows if row[1] == "u"] or rows
    out = []
    for axis, signal, g in still[:most] or sorted(efforts, key=lambda row: _over(row[2]))[-1:]:
        scale = scale_of(signal, rotary_axes(d).get(axis, False), g.rms)
        form = "unjudged" if not g.level else "open" if still else "agrees"
        given = {"axis": axis, "signal": SIGNALS[signal], "rms": scale.text(g.rms)}
        out.append(SCREEN[form].format(**given, expected=scale.text(g.level)))
    return out


def _over(gap: Gap) -> float:
    """Return a residual over what is expected of it, of a machine over its effort."""
    return gap.rms / gap.level if gap.level > 0.0 else gap.nrmse


def which_data(d: Diagnosis) -> str:
    """Return the logs that were diagnosed and what they were compared with."""
    logs, twin = d.provenance.get("logs", ()), d.provenance.get("twin_from", ())
    names = {
        role: _names([row for row in logs if row.get("role") == role]) for role in ("diagnosed", "validation")
    }
    valid = SCREEN["valid"].format(logs=names["validation"]) if names["validation"] else ""
    of = SCREEN["model"]
    if d.situation != "structure":
        of = SCREEN["twin"].format(logs=_names(twin) or "earlier logs")
    return SCREEN["logs"].format(logs=names["diagnosed"] or "the log", valid=valid, reference=of)


def _names(rows: Sequence[dict[str, object]], most: int = 3) -> str:
    names = [Path(str(row.get("source", ""))).name for row in rows]
    more = [f"{len(names) - most} more"] if len(names) > most else []
    return joined([*names[:most], *more]) if names else ""


def what_now(d: Diagnosis, remedies: Sequence[str], advice: Sequence[str]) -> list[str]:
    """Return the first things to do: at the machine, else what to record."""
    if d.verdict == "none":
        return [SCREEN["keep"]]
    return [*remedies[:2], *advice][: max(len(remedies[:2]), 1)] or [SCREEN["again"]]


def picture(d: Diagnosis) -> Plot | None:
    """Return measured, predicted, and predicted with the causes where they differ most; None without the logs."""
    efforts = {axis: row["u"] for axis, row in d.gap.items() if "u" in row}
    named = {e.axis for e in d.effects}
    known = (t for t in reversed(d.traces) if len(t.t) > 1 and t.log < len(d.prepared))
    traces = {t.axis: t for t in known if t.axis in efforts}
    axis = max(traces, key=lambda a: (a in named, d.state(a) == "changed", _over(efforts[a])), default=None)
    motion = None if axis is None else motion_of(d, traces[axis])
    return None if axis is None or motion is None else _picture(d, traces[axis], motion)


def motion_of(d: Diagnosis, given: Traces) -> Motion | None:
    """Return the motion of the log that traces are of; None where the log or the machine is not at hand."""
    try:
        motion = d.prepared[given.log].motion if given.log < len(d.prepared) else None
    except PinotwinError:
        return None
    return motion if motion is not None and given.axis in motion.names else None


def _picture(d: Diagnosis, given: Traces, motion: Motion) -> Plot:
    j, turns = motion.index(given.axis), rotary_axes(d).get(given.axis, False)
    times = [time for e in d.effects if e.axis == given.axis and (time := event(d, e))]
    if times and isinstance(d.subject, Twin):  # the rows of an event are not among those that were judged
        low, high = (float(motion.t[0]) + x for x in times[0].range)
        at = np.flatnonzero((motion.t >= 2.0 * low - high) & (motion.t <= 2.0 * high - low))
        before = motion.u[at, j] - d.subject.effort(motion)[at, j]
        given, rows = Traces(given.axis, given.log, motion.t[at], before, before), slice(None)
    else:
        rows = loudest(given)
    t = given.t[rows]
    at = np.flatnonzero((motion.t >= t[0]) & (motion.t <= t[-1]))
    at = at[:: -(-len(at) // 1500)]
    whole, measured = motion.u[at, j], np.interp(t, motion.t, motion.u[:, j])
    residuals = [Line(name, y[rows], colour) for name, y, colour in shown(given)]
    names = {RESIDUAL: "predicted by the twin" if d.situation == "change" else "predicted by the model"}
    predicted = [
        Line(names.get(x.colour, "predicted with the cause"), measured - x.y, x.colour) for x in residuals
    ]
    lines = [Line("measured", whole, MEASURED, 2.6, t=motion.t[at]), *predicted]
    scale, small = scale_of("u", turns, measured), scale_of("u", turns, residuals[0].y)
    quiet = [Line(x.name, x.y, x.colour, legend=False) for x in residuals]
    panels = [Panel("effort", lines, scale, 1.5), Panel("residual", quiet, small)]
    figure = over_time(t, panels, 330, block=figures.blocks(given.t)[rows])
    log = Path(d.prepared[given.log].log.source).name
    stretch = SCREEN["stretch"].format(start=t[0], end=t[-1], log=log)
    return Plot(figure, SCREEN["picture"].format(axis=given.axis), stretch)


def loudest(given: Traces) -> slice:
    """Return the rows of the stretch, a tenth of all, whose squared residual is largest; unbroken, if there is one."""
    width = max(len(given.t) // 10, min(len(given.t), 50))
    power, block = np.r_[0.0, np.cumsum(given.before**2)], figures.blocks(given.t)
    broken = block[width - 1 :] != block[: len(block) - width + 1]
    start = int(np.argmax((power[width:] - power[:-width]) * np.where(broken & ~broken.all(), 0.0, 1.0)))
    return slice(start, start + width)


def density(r: Region) -> float:
    """Return how many times denser than even the squared residual lies in a region."""
    return max(r.share / max(r.time_share, 1e-6), 1e-6)


def shown(given: Traces) -> list[tuple[str, Floats, str]]:
    """Return name, values and colour of log minus model, before and after the named effects."""
    size = float(np.max(np.abs(given.before), initial=0.0))
    same = np.allclose(given.before, given.after, rtol=0.0, atol=1e-4 * size)
    if same:
        return [("residual", given.before, RESIDUAL)]
    return [("without the cause", given.before, RESIDUAL), ("with the cause", given.after, ACCENT)]


def gap_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return log minus model over time, before and after the named effects."""
    scale = scale_of("u", rotary, given.before)
    panel = Panel("residual", [Line(*line) for line in shown(given)], scale)
    return over_time(given.t, [panel], 300, block=figures.blocks(given.t))


def spectrum_figure(given: Traces, rotary: bool) -> go.Figure:
    """Return the amplitude spectrum (Welch 1967) of log minus model over the longest stretch, in windows of 2 s."""
    step = np.diff(given.t)
    usual = float(np.median(step))
    stretch = figures.longest(step > 1.5 * usual)
    width = min(stretch.stop - stretch.start, max(round(2.0 / usual), 16))
    scale = scale_of("u", rotary, given.before)
    figure = go.Figure()
    for name, y, colour in shown(given):
        f, power = welch(y[stretch], 1.0 / usual, nperseg=width)
        figure.add_trace(line(f[1:], scale(np.sqrt(power[1:])), name, colour))
    style(figure, 300, x="frequency [Hz]", y=f"residual [{scale.unit}/√Hz]")
    return figure.update_yaxes(type="log")
