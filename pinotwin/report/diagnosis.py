"""The report of a diagnosis: is there a gap, where, why, how far it shrinks, what to do next.

Written for the engineer at the machine: every technical word is explained where it first stands.
"""

from __future__ import annotations

from collections.abc import Sequence

from pinotwin.diagnosis.result import Diagnosis, Found
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
    escape,
    heading,
    notes,
    paragraph,
    table,
    tiles,
)
from pinotwin.report.diagnosis_evidence import evidence_panels
from pinotwin.report.diagnosis_plots import (
    bars,
    density,
    shrink_figure,
    signal_name,
    signal_scale,
    where_figure,
)
from pinotwin.report.diagnosis_verdict import SIGNALS, axis_tiles, ground, headline, rotary_axes
from pinotwin.report.page import Page
from pinotwin.report.plain_words import (
    KINDS,
    explanation,
    joined,
    label_words,
    on_axis,
    plain_sentence,
    region_words,
)

OTHERWISE = {"none": "chance: no cause", "unknown": "a cause that is in no catalogue"}


def diagnosis_report(
    diagnosis: Diagnosis, logs: Log | Sequence[Log] = (), validate: Sequence[Log] = ()
) -> str:
    """Return a self-contained HTML page about the gap between log and model.

    Args:
        diagnosis: what was found.
        logs: the log(s) that were diagnosed, in the same order; with them, and the machine in the
            diagnosis, the gap is also drawn against speed and position.
        validate: the log(s) that nothing was fitted to.
    """
    given = [logs] if isinstance(logs, Log) else list(logs)
    return diagnosis_page(diagnosis, [*given, *validate]).html()


def diagnosis_page(d: Diagnosis, logs: Sequence[Log]) -> Page:
    """Return the same report as a :class:`Page`."""
    page = Page(f"{d.machine or 'Machine'}: diagnosis", subtitle(d, logs))
    page = page.section(
        "Verdict", paragraph(headline(d), "verdict"), tiles(axis_tiles(d)), bullets(ground(d))
    )
    if d.where:
        page = page.section(
            "Where",
            *where_blocks(d),
            intro="Where the gap between log and model "
            "lies. If it lay evenly, a tenth of the time would hold a tenth of it; "
            "where much of it lies in little time, the cause is at work.",
        )
    if d.effects or d.confusable:
        page = page.section("Which cause", *which_blocks(d))
    page = page.section("How far the gap shrinks", *how_far_blocks(d), intro=_HOW_FAR)
    panels = evidence_panels(d, logs)
    if panels:
        page = page.section(
            "Evidence",
            Tabs(panels),
            intro="Measured effort minus the effort that "
            "the model asks for. What looks like a curve here is something "
            "that the model does not know; a shapeless band is noise.",
        )
    return page.section("What to do next", *next_blocks(d))


_HOW_FAR = (
    "RMS, the usual size, of log minus model. Promised: what the fit itself expects. Delivered: what "
    "came of it on data that its size was not fitted to, with a 90 % interval; the choice of the "
    "cause has seen those data, so without a separate log it flatters. Noise floor: "
    "what differs between two runs of the same motion; no model gets below it."
)


def subtitle(d: Diagnosis, logs: Sequence[Log]) -> str:
    """Return the line below the title."""
    compared = {
        "structure": "log against the machine's model, refitted to it",
        "change": "log against a twin that was identified earlier",
    }
    names = ", ".join(display.elided(log.source, 40) for log in logs[:4])
    more = f" and {len(logs) - 4} more" if len(logs) > 4 else ""
    words = [compared.get(d.situation, ""), names + more]
    return " · ".join(w for w in words if w)


def where_blocks(d: Diagnosis) -> list[Block]:
    """Return the map of the regions and their table."""
    known = [(axis, signal) for axis, row in d.gap.items() for signal in row]
    signals = list(dict.fromkeys([*known, *((r.axis, r.signal) for r in d.where)]))
    rows = [
        [
            signal_name(r.axis, r.signal),
            KINDS.get(r.kind, r.kind),
            region_words(r),
            f"{r.share:.0%}",
            f"{r.time_share:.0%}" if r.time_share >= 0.01 else "< 1%",
            f"{density(r):.1f} ×",
            "–" if r.p_value is None else f"{100 * r.p_value:.2g} %",
        ]
        for r in d.where
    ]
    header = ("signal", "by", "where", "share of the gap", "of the time (band)", "denser than even", "chance")
    return [
        Plot(
            where_figure(d.where, signals),
            "Share of the squared gap against share of time",
            "Empty: the gap lies there no denser than elsewhere.",
        ),
        table(header, rows, numeric=(3, 4, 5, 6)),
        paragraph("Chance: how often pure noise would show such a concentration somewhere.", "lead"),
    ]


def which_blocks(d: Diagnosis) -> list[Block]:
    """Return the named causes with confidence, what else it could be, and the look-alikes."""
    out: list[Block] = []
    if d.effects:
        out.append(
            table(("cause", "what it is", "confidence", "could also be"), [_which(e) for e in d.effects])
        )
        out.append(
            paragraph(
                "Confidence: of trials in which this cause was put into what the model leaves anyway on "
                "this motion, the share in which the same search named it first.",
                "lead",
            )
        )
    else:
        out.append(paragraph("No cause is named."))
    groups = [joined([label_words(x) for x in group]) for group in d.confusable]
    if groups:
        out.append(heading("Look-alikes"))
        out.append(paragraph("These logs do not tell the following apart:"))
        out.append(bullets(groups))
    out += [block for e in d.effects for block in _numbers(e)]
    return out


def _which(e: Found) -> list[object]:
    kind = "good" if e.confidence >= 0.9 else "fair" if e.confidence >= 0.6 else "bad"
    name = Html(f"<b>{escape(on_axis(e.effect, e.axis))}</b>")
    others = []
    for item in e.alternatives:
        effect = str(item.get("effect", ""))
        what = OTHERWISE.get(effect) or on_axis(effect, item.get("axis"))
        p = item.get("probability", 0.0)
        others.append(f"{what}{f' ({p:.0%})' if p > 0.0 else ''}: {item.get('why', '')}")
    other = Html("".join(f'<div class="sub">{escape(x)}</div>' for x in others) or "no other came close")
    return [name, explanation(e.effect), chip(f"{e.confidence:.0%}", kind), other]


def _numbers(e: Found) -> list[Block]:
    """Return the size of a cause and what it changes in the model."""
    values = [f"{k} = {v:.4g}" for k, v in (*e.shape.items(), *e.theta.items())]
    if len(values) > 12:
        values = [*values[:12], "…"]
    out: list[Block] = []
    if values:
        out.append(paragraph(f"{_capital(on_axis(e.effect, e.axis))}, in SI: {', '.join(values)}."))
    if e.moves:
        out.append(
            paragraph(
                "With it, these numbers of the model change; the last column is the "
                "change over the uncertainty that the number had:"
            )
        )
        rows = [(k, f"{a:.4g}", f"{b:.4g}", f"{s:+.3g}") for k, (a, b, s) in e.moves.items()]
        out.append(table(("number", "before", "with the cause", "change"), rows, numeric=(1, 2, 3)))
    return out


def how_far_blocks(d: Diagnosis) -> list[Block]:
    """Return the bars of every axis, and each cause's own share."""
    rotary = rotary_axes(d)
    plots: list[Block] = []
    for axis in sorted(d.gap, key=lambda a: a not in d.unexplained):
        for signal, gap in d.gap[axis].items():
            found = d.shrink.get(axis, {}).get(signal) if axis in d.unexplained else None
            figure = shrink_figure(bars(gap, found), signal, rotary.get(axis, False))
            plots.append(
                Plot(
                    figure,
                    f"Axis {axis}, {SIGNALS.get(signal, signal)}",
                    ""
                    if found
                    else "No gap beyond the noise that a cause could close."
                    if axis not in d.unexplained
                    else "",
                )
            )
    rows = []
    for e in d.effects:
        for signal, x in e.shrink.items():
            scale = signal_scale(signal, rotary.get(e.axis or "", False), x.before)
            rows.append(
                [
                    on_axis(e.effect, e.axis),
                    f"{x.before * scale.factor:.3g} {scale.unit}",
                    f"{x.after * scale.factor:.3g} {scale.unit}",
                    display.percent(x.share),
                    f"{x.interval[0]:.0%} to {x.interval[1]:.0%}",
                    display.percent(x.promised),
                    "validation log" if x.on == "validation" else "stretches kept back in turn",
                ]
            )
    out: list[Block] = [Group(tuple(plots))] if plots else []
    if rows:
        out += [
            heading("Each cause on its own"),
            table(
                ("cause", "gap before", "gap after", "removed", "90 % interval", "promised", "judged on"),
                rows,
                numeric=(1, 2, 3, 4, 5),
            ),
            paragraph("Removed: share of the squared gap above the noise floor.", "lead"),
        ]
    stays = [f"Axis {a}: {plain_sentence(w)}" for a, w in d.remains.items()]
    if stays:
        out += [heading("What stays"), notes(stays)]
    return out


def next_blocks(d: Diagnosis) -> list[Block]:
    """Return what to do next."""
    lines = [_capital(plain_sentence(text)) for text in d.advice]
    if d.effects:
        names = joined([on_axis(e.effect, e.axis) for e in d.effects])
        lines.insert(
            0,
            f"Look at the machine for {names}; if it is real, add it to the model (the "
            "folder “machine” beside this page holds the extended machine) and identify "
            "again.",
        )
    if d.verdict == "none":
        lines.insert(0, "Nothing needs mending. Keep this log: it is the reference for later ones.")
    out: list[Block] = [bullets(lines or ["Record the motion again to confirm the finding."])]
    if d.warnings:
        out += [paragraph("What makes these logs doubtful:"), bullets([_capital(x) for x in d.warnings])]
    if d.commands:
        out.append(
            paragraph(
                "Motions to record, as command files beside this page: "
                f"{', '.join(d.commands)}. They stay within the travel and the speed "
                "of the log; check them against the machine's limits first."
            )
        )
    return out


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
