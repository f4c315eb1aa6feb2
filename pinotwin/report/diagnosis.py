"""The report of a diagnosis, for the engineer at the machine: what changed, where, why, how far it shrinks, advice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pinotwin.diagnosis import phrases
from pinotwin.diagnosis.conclusion import sizes
from pinotwin.diagnosis.conclusion.where import telling
from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.phrases import label_words, on_axis, plain_sentence, remedy
from pinotwin.diagnosis.result import Diagnosis, Region, Shrink, Size
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.blocks import Html, Tabs, table
from pinotwin.report.diagnosis_evidence import evidence_panels, machine_block
from pinotwin.report.diagnosis_plots import density
from pinotwin.report.diagnosis_verdict import axis_cards, headline, named_data, rotary_axes, states
from pinotwin.report.display import scale_of
from pinotwin.report.first_screen import how_sure, picture, what_now, which_data
from pinotwin.report.page import Page
from pinotwin.system.phrases import KINDS, MEANING, SIGNALS, capital, joined

COMPARED = {
    "structure": "log against the machine's model, fitted to it",
    "change": "log against a twin that was identified earlier",
}


def diagnosis_report(
    d: Diagnosis,
    logs: Log | Sequence[Log] = (),
    validate: Sequence[Log] = (),
    files: Sequence[tuple[str, str]] = (),
) -> str:
    """Return a self-contained HTML page about the residual between log and model."""
    logs = [*([logs] if isinstance(logs, Log) else logs), *validate]
    panels = evidence_panels(d, logs)
    grades = dict.fromkeys(d.grade(axis, signal) for axis, row in d.gap.items() for signal in row)
    names = [*((str(x["fault"]), x["axis"]) for x in d.recording), *((e.effect, e.axis) for e in d.effects)]
    remedies = [f"{capital(on_axis(*name))}: {text}." for name in names if (text := remedy(name[0]))]
    advice = [f"{capital(plain_sentence(text))}." for text in d.advice]
    content = {
        "lines": headline(d),
        "states": states(d),
        "sure": how_sure(d),
        "data": which_data(d),
        "now": what_now(d, remedies, advice),
        "first": picture(d),
        "sizes": sizes,
        "words": phrases,
        "picture": machine_block(d, logs[0] if logs else None),
        "few": len(d.gap) <= 3,  # their cards stand beside the picture
        "cards": axis_cards(d),
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
    rows = [(r, density(r)) for r in telling(d.where, [str(e.axis) for e in d.effects])]
    return [(r, times) for r, times in rows if times > 1.0][:most]


def _smallest(x: Mapping[str, Any]) -> str:
    """Return the smallest change that these logs show, with its unit."""
    size = Size(x["name"], 0.0, float(x["change"]), x["unit"], (0.0, 0.0))
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
            moved = (scale.text(x.before), scale.text(x.after), *shares, named_data(d, x))
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
