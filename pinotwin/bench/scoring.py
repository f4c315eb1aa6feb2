"""Scores of a bench: every row of the promised table, with counts, and what must and what should hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinotwin.bench.answers import Answer
from pinotwin.bench.statistics import Calibration, Share, calibration

VISIBLE, FAINT, STRONG = 0.1, 0.02, 0.5
"""rho above which an effect must be named; may be missed; must also shrink the residual."""


@dataclass(frozen=True)
class Bound:
    """Smallest and largest value of a figure that are good."""

    low: float = -np.inf
    high: float = np.inf

    def holds(self, value: float | None) -> bool | None:
        """Whether a value is within; None for no value."""
        return None if value is None else self.low <= value <= self.high


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str  # what is counted
    value: float | None  # figure, None if no case tells
    must: Bound | None = None  # what must hold; None for a line that stands beside another
    aim: Bound | None = None  # what should hold
    share: Share | None = None  # counts behind the figure, where it is a share
    count: int = 0  # answers behind it
    kind: Literal["share", "number"] = "share"  # share (in percent), or number
    note: str = ""  # how it is counted

    @property
    def state(self) -> str:
        """``aim``, ``must``, ``below`` (not what must hold); empty for no bound or no figure."""
        if self.must is None or self.value is None:
            return ""
        if self.aim is not None and self.aim.holds(self.value):
            return "aim"
        return "must" if self.must.holds(self.value) else "below"


def rows(answers: Sequence[Answer]) -> list[Row]:
    """Return the table of scores; cases whose diagnosis broke off count as wrong."""
    single = [a for a in answers if a.kind == "single"]
    visible = [a for a in single if a.size >= VISIBLE]
    return [
        *healthy_rows([a for a in answers if a.kind == "healthy"]),
        *top_rows(single, visible),
        *size_rows(visible, [a for a in answers if a.kind == "form" and a.size >= VISIBLE]),
        *set_rows([a for a in visible if a.named]),
        *several_rows([a for a in answers if a.kind == "double"], visible),
        *unknown_rows([a for a in answers if a.kind in ("outside", "left_out")], visible),
        *confidence_rows(answers),
        *shrink_rows([a for a in single if a.right() and a.shrink is not None]),
    ]


def _share(
    name: str, answers: Sequence[Answer], holds: Callable[[Answer], bool], *bounds: Bound, note: str = ""
) -> Row:
    """Return the line of how many of some answers something holds for; ``bounds``: what must and what should hold."""
    share = Share.over([holds(a) for a in answers])
    must, aim = bounds or (None, None)
    return Row(name, share.value, must, aim, share, share.of, note=note)


def _median(name: str, values: Sequence[float], must: Bound, aim: Bound, note: str = "") -> Row:
    """Return the line of the median of some values."""
    value = float(np.median(values)) if values else None
    return Row(name, value, must, aim, count=len(values), kind="number", note=note)


def healthy_rows(healthy: Sequence[Answer]) -> list[Row]:
    """Return how often a healthy machine is accused."""
    accused = Share.over([a.accused for a in healthy])
    most = f"at most {accused.upper():.0%} with 95 % confidence" if healthy else ""
    of = {s: [a for a in healthy if a.situation == s] for s in ("structure", "change")}
    return [
        _share(
            "healthy machine accused of anything",
            healthy,
            lambda a: a.accused,
            Bound(high=0.05),
            Bound(high=0.02),
            note=f"any verdict but none; {most}",
        ),
        _share("… an effect named", healthy, lambda a: bool(a.named)),
        *(_share(f"… in situation {s}", x, lambda a: a.accused) for s, x in of.items()),
    ]


def top_rows(single: Sequence[Answer], visible: Sequence[Answer]) -> list[Row]:
    """Return how often the first answer is right."""
    faint = [a for a in single if FAINT <= a.size < VISIBLE]
    merged = "classes merged as physics and the diagnosis say"
    moves = "their true course moves the effort by what the rules ask for, beside the model"
    return [
        _share(
            "top-1 effect and axis, rho ≥ 0.1", visible, Answer.right, Bound(0.85), Bound(0.95), note=merged
        ),
        _share("… unmerged, rho ≥ 0.1", visible, lambda a: a.right(strict=True)),
        _share(
            "… of those that an oracle sees while the axis moves", _seen(visible), Answer.right, note=moves
        ),
        _share("… among the first two", visible, lambda a: a.right() or a.right(1)),
        _share(
            "… axis right",
            [a for a in visible if a.named],
            lambda a: a.named[0][1] == a.truth[0][1] or a.right(),
            note="of those named; a load on any axis",
        ),
        _share("top-1, 0.02 ≤ rho < 0.1", faint, Answer.right, Bound(0.60), Bound(0.75)),
    ]


def size_rows(visible: Sequence[Answer], forms: Sequence[Answer]) -> list[Row]:
    """Return how often the first answer is right, by size of the effect and in another form of it."""
    sizes = {"0.1 ≤ rho < 0.5": (0.1, 0.5), "0.5 ≤ rho < 3": (0.5, 3.0), "rho ≥ 3": (3.0, np.inf)}
    of = {name: [a for a in visible if low <= a.size < high] for name, (low, high) in sizes.items()}
    return [
        *(_share(f"… {name}", some, Answer.right) for name, some in of.items()),
        _share("top-1, rho ≥ 0.1, another functional form", forms, Answer.right),
    ]


def _seen(answers: Sequence[Answer], least: float = 1.0) -> list[Answer]:
    """Return those of which an oracle sees every effect, at ``least`` so well; it sees no controller's own."""
    return [a for a in answers if a.oracle is None or a.oracle >= least]


def set_rows(named: Sequence[Answer]) -> list[Row]:
    """Return whether the stated sets hold the truth, and how large they are."""
    mean = float(np.mean([len(a.stated) for a in named])) if named else None
    most = Bound(high=2.5), Bound(high=1.5)
    return [
        _share(
            "truth in the stated 90 % set",
            named,
            lambda a: any(a.agrees(s, a.truth[0]) for s in a.stated),
            Bound(0.85, 0.95),
            Bound(0.87, 0.93),
            note="of singles with rho ≥ 0.1 where anything was named",
        ),
        Row("mean size of that set", mean, *most, count=len(named), kind="number"),
    ]


def several_rows(double: Sequence[Answer], visible: Sequence[Answer]) -> list[Row]:
    """Return how often both of two are found, and how often one too many is named."""
    strong = [a for a in double if a.weaker >= VISIBLE]
    return [
        _share("both of two, weaker rho ≥ 0.1", strong, lambda a: _found(a) == 2, Bound(0.65), Bound(0.80)),
        _share("… of those of which an oracle sees both", _seen(strong), lambda a: _found(a) == 2),
        _share("… at least one of them", strong, lambda a: _found(a) >= 1),
        _share(
            "a spurious extra effect beside the right one",
            [a for a in visible if a.right()],
            lambda a: any(not a.agrees(n[:2], a.truth[0]) for n in a.named),
            Bound(high=0.15),
            Bound(high=0.05),
        ),
    ]


def _found(a: Answer) -> int:
    return sum(any(a.agrees(n[:2], true) for n in a.named) for true in a.truth)


def unknown_rows(outside: Sequence[Answer], visible: Sequence[Answer]) -> list[Row]:
    """Return how well effects outside the catalogue are told from known ones."""
    seen = [a for a in outside if a.size >= VISIBLE]
    of = {k: [a for a in seen if a.kind == k] for k in ("outside", "left_out")}
    note = "rho ≥ 0.1; verdict unexplained or partly explained"
    most = Bound(high=0.10), Bound(high=0.05)
    return [
        _share(
            "outside the catalogue recognised", seen, lambda a: a.flagged, Bound(0.85), Bound(0.95), note=note
        ),
        _share("… of those unknown ones that an oracle sees", _seen(seen), lambda a: a.flagged),
        _share("… nobody's effect", of["outside"], lambda a: a.flagged),
        _share("… effect taken out of the catalogue", of["left_out"], lambda a: a.flagged),
        _share("known called unknown", visible, lambda a: a.flagged, *most, note="the same verdicts"),
        _share("known called none", visible, lambda a: a.verdict == "none" and not a.named),
    ]


def confidence(answers: Sequence[Answer]) -> Calibration | None:
    """Return the calibration of the first answer, over all cases in which anything was named."""
    named = [a for a in answers if a.named]
    known = [a.kind not in ("outside", "left_out", "healthy") for a in named]  # else any name is wrong
    right = [
        k and any(a.agrees(a.named[0][:2], t) for t in a.truth) for k, a in zip(known, named, strict=True)
    ]
    return calibration([a.named[0][2] for a in named], right)


def confidence_rows(answers: Sequence[Answer]) -> list[Row]:
    """Return the calibration of the first answer."""
    found, count = confidence(answers), sum(bool(a.named) for a in answers)
    error, brier = (None, None) if found is None else (found.error, found.brier)
    note, most = "ten bins of equal mass, all kinds of cases", (Bound(high=0.08), Bound(high=0.04))
    return [
        Row("expected calibration error", error, *most, count=count, kind="number", note=note),
        Row("Brier score", brier, count=count, kind="number"),
    ]


def shrink_rows(right: Sequence[Answer]) -> list[Row]:
    """Return expected against achieved reduction, where the first answer is right."""
    strong = [a for a in right if a.size >= STRONG]
    off = [abs(_shrink(a, "promised") - _shrink(a, "delivered")) for a in right]
    delivered = [_shrink(a, "delivered") for a in strong]
    name, least = "achieved reduction when right, rho ≥ 0.5, median", (Bound(0.85), Bound(0.95))
    within = Bound(high=0.07), Bound(high=0.03)
    return [
        _median("expected against achieved reduction, median difference", off, *within),
        _share("… 90 % interval covers", right, _covers, Bound(0.80, 0.97), Bound(0.87, 0.93)),
        _median(name, delivered, *least, note="on the validation log"),
        _share("… at least 0.85", strong, lambda a: _shrink(a, "delivered") >= 0.85),
    ]


def _shrink(a: Answer, what: str) -> float:
    return float((a.shrink or {})[what])


def _covers(a: Answer) -> bool:
    """Whether the promise lies within the interval of what was delivered."""
    low, high = (a.shrink or {})["interval"]
    return bool(low <= _shrink(a, "promised") <= high)
