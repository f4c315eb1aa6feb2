"""A scored bench: as plain types for JSON and for the page, and as Markdown."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.bench.answers import Answer
from pinotwin.bench.scoring import VISIBLE, Bound, Row, confidence, rows
from pinotwin.bench.statistics import Calibration

STATES = {"aim": "aim reached", "must": "must reached", "below": "MISSED", "": ""}


@dataclass(frozen=True)
class Bench:
    """A scored bench."""

    answers: Sequence[Answer]  # what was said
    planned: int  # cases that were to be run

    @property
    def visible(self) -> list[Answer]:
        """Singles that must be named."""
        return [a for a in self.answers if a.kind == "single" and a.size >= VISIBLE]

    def rows(self) -> list[Row]:
        """Return the table of scores."""
        return rows(self.answers)

    def calibration(self) -> Calibration | None:
        """Return the calibration of all first answers."""
        return confidence(self.answers)

    def seconds(self) -> dict[str, float]:
        """Return the mean time of every stage of a case [s]."""
        names = sorted({k for a in self.answers for k in a.seconds})
        return {n: float(np.mean([a.seconds[n] for a in self.answers if n in a.seconds])) for n in names}

    def kinds(self) -> dict[str, int]:
        """Return how many cases of each kind were answered."""
        names = sorted({a.kind for a in self.answers})
        return {k: sum(a.kind == k for a in self.answers) for k in names}

    def document(self) -> dict[str, Any]:
        """Return everything, for JSON and for the page."""
        found = self.calibration()
        return {
            "cases": self.kinds(),
            "planned": self.planned,
            "machines": sorted({a.machine for a in self.answers}),
            "scores": [_plain_row(row) for row in self.rows()],
            "calibration": None if found is None else dataclasses.asdict(found),
            "confusion": measured(self.visible),
            "seconds": self.seconds(),
            "errors": [{"case": a.number, "error": a.error} for a in self.answers if a.error],
            "answers": [{**dataclasses.asdict(a), "is_right": a.right()} for a in self.answers],
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


def markdown(bench: Bench) -> str:
    """Return the whole table as Markdown."""
    kinds = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in bench.kinds().items())
    out = ["# The withheld bench", "", f"{len(bench.answers)} of {bench.planned} cases: {kinds}.", ""]
    body = [
        (r.name, shown(r), counts(r), *(shown_bound(b, r.kind) for b in (r.must, r.aim)), STATES[r.state])
        for r in bench.rows()
    ]
    out += _table(("score", "figure", "counts", "must", "aim", ""), body)
    answers = [(true, _counts(row)) for true, row in measured(bench.visible).items()]
    out += ["", "## Confusion, singles with rho ≥ 0.1", "", *_table(("true effect", "answers"), answers)]
    times = ", ".join(f"{k} {v:.1f} s" for k, v in bench.seconds().items())
    return "\n".join([*out, "", f"Mean time of a case: {times}.", ""])


def _counts(row: dict[str, float]) -> str:
    return ", ".join(f"{k} {v:g}" for k, v in sorted(row.items(), key=lambda x: -x[1]))


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
