"""What page, terminal and JSON say of one diagnosis is one story: no sentence, chip or number contradicts another."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pinotwin.cli.diagnose import cause_lines, gap_lines, summary
from pinotwin.diagnosis import Diagnosis
from pinotwin.diagnosis.phrases import effect_words, on_axis
from pinotwin.diagnosis.result import Found, Gap, Region, Shrink, Size
from pinotwin.diagnosis.rules import RULES
from pinotwin.report.diagnosis_verdict import axis_cards, headline, rotary_axes, states
from pinotwin.report.display import scale_of
from pinotwin.report.first_screen import how_sure, picture
from pinotwin.system.phrases import DIAGNOSED, STATES


def contradictions(d: Diagnosis) -> list[str]:
    """Return what page, terminal and JSON say differently of one diagnosis, one line each."""
    return [line for check in (_states, _sentences, _numbers, _expected, _sure, _drawn) for line in check(d)]


def _states(d: Diagnosis) -> Iterator[str]:
    words, said = STATES[d.situation], d.to_dict()["state"]
    chips, cards = dict(states(d, most=len(d.gap))), str(axis_cards(d))
    terminal = next(x for x in summary(d) if x.startswith("axes: ")).removeprefix("axes: ")
    for axis in d.gap:
        state, word = d.state(axis), words[d.state(axis)]
        kind = {"changed": "bad", "unchanged": "good"}.get(state, "")
        if f"{axis} {word}" not in terminal.split(", "):
            yield f"state of {axis}: not {word} in the terminal: {terminal}"
        if said[axis] != state or chips.get(f"{axis} {word}") != kind:
            yield f"state of {axis}: JSON {said[axis]}, chips {chips}"
        if f'<h3>Axis {axis} <span class="chip {kind}">{word}</span></h3>' not in cards:
            yield f"state of {axis}: not {word} on its card"
    changed = {axis for axis in d.gap if d.state(axis) == "changed"}
    if d.verdict == "none" and changed:
        yield f"verdict none, changed {changed}"
    faulty = {e.axis for e in d.effects} | {
        a
        for a, row in d.unexplained.items()
        if set(row) & set(d.gap.get(a, ())) and d.state(a) != "cannot say"  # open, for it cannot be judged
    }
    if not (faulty & set(d.gap)) <= changed:
        yield f"named or open {faulty}, changed {changed}"


def _sentences(d: Diagnosis) -> Iterator[str]:
    lines = headline(d)
    agree = {DIAGNOSED["agree_change"], DIAGNOSED["agree_structure"]} & set(lines)
    if bool(agree) != (d.verdict == "none"):
        yield f"verdict {d.verdict}, headline {lines}"
    for e in d.effects[:3]:
        if not any(x.startswith(f"{e.axis or d.machine}: {effect_words(e.effect)} ") for x in lines):
            yield f"{e.effect} on {e.axis} is in no sentence"
    for axis in d.gap:
        stays = [
            x for x in lines if x.startswith(f"{axis}: ") and ("unexplained" in x or "no named cause" in x)
        ]
        if stays and d.state(axis) != "changed":
            yield f"{stays} on {axis}, {d.state(axis)}"


def _numbers(d: Diagnosis) -> Iterator[str]:
    """A residual is the same number in the sentence, on the card and in the terminal."""
    cards, rows, lines = html.unescape(str(axis_cards(d))), gap_lines(d)[1:], headline(d)
    big = re.findall(r'<div class="big[^>]*>([^<]*)</div>', cards)
    signals = [(axis, signal, g) for axis, row in d.gap.items() for signal, g in row.items()]
    for (axis, signal, g), shown, row in zip(signals, big, rows, strict=True):
        now = scale_of(signal, rotary_axes(d).get(axis, False), g.rms).text(g.rms)
        if now not in row or shown.split(" → ")[0].split()[0] != now.split()[0]:
            yield f"{axis}.{signal} {now}: card {shown}, terminal {row}"
        falls = [x for x in lines if x.startswith(f"{axis}: ") and " the residual falls from " in x]
        if signal == "u" and any(f"from {now.split()[0]} to " not in x for x in falls):
            yield f"{axis}.{signal} {now}: {falls}"


def _expected(d: Diagnosis) -> Iterator[str]:
    """What is expected of a residual is one number, and its grade and sentence agree with it."""
    cards, rows = html.unescape(str(axis_cards(d))).split("<h3>")[1:], gap_lines(d)[1:]
    signals = [(axis, signal, g) for axis, row in d.gap.items() for signal, g in row.items()]
    for (axis, signal, g), row in zip(signals, rows, strict=True):
        shown = scale_of(signal, rotary_axes(d).get(axis, False), g.rms).text(g.level)
        card = next(x for x in cards if x.startswith(f"Axis {axis} "))
        if g.level > 0.0 and shown not in row:
            yield f"{axis}.{signal} {shown} expected: terminal {row}"
        if g.misfit == g.misfit and shown not in card:
            yield f"{axis}.{signal} {shown} expected: not on the card"
        if d.grade(axis, signal) == "gap explained" and signal == "e" and g.after > RULES.odd * g.level:
            yield f"{axis}.{signal} explained, {g.after:.3g} of {shown} remain"
        small = any(x.startswith(f"{axis}: no named cause explains") for x in headline(d)) and signal == "u"
        if small and 0.0 < g.rms <= g.level:
            yield f"{axis}.{signal} said to be open, no larger than the {shown} expected"


def _sure(d: Diagnosis) -> Iterator[str]:
    for e, line in zip(d.effects, how_sure(d), strict=False):
        text = f"{e.confidence:.0%}"
        if not line.startswith(f"{text} for {on_axis(e.effect, e.axis)}"):
            yield f"confidence {text}: {line}"
        if f"effect: {on_axis(e.effect, e.axis)}, confidence {text}" not in cause_lines(d):
            yield f"confidence {text}: not in the terminal"


def _drawn(d: Diagnosis) -> Iterator[str]:
    changed = {axis for axis in d.gap if d.state(axis) == "changed"}
    drawn = picture(d)
    if drawn is not None and changed and not any(f"Axis {axis}:" in drawn.title for axis in changed):
        yield f"changed {changed}, drawn {drawn.title}"


def read_back(document: Mapping[str, Any]) -> Diagnosis:
    """Return the diagnosis that a diagnosis.json tells of, without logs."""

    def number(x: float | None) -> float:
        return math.nan if x is None else float(x)

    def shrink(x: Mapping[str, Any], on: str) -> Shrink:
        return Shrink(
            x["before"], x["after"], x["share"], tuple(x["interval90"]), x["promised"], on, axis=x.get("axis")
        )

    def size(x: Mapping[str, Any]) -> Size:
        return Size(
            x["name"], number(x["before"]), number(x["after"]), x["unit"], tuple(map(number, x["interval90"]))
        )

    def found(x: Mapping[str, Any]) -> Found:
        on = str(x["shrink"].get("on", "validation"))
        shrinks = {s: shrink(y, on) for s, y in x["shrink"].items() if s != "on"}
        acts = {a: shrink(y, on) for a, y in x.get("acts", {}).items()}
        given = (
            x["effect"],
            x["axis"],
            x["confidence"],
            x.get("shape", {}),
            {},
            shrinks,
            x.get("alternatives", ()),
        )
        return Found(*given, size=[*map(size, x["sizes"])], acts=acts)

    held = {k: document[k] for k in ("sentence", "unexplained", "situation")}
    held |= {"remains": document.get("remains", {}), "noise": document.get("noise", "assumed")}
    held |= {k: document.get(k, ()) for k in ("advice", "confusable")}
    gaps = {
        a: {s: Gap(**{k: number(x) for k, x in g.items() if k != "grade"}) for s, g in row.items()}
        for a, row in document["gap"].items()
    }
    where = [Region(**{**x, "range": tuple(x["range"])}) for x in document.get("where", ())]
    causes = {k: [*map(found, document[k])] for k in ("effects", "possible")}
    total = {a: {s: shrink(x, "") for s, x in row.items()} for a, row in document["shrink"].items()}
    return Diagnosis(**held, gap=gaps, where=where, shrink=total, **causes)
