"""A scored bench: as plain types for JSON and for the page, and as Markdown."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.bench.answers import Answer
from pinotwin.bench.scoring import VISIBLE, Bound, Row, confidence, rows

STATES = {"aim": "aim reached", "must": "must reached", "below": "MISSED", "": ""}


def document(answers: Sequence[Answer], planned: int) -> dict[str, Any]:
    """Return what was said of so many planned cases, scored, for JSON, the page and Markdown."""
    found = confidence(answers)
    stages = sorted({k for a in answers for k in a.seconds})
    return {
        "cases": dict(sorted(Counter(a.kind for a in answers).items())),
        "planned": planned,
        "machines": sorted({a.machine for a in answers}),
        "scores": [_plain_row(row) for row in rows(answers)],
        "calibration": None if found is None else dataclasses.asdict(found),
        "confusion": measured([a for a in answers if a.kind == "single" and a.size >= VISIBLE]),
        "seconds": {k: float(np.mean([a.seconds[k] for a in answers if k in a.seconds])) for k in stages},
        "errors": [{"case": a.number, "error": a.error} for a in answers if a.error],
        "answers": [{**dataclasses.asdict(a), "is_right": a.right()} for a in answers],
    }


def measured(singles: Sequence[Answer]) -> dict[str, dict[str, float]]:
    """Return true effect -> answer -> count; an answer that names none is its verdict."""
    out: dict[str, Counter[str]] = {}
    for a in singles:
        out.setdefault(a.truth[0][0], Counter())[said(a)] += 1
    return {true: dict(row) for true, row in sorted(out.items())}


def said(a: Answer) -> str:
    """Return the first answer as the matrix names it."""
    if not a.named:
        return a.verdict
    effect, axis, _ = a.named[0]
    true = a.truth[0]
    return f"{effect} (other axis)" if effect == true[0] and axis != true[1] and not a.right() else effect


def _plain_row(row: Row) -> dict[str, Any]:
    bounds = {"must": shown_bound(row.must, row.kind), "aim": shown_bound(row.aim, row.kind)}
    texts = {"figure": shown(row), "counts": counts(row)}
    return {**dataclasses.asdict(row), **bounds, **texts, "state": row.state}


def markdown(d: Mapping[str, Any]) -> str:
    """Return the whole table of a :func:`document` as Markdown."""
    kinds = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in d["cases"].items())
    out = ["# The withheld bench", "", f"{len(d['answers'])} of {d['planned']} cases: {kinds}.", ""]
    columns = ("name", "figure", "counts", "must", "aim")
    body = [[*(r[k] for k in columns), STATES[r["state"]]] for r in d["scores"]]
    out += _table(("score", "figure", "counts", "must", "aim", ""), body)
    most = {true: sorted(row.items(), key=lambda x: -x[1]) for true, row in d["confusion"].items()}
    answers = [(true, ", ".join(f"{k} {v:g}" for k, v in row)) for true, row in most.items()]
    out += ["", "## Confusion, singles with rho ≥ 0.1", "", *_table(("true effect", "answers"), answers)]
    times = ", ".join(f"{k} {v:.1f} s" for k, v in d["seconds"].items())
    return "\n".join([*out, "", f"Mean time of a case: {times}.", ""])


def _table(header: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in body)]


def shown(row: Row) -> str:
    """Return the figure of a row."""
    if row.value is None:
        return "–"
    return f"{row.value:.1%}" if row.kind == "share" else f"{row.value:.3f}"


def counts(row: Row) -> str:
    """Return the counts behind a row."""
    return f"{row.share.hits}/{row.share.of}" if row.share is not None else f"N = {row.count}"


def shown_bound(bound: Bound | None, kind: str) -> str:
    """Return a bound in words."""
    if bound is None:
        return ""
    form = "{:.0%}" if kind == "share" else "{:g}"
    low, high = form.format(bound.low), form.format(bound.high)
    if not np.isfinite(bound.low):
        return f"≤ {high}"
    return f"≥ {low}" if not np.isfinite(bound.high) else f"{low} to {high}"
