"""The report of a diagnosis, for the engineer at the machine: what changed, where, why, how far it shrinks, advice.

The evidence is log minus model over time, against speed and position, and where on the machine.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats
from pinotwin.diagnosis import phrases
from pinotwin.diagnosis.conclusion import sizes
from pinotwin.diagnosis.conclusion.where import telling
from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.phrases import label_words, on_axis, plain_sentence, remedy
from pinotwin.diagnosis.result import Diagnosis, Region, Shrink, Size, Traces
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report import diagnosis_verdict as verdict
from pinotwin.report import display, first_screen
from pinotwin.report.blocks import Block, Files, Group, Html, Page, Plot, Tabs, macro, table
from pinotwin.report.diagnosis_verdict import machine_of, rotary_axes
from pinotwin.report.display import scale_of
from pinotwin.report.figures import against_figure
from pinotwin.studies.overlay import Against
from pinotwin.system.phrases import AGAINST, KINDS, MEANING, SIGNALS, STATES, capital, joined

if TYPE_CHECKING:
    from pinotwin.viewer.stage import Still


COMPARED = {
    "structure": "log against the machine's model, fitted to it",
    "change": "log against a twin that was identified earlier",
}


def diagnosis_report(d: Diagnosis, files: Files = ()) -> str:
    """Return a self-contained HTML page about the residual between log and model."""
    logs = [*d.logs, *d.validation]
    panels = evidence_panels(d, logs)
    grades = dict.fromkeys(d.grade(axis, signal) for axis, row in d.gap.items() for signal in row)
    names = [*((str(x["fault"]), x["axis"]) for x in d.recording), *((e.effect, e.axis) for e in d.effects)]
    remedies = [f"{capital(on_axis(*name))}: {text}." for name in names if (text := remedy(name[0]))]
    advice = [f"{capital(plain_sentence(text))}." for text in d.advice]
    content = {
        "lines": verdict.headline(d),
        "states": verdict.states(d),
        "sure": first_screen.how_sure(d),
        "data": first_screen.which_data(d),
        "now": first_screen.what_now(d, remedies, advice),
        "first": first_screen.picture(d),
        "sizes": sizes,
        "words": phrases,
        "picture": machine_block(d, logs[0] if logs else None),
        "few": len(d.gap) <= 3,  # their cards stand beside the picture
        "cards": verdict.axis_cards(d),
        "d": d,
        "grades": {printed(word).capitalize(): MEANING[word] for word in grades},
        "tracking": any("e" in row for row in d.gap.values()),
        "warnings": [plain_sentence(str(w)) for w in d.warnings],
        "where": _where(d),
        "signals": SIGNALS,
        "kinds": KINDS,
        "groups": [joined([label_words(x) for x in group]) for group in d.confusable],
        "capital": capital,
        "smallest": {(x["effect"], x["axis"]): _smallest(x) for x in d.detectable},
        "shrink": _shrink(d),
        "evidence": Tabs(panels) if panels else "",
        "remedies": remedies,
        "advice": advice,
        "commands": ", ".join(d.commands),
    }
    title = f"{d.machine or 'Machine'}: diagnosis"
    return Page(title, COMPARED.get(d.situation, ""), (), "diagnosis", content, files, d.provenance).html()


def _where(d: Diagnosis, most: int = 8) -> list[tuple[Region, float]]:
    """Return the regions in which the residual lies, ``most`` at most, with how dense it is there."""
    rows = [(r, first_screen.density(r)) for r in telling(d.where, [str(e.axis) for e in d.effects])]
    return [(r, times) for r, times in rows if times > 1.0][:most]


def _smallest(x: Mapping[str, Any]) -> str:
    """Return the smallest change that these logs show, with its unit."""
    size = Size(x["name"], 0.0, float(x["size"]), x["unit"], (0.0, 0.0))
    return f"{size.after:.0%}" if size.unit == "-" else sizes.now_text(size, 3)


def _shrink(d: Diagnosis) -> Html | str:
    """Return each cause's own share of the residual."""
    rows, rotary = [], rotary_axes(d)
    tracked: list[tuple[str, Shrink]] = []
    for e in d.effects:
        others = [("u", x) for x in e.acts.values() if x is not e.shrink.get("u")]
        for signal, x in (*e.shrink.items(), *others):
            axis = x.axis or e.axis or ""
            every = signal == "e" and len(d.effects) > 1  # the loop was simulated with all of them at once
            if every and (axis, x) in tracked:
                continue
            tracked += [(axis, x)] if every else []
            scale = scale_of(signal, rotary.get(axis, False), x.before)
            of = "" if axis == e.axis and not every else f" of {axis}"
            cause = "all causes" if every else on_axis(e.effect, e.axis)
            shares = (display.percent(x.share), _interval(x.interval), display.percent(x.promised))
            moved = (scale.text(x.before), scale.text(x.after), *shares, verdict.named_data(d, x))
            rows.append([f"{cause}, {SIGNALS[signal]}{of}", *moved])
    header = ("cause", "residual before", "after", "explained", "90 % interval", "in the fit", "measured")
    return table(header, rows, numeric=(1, 2, 3, 4, 5)) if rows else ""


def _interval(span: tuple[float, float]) -> str:
    """Return an interval of shares with as many digits as distinguish its ends."""
    for digits in (0, 1, 2, 3):
        low, high = (f"{100 * x:.{digits}f}" for x in span)
        if low != high:
            return f"{low} to {high} %"
    return "–"  # its ends are one: none was found


def evidence_panels(d: Diagnosis, logs: Sequence[Log]) -> dict[str, Sequence[Block]]:
    """Return plots of the residual for every axis with one; for all axes when there is none."""
    rotary, traces = rotary_axes(d), {t.axis: t for t in reversed(d.traces)}
    known = list(dict.fromkeys(t.axis for t in d.traces))
    shown = [a for a in known if a in d.gap and verdict.grade_of(d, a) in verdict.SERIOUS]
    named = {e.axis for e in d.effects}
    axes = sorted(shown, key=lambda a: a not in named) or known
    return {a: _panel(d, logs, traces[a], rotary.get(a, False)) for a in axes if len(traces[a].t) > 1}


def _panel(d: Diagnosis, logs: Sequence[Log], given: Traces, turns: bool) -> list[Block]:
    name = logs[given.log].source if given.log < len(logs) else f"log {given.log + 1}"
    title, note = f"Axis {given.axis}: residual", f"Over time, in {display.elided(name)}."
    peak = "A peak is a vibration; a rise to the right, elasticity or delay."
    spectrum = Plot(first_screen.spectrum_figure(given, turns), "By frequency", peak)
    residual = Plot(first_screen.gap_figure(given, turns), title, note)
    return [residual, *_against(d, given, turns), spectrum]


def _against(d: Diagnosis, given: Traces, turns: bool) -> list[Block]:
    motion = first_screen.motion_of(d, given)
    if motion is None:
        return []
    j = motion.index(given.axis)

    def against(of: Against, x: Floats) -> go.Figure:
        at = np.interp(given.t, motion.t, x[:, j])
        return against_figure(of, turns, at, first_screen.shown(given), given.before)

    speed = Plot(against("velocity", motion.v), "Against speed", AGAINST["velocity"])
    return [Group((speed, Plot(against("position", motion.q), "Against position", AGAINST["position"])))]


def machine_block(d: Diagnosis, log: Log | None = None) -> Html | None:
    """Return the machine with what was found on its axes, in the middle of a log; None where the diagnosis has none."""
    machine = machine_of(d)
    if machine is None:
        return None
    try:
        drawn = _drawn(d, machine, log)
    except (PinotwinError, ValueError, RuntimeError, OSError, ImportError):
        return None  # a picture is worth less than the page it belongs to
    return _figure(d, machine, drawn) if drawn.joints else None


def _drawn(d: Diagnosis, machine: Machine, log: Log | None) -> Still:
    from pinotwin.viewer.gap import shade  # half a second of meshcat, which other pages do not need
    from pinotwin.viewer.scene import visual_model
    from pinotwin.viewer.stage import still

    rigid, channels = machine.with_rigid_joints(), {} if log is None else log.channels
    places = {name: x for name in rigid.axes if (x := channels.get(f"{name}.q")) is not None}
    q = rigid.posture({k: float(np.nanmedian(x)) for k, x in places.items() if np.isfinite(x).any()})
    colours = {axis.joint: shade(d, name) for name, axis in rigid.axes.items()}
    return still(rigid.model, visual_model(rigid.model, rigid.urdf, rigid.meshes), q, colours)


def _figure(d: Diagnosis, machine: Machine, drawn: Still, high: float = 24.0, wide: float = 8.5) -> Html:
    """Return the picture with names on it, ``high`` apart, of letters ``wide`` [px]: none hides another."""
    width, height = drawn.size
    places = (
        (drawn.joints[axis.joint], name) for name, axis in machine.axes.items() if axis.joint in drawn.joints
    )
    marks, last = [], {True: -1e9, False: -1e9}
    for (x, y), name in sorted(places, key=lambda place: place[0][1]):
        left = x < 0.5 * width
        low = last[left] = max(min(max(y, 16.0), height - 12.0), last[left] + high)
        word = f"{name} · {STATES[d.situation][d.state(name)]}"
        inner = min(wide * len(word), 0.4 * width)
        edge, to = (6, 10.0 + inner) if left else (width - 6, width - 10.0 - inner)
        anchor = "start" if left else "end"
        marks.append((round(x), round(y), round(to), round(low), edge, anchor, word))
    return macro("machine", machine.name, base64.b64encode(drawn.png).decode(), drawn.size, marks)
