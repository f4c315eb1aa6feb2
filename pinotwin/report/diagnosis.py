"""The report of a diagnosis, for the engineer at the machine: what changed, where, why, how far it shrinks, advice."""

from __future__ import annotations

from collections.abc import Sequence

from pinotwin.diagnosis.conclusion.sizes import (
    before_text,
    interval_text,
    name_words,
    now_text,
    times_text,
    told,
)
from pinotwin.diagnosis.conclusion.where import telling
from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.phrases import explanation, label_words, on_axis, plain_sentence, region_words, remedy
from pinotwin.diagnosis.result import Diagnosis, Found, Region
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.blocks import Html, Tabs, macro, table
from pinotwin.report.diagnosis_evidence import evidence_panels, machine_block
from pinotwin.report.diagnosis_plots import density, signal_name
from pinotwin.report.diagnosis_verdict import axis_cards, headline, named_data, rotary_axes, states
from pinotwin.report.display import scale_of
from pinotwin.report.first_screen import how_sure, picture, what_now, which_data
from pinotwin.report.page import Page
from pinotwin.system.phrases import KINDS, MEANING, SIGNALS, capital, joined

COMPARED = {
    "structure": "log against the machine's model, fitted to it",
    "change": "log against a twin that was identified earlier",
}
OTHERWISE = {"none": "chance: no cause", "unknown": "a cause that is in no catalogue"}


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
        "changes": _changes(d),
        "picture": machine_block(d, logs[0] if logs else None),
        "few": len(d.gap) <= 3,  # their cards stand beside the picture
        "cards": axis_cards(d),
        "d": d,
        "grades": {printed(word).capitalize(): MEANING[word] for word in grades},
        "tracking": any("e" in row for row in d.gap.values()),
        "warnings": [plain_sentence(str(w)) for w in d.warnings],
        "where": _where(d),
        "signal_name": signal_name,
        "region_words": region_words,
        "kinds": KINDS,
        "named": _which(d.effects),
        "possible": _which(d.possible),
        "groups": [joined([label_words(x) for x in group]) for group in d.confusable],
        "on_axis": on_axis,
        "explanation": explanation,
        "numbers": [x for e in d.effects for x in _numbers(e)],
        "shrink": _shrink(d),
        "evidence": Tabs(panels) if panels else "",
        "remedies": remedies,
        "advice": advice,
        "commands": ", ".join(d.commands),
    }
    title = f"{d.machine or 'Machine'}: diagnosis"
    return Page(title, COMPARED.get(d.situation, ""), (), "diagnosis", content, files, d.provenance).html()


def _changes(d: Diagnosis) -> Html | str:
    """Return what each cause changed from what to what, with units and intervals."""
    rows: list[list[object]] = []
    for e in d.effects:
        first, sure = macro("bold", on_axis(e.effect, e.axis)), f"{e.confidence:.0%}"
        numbers = [
            [name_words(s), before_text(s), now_text(s), interval_text(s), times_text(s)]
            for s in told(e.size)[:3]
        ] or [[""] * 5]
        rows += [[first if k == 0 else "", *row, sure if k == 0 else ""] for k, row in enumerate(numbers)]
    before = "before" if d.situation == "change" else "in the model"
    header = ("cause", "number", before, "now", "90 % interval", "change", "confidence")
    return table(header, rows, numeric=(2, 3, 4, 5, 6)) if rows else ""


def _where(d: Diagnosis, most: int = 8) -> list[tuple[Region, float]]:
    """Return the regions in which the residual lies, ``most`` at most, with how dense it is there."""
    rows = [(r, density(r)) for r in telling(d.where, [str(e.axis) for e in d.effects])]
    return [(r, times) for r, times in rows if times > 1.0][:most]


def _which(found: Sequence[Found]) -> Html | str:
    """Return causes with their confidence and what else each could be."""
    rows = []
    for e in found:
        others = []
        for item in e.alternatives:
            effect, p = str(item.get("effect", "")), item.get("probability", 0.0)
            what = OTHERWISE.get(effect) or on_axis(effect, item.get("axis"))
            chance = f" ({p:.0%})" if p >= 0.005 else ""
            others.append(f"{what}{chance}: {plain_sentence(str(item.get('why', '')))}")
        name = macro("bold", on_axis(e.effect, e.axis))
        rows.append([name, explanation(e.effect), f"{e.confidence:.0%}", macro("others", others)])
    return table(("cause", "what it is", "confidence", "could also be"), rows) if rows else ""


def _numbers(e: Found, most: int = 12) -> list[tuple[str, str, Html]]:
    """Return every number of a cause that has more than the answer shows: title, form, and a table."""
    if len(e.size) <= 1:
        return []
    rows = [[s.name, before_text(s), now_text(s), interval_text(s)] for s in e.size[:most]]
    more = f"; the first {most}, all are in diagnosis.json" if len(e.size) > most else ""
    shapes = ", ".join(f"{k} = {v:.4g}" for k, v in e.shape.items()) if len(e.shape) <= most else ""
    numbers = table(("number", "before", "now", "90 % interval"), rows, numeric=(1, 2, 3))
    return [(f"{on_axis(e.effect, e.axis)}: {len(e.size)} numbers{more}", shapes, numbers)]


def _shrink(d: Diagnosis) -> Html | str:
    """Return each cause's own share of the residual."""
    rows, rotary = [], rotary_axes(d)
    for e in d.effects:
        others = [("u", x) for x in e.acts.values() if x is not e.shrink.get("u")]
        for signal, x in (*e.shrink.items(), *others):
            axis = x.axis or e.axis or ""
            scale = scale_of(signal, rotary.get(axis, False), x.before)
            of = "" if axis == e.axis else f" of {axis}"
            what = f"{on_axis(e.effect, e.axis)}, {SIGNALS.get(signal, signal)}{of}"
            shares = (display.percent(x.share), _interval(x.interval), display.percent(x.promised))
            rows.append([what, scale.text(x.before), scale.text(x.after), *shares, named_data(d, x)])
    header = ("cause", "residual before", "after", "explained", "90 % interval", "expected", "measured")
    return table(header, rows, numeric=(1, 2, 3, 4, 5)) if rows else ""


def _interval(span: tuple[float, float]) -> str:
    """Return an interval of shares with as many digits as distinguish its ends."""
    for digits in (0, 1, 2, 3):
        low, high = (f"{100 * x:.{digits}f}" for x in span)
        if low != high:
            return f"{low} to {high} %"
    return "–"  # its ends are one: none was found
