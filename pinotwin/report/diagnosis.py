"""The report of a diagnosis: what changed, where, why, how far the residual falls, what to do next.

Written for the engineer at the machine: the answer first, every technical word explained where it stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

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
from pinotwin.diagnosis.phrases import (
    KINDS,
    SIGNALS,
    explanation,
    joined,
    label_words,
    on_axis,
    plain_sentence,
    region_words,
)
from pinotwin.diagnosis.result import Diagnosis, Found
from pinotwin.effects import known
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.blocks import (
    Block,
    Group,
    Html,
    Plot,
    Tabs,
    bullets,
    chip,
    heading,
    macro,
    notes,
    paragraph,
    table,
)
from pinotwin.report.diagnosis_evidence import evidence_panels
from pinotwin.report.diagnosis_machine import machine_block
from pinotwin.report.diagnosis_plots import bars, density, shrink_figure, signal_name, signal_scale
from pinotwin.report.diagnosis_verdict import (
    axis_cards,
    ground,
    headline,
    named_data,
    rotary_axes,
    source_names,
)
from pinotwin.report.page import Page, files_block, provenance_blocks

OTHERWISE = {"none": "chance: no cause", "unknown": "a cause that is in no catalogue"}
MANY = 12
"""Numbers of one cause that are listed; the rest is in diagnosis.json."""
REGIONS = 8
"""Regions that are listed."""
BESIDE = 3
"""Axes whose cards stand beside the picture of the machine; more stand below it."""


def diagnosis_report(
    diagnosis: Diagnosis,
    logs: Log | Sequence[Log] = (),
    validate: Sequence[Log] = (),
    files: Sequence[tuple[str, str]] = (),
) -> str:
    """Return a self-contained HTML page about the gap between log and model.

    Args:
        diagnosis: what was found.
        logs: the log(s) that were diagnosed, in the same order; with them, and the machine in the
            diagnosis, the gap is also drawn against speed and position.
        validate: the log(s) that nothing was fitted to.
        files: name and content of what lies beside the page, to link to.
    """
    given = [logs] if isinstance(logs, Log) else list(logs)
    return diagnosis_page(diagnosis, [*given, *validate], files).html()


def diagnosis_page(d: Diagnosis, logs: Sequence[Log], files: Sequence[tuple[str, str]] = ()) -> Page:
    """Return the same report as a :class:`Page`."""
    page = Page(f"{d.machine or 'Machine'}: diagnosis", subtitle(d, logs))
    page = page.section("Answer", *answer_blocks(d, logs))
    page = page.section("Where", *where_blocks(d), intro=_WHERE)
    page = page.section("Which cause", *which_blocks(d))
    page = page.section("How far the residual falls", *how_far_blocks(d), intro=_HOW_FAR)
    panels = evidence_panels(d, logs)
    if panels:
        page = page.section("Evidence", Tabs(panels), intro=_EVIDENCE)
    page = page.section("What to do next", *next_blocks(d))
    page = page.section("Files", *files_block(files))
    return page.section("How this was made", *provenance_blocks(d.provenance))


_WHERE = (
    "Where in the motion and in time the residual lies. Look where much of it is concentrated in little time."
)
_HOW_FAR = (
    "Expected: variance reduction in the fit. Explained: variance reduction on held-out data, with a 90 % interval; "
    "several causes of one axis add up. The cause was chosen on these logs; without a validation log the figure is "
    "optimistic. Bars: RMS residual on the diagnosed logs. Noise: difference of two runs of the same motion. "
    "Validation error: the twin's cross-validated error plus its uncertainty in this motion."
)
_EVIDENCE = (
    "Measured minus predicted effort. A curve is something that the model lacks; a shapeless band is noise."
)


def subtitle(d: Diagnosis, logs: Sequence[Log]) -> str:
    """Return the line below the title."""
    compared = {
        "structure": "log against the machine's model, fitted to it",
        "change": "log against a twin that was identified earlier",
    }
    all_names = source_names(d, logs)
    names = ", ".join(display.elided(name, 40) for name in all_names[:4])
    more = f" and {len(all_names) - 4} more" if len(all_names) > 4 else ""
    return " · ".join(w for w in (compared.get(d.situation, ""), names + more) if w)


def answer_blocks(d: Diagnosis, logs: Sequence[Log]) -> list[Block]:
    """Return the answer in words and numbers, the machine, and a card per axis."""
    lines = headline(d)
    first = [paragraph(line, "verdict") for line in lines]
    picture = machine_block(d, logs[0] if logs else None)
    rows = [row for e in d.effects for row in _changes(e)]
    changes: list[Block] = []
    if rows:
        before = "before" if d.situation == "change" else "in the model"
        header = ("cause", "number", before, "now", "90 % interval", "change", "confidence")
        changes = [table(header, rows, numeric=(2, 3, 4, 5, 6))]
    said = notes(plain_sentence(str(w)) for w in d.warnings)
    reading = Html(f"<details><summary>how to read this</summary>{bullets(ground(d)).text}</details>")
    return [*first, *changes, _beside(picture, axis_cards(d), few=len(d.gap) <= BESIDE), reading, said]


def _beside(picture: Html | None, cards: Html, *, few: bool) -> Html:
    """Return the machine with the cards of its axes beside it, below it where there are many."""
    if picture is None:
        return cards
    style = "answer" if few else "answer many"
    return Html(f'<div class="{style}">{picture.text}{cards.text}</div>')


def _changes(e: Found) -> list[list[object]]:
    """Return what a cause changed from what to what, with units and intervals."""
    name = Html(f"<b>{escape(on_axis(e.effect, e.axis))}</b>")
    sure = chip(f"{e.confidence:.0%}", _sure(e.confidence))
    sizes = told(e.size)[:3]
    if not sizes:
        return [[name, "", "", "", "", "", sure]]
    rows: list[list[object]] = []
    for k, s in enumerate(sizes):
        row: list[object] = [
            name if k == 0 else "",
            name_words(s),
            before_text(s),
            now_text(s),
            interval_text(s),
            times_text(s),
        ]
        rows.append([*row, sure if k == 0 else ""])
    return rows


def _sure(confidence: float) -> str:
    return "good" if confidence >= 0.9 else "fair" if confidence >= 0.6 else "bad"


def where_blocks(d: Diagnosis) -> list[Block]:
    """Return the regions in which the gap lies, as a table with bars."""
    denser = [r for r in telling(d.where, [str(e.axis) for e in d.effects]) if density(r) > 1.0]
    if not denser:
        return []
    rows = [
        [
            Html(f"<b>{escape(signal_name(r.axis, r.signal))}</b>"),
            KINDS.get(r.kind, r.kind),
            region_words(r),
            macro("share_bar", r.share, r.time_share),
            f"{density(r):.0f} ×" if density(r) >= 9.95 else f"{density(r):.2g} ×",
            "–" if r.p_value is None else f"{100 * r.p_value:.2g} %",
        ]
        for r in denser[:REGIONS]
    ]
    header = (
        "signal",
        "by",
        "where",
        "share of the squared residual, in what share of time or band",
        "concentration",
        "chance",
    )
    return [
        table(header, rows, numeric=(4, 5)),
        paragraph(
            "Concentration: share of the squared residual over share of the time. Chance: how often noise shows it.",
            "lead",
        ),
    ]


def which_blocks(d: Diagnosis) -> list[Block]:
    """Return the named causes with confidence, what else it could be, and the look-alikes."""
    out: list[Block] = []
    if d.effects:
        rows = [_which(e) for e in d.effects]
        out.append(table(("cause", "what it is", "confidence", "could also be"), rows))
        out.append(paragraph(_CONFIDENCE, "lead"))
    if d.possible:
        out.append(heading("Possible, not sure enough to be named"))
        rows = [_which(e) for e in d.possible]
        out.append(table(("cause", "what it is", "confidence", "could also be"), rows))
    groups = [joined([label_words(x) for x in group]) for group in d.confusable]
    if groups:
        out.append(heading("Look-alikes"))
        out.append(paragraph("These logs cannot distinguish the following:"))
        out.append(bullets(groups))
    if d.missing:
        out.append(heading("Missing since the identification"))
        out.append(paragraph("No change: the twin lacked these from the start. Identify it again."))
        rows = [
            [
                on_axis(str(m["effect"]), m.get("axis")),
                explanation(str(m["effect"])),
                f"{float(m['share']):.0%}",
            ]
            for m in d.missing
        ]
        out.append(table(("effect", "what it is", "share of the validation error"), rows, numeric=(2,)))
    return [*out, *(block for e in d.effects for block in _numbers(d, e))]


_CONFIDENCE = (
    "Confidence: how often the search finds this cause when it is injected into the residual of this motion. "
    "For second-encoder and vibration findings: bootstrap share."
)


def _which(e: Found) -> list[object]:
    name = Html(f"<b>{escape(on_axis(e.effect, e.axis))}</b>")
    others = []
    for item in e.alternatives:
        effect = str(item.get("effect", ""))
        what = OTHERWISE.get(effect) or on_axis(effect, item.get("axis"))
        p = item.get("probability", 0.0)
        chance = f" ({p:.0%})" if p >= 0.005 else ""
        others.append(f"{what}{chance}: {plain_sentence(str(item.get('why', '')))}")
    lines = "".join(f'<div class="sub">{escape(x)}</div>' for x in others)
    other = Html(
        f"<div>{lines}</div>" if lines else "no other candidate is close"
    )  # one element, or a phone sets them side by side
    return [name, explanation(e.effect), chip(f"{e.confidence:.0%}", _sure(e.confidence)), other]


def _numbers(d: Diagnosis, e: Found) -> list[Block]:
    """Return every number of a cause that has more than the answer shows, folded away."""
    if len(e.size) <= 1:
        return []
    rows = [[s.name, before_text(s), now_text(s), interval_text(s)] for s in e.size[:MANY]]
    more = f"; the first {MANY}, all are in diagnosis.json" if len(e.size) > MANY else ""
    title = f"{on_axis(e.effect, e.axis)}: {len(e.size)} numbers{more}"
    shapes = ", ".join(f"{k} = {v:.4g}" for k, v in e.shape.items()) if len(e.shape) <= MANY else ""
    inside = table(("number", "before", "now", "90 % interval"), rows, numeric=(1, 2, 3)).text
    form = paragraph(f"Form (SI): {shapes}.").text if shapes else ""
    return [Html(f"<details><summary>{escape(title)}</summary>{form}{inside}</details>")]


def how_far_blocks(d: Diagnosis) -> list[Block]:
    """Return the bars of every axis, and each cause's own share."""
    rotary = rotary_axes(d)
    plots: list[Block] = []
    for axis in sorted(d.gap, key=lambda a: a not in d.shrink):
        for signal, gap in d.gap[axis].items():
            word = d.grade(axis, signal)
            acts = word in ("gap explained", "partly explained")
            figure = shrink_figure(bars(gap, acts=acts), signal, rotary.get(axis, False))
            plots.append(Plot(figure, f"Axis {axis}, {SIGNALS.get(signal, signal)}: {printed(word)}"))
    rows = []
    for e in d.effects:
        others = [("u", x) for x in e.acts.values() if x is not e.shrink.get("u")]
        for signal, x in (*e.shrink.items(), *others):
            axis = x.axis or e.axis or ""
            scale = signal_scale(signal, rotary.get(axis, False), x.before)
            of = "" if axis == e.axis else f" of {axis}"
            rows.append(
                [
                    f"{on_axis(e.effect, e.axis)}, {SIGNALS.get(signal, signal)}{of}",
                    f"{x.before * scale.factor:.3g} {scale.unit}",
                    f"{x.after * scale.factor:.3g} {scale.unit}",
                    display.percent(x.share),
                    _interval(x.interval),
                    display.percent(x.promised),
                    named_data(d, x),
                ]
            )
    out: list[Block] = []
    if rows:
        header = ("cause", "residual before", "after", "explained", "90 % interval", "expected", "measured")
        out.append(table(header, rows, numeric=(1, 2, 3, 4, 5)))
    return [*out, Group(tuple(plots))] if plots else out


def _interval(span: tuple[float, float]) -> str:
    """Return an interval of shares with as many digits as tell its ends apart."""
    for digits in (0, 1, 2, 3):
        low, high = (f"{100 * x:.{digits}f}" for x in span)
        if low != high:
            return f"{low} to {high} %"
    return "–"  # its ends are one: none was found


def next_blocks(d: Diagnosis) -> list[Block]:
    """Return what a person can do next, the machine first, then what to record."""
    lines = []
    for e in d.effects:
        kind = known().get(e.effect)
        remedy = "" if kind is None else kind.remedy
        if remedy:
            lines.append(f"{_capital(on_axis(e.effect, e.axis))}: {remedy}.")
    if d.effects:
        lines.append(
            "If the cause is real and permanent, use the folder “machine”: it holds the machine with the cause. "
            "Identify it again."
        )
    if d.verdict == "none":
        lines.append("Nothing needs repair. Keep this log as a reference for later ones.")
    lines += [_capital(plain_sentence(text)) + "." for text in d.advice]
    out: list[Block] = [bullets(lines or ["Record the motion again to confirm the finding."])]
    if d.warnings:
        out += [paragraph("Warnings about these logs:"), bullets([_capital(x) for x in d.warnings])]
    if d.commands:
        out.append(
            paragraph(
                f"Motions to record, as command files beside this page: {', '.join(d.commands)}. They stay within "
                "the travel and the speed of the log; check them against the machine's limits first."
            )
        )
    return out


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
