"""Scores of a bench: every row of the promised table, with counts, and what must and what should hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinotwin.bench.answers import Answer
from pinotwin.bench.statistics import Calibration, Share, calibration

VISIBLE, FAINT, STRONG = 0.1, 0.02, 0.5
"""rho above which an effect must be named; may be missed; must also shrink the gap."""
ORACLE = 1.0
"""[of the least that the rules ask for] Below it not even the true course of an effect is named."""


@dataclass(frozen=True)
class Bound:
    """What a figure must reach.

    Attributes:
        low: smallest good value.
        high: largest good value.
    """

    low: float = -np.inf
    high: float = np.inf

    def holds(self, value: float | None) -> bool | None:
        """Whether a value is within; None for no value."""
        return None if value is None else self.low <= value <= self.high


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: what is counted.
        value: figure, None if no case tells.
        must: what must hold; None for a line that stands beside another.
        aim: what should hold.
        share: counts behind the figure, where it is a share.
        count: answers behind it.
        kind: ``share`` (in percent), or ``number``.
        note: how it is counted.
    """

    name: str
    value: float | None
    must: Bound | None = None
    aim: Bound | None = None
    share: Share | None = None
    count: int = 0
    kind: Literal["share", "number"] = "share"
    note: str = ""

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
        *top_rows(single, [a for a in answers if a.kind == "form" and a.size >= VISIBLE]),
        *set_rows([a for a in visible if a.named]),
        *several_rows([a for a in answers if a.kind == "double"], visible),
        *unknown_rows([a for a in answers if a.kind in ("outside", "left_out")], visible),
        *confidence_rows(answers),
        *shrink_rows([a for a in single if a.right() and a.shrink is not None]),
    ]


def _line(
    name: str, flags: Sequence[bool], must: Bound | None = None, aim: Bound | None = None, note: str = ""
) -> Row:
    share = Share.over(flags)
    return Row(name, share.value, must, aim, share, share.of, note=note)


def healthy_rows(healthy: Sequence[Answer]) -> list[Row]:
    """Return how often a healthy machine is accused."""
    accused = [a.accused for a in healthy]
    share = Share.over(accused)
    bound = f"at most {share.upper():.0%} with 95 % confidence" if healthy else ""
    of = {s: [a for a in healthy if a.situation == s] for s in ("structure", "change")}
    form = [a.form for a in of["structure"]]
    return [
        _line(
            "healthy machine accused of anything",
            accused,
            Bound(high=0.05),
            Bound(high=0.02),
            f"any verdict but none; {bound}",
        ),
        _line("… an effect named", [bool(a.named) for a in healthy]),
        *(_line(f"… in situation {s}", [a.accused for a in x]) for s, x in of.items()),
        Row(
            "… what the laws cannot follow of a healthy machine, median rho",
            _median(form),
            count=len(form),
            kind="number",
            note="situation structure, at their true shapes",
        ),
    ]


def top_rows(single: Sequence[Answer], forms: Sequence[Answer]) -> list[Row]:
    """Return how often the first answer is right, by size of the gap."""
    visible = [a for a in single if a.size >= VISIBLE]
    faint = [a for a in single if FAINT <= a.size < VISIBLE]
    seen = [a for a in visible if _seen(a)]
    wider = [a for a in single if max(a.raw, default=0.0) >= VISIBLE]
    out = [
        _line(
            "top-1 effect and axis, rho ≥ 0.1",
            _right(visible),
            Bound(0.85),
            Bound(0.95),
            "classes merged as physics and the diagnosis say",
        ),
        _line("… unmerged, rho ≥ 0.1", [a.right(strict=True) for a in visible]),
        _line("… rho ≥ 0.1 before the model took up its part", _right(wider)),
        _line(
            "… of those that an oracle sees while the axis moves",
            _right(seen),
            note="their true course moves the effort by what the rules ask for, beside the model",
        ),
        _line("… of the others", _right([a for a in visible if a not in seen])),
        _line("… among the first two", [a.right() or a.right(1) for a in visible]),
        _line(
            "… axis right", [_axis(a) for a in visible if a.named], note="of those named; a load on any axis"
        ),
        _line("top-1, 0.02 ≤ rho < 0.1", _right(faint), Bound(0.60), Bound(0.75)),
        _line("… of those faint ones that an oracle sees", _right([a for a in faint if _seen(a)])),
    ]
    for low, high in ((0.1, 0.5), (0.5, 3.0), (3.0, np.inf)):
        name = f"… {low:g} ≤ rho < {high:g}" if np.isfinite(high) else f"… rho ≥ {low:g}"
        out.append(_line(name, _right([a for a in visible if low <= a.size < high])))
    return [*out, _line("top-1, rho ≥ 0.1, another functional form", _right(forms))]


def _right(answers: Sequence[Answer]) -> list[bool]:
    return [a.right() for a in answers]


def _seen(a: Answer) -> bool:
    """Whether an oracle sees every effect of a case (of the controller's own: it does not look)."""
    return a.oracle is None or a.oracle >= ORACLE


def _axis(a: Answer) -> bool:
    return a.named[0][1] == a.truth[0][1] or a.right()


def set_rows(named: Sequence[Answer]) -> list[Row]:
    """Return whether the stated sets hold the truth, and how large they are."""
    sizes = [len(a.stated) for a in named]
    mean = float(np.mean(sizes)) if sizes else None
    inside = [any(a.agrees(s, a.truth[0]) for s in a.stated) for a in named]
    return [
        _line(
            "truth in the stated 90 % set",
            inside,
            Bound(0.85, 0.95),
            Bound(0.87, 0.93),
            "of singles with rho ≥ 0.1 where anything was named",
        ),
        Row("mean size of that set", mean, Bound(high=2.5), Bound(high=1.5), count=len(sizes), kind="number"),
    ]


def several_rows(double: Sequence[Answer], visible: Sequence[Answer]) -> list[Row]:
    """Return how often both of two are found, and how often one too many is named."""
    strong = [a for a in double if a.weaker >= VISIBLE]
    right = [a for a in visible if a.right()]
    extra = [any(not a.agrees(n[:2], a.truth[0]) for n in a.named) for a in right]
    return [
        _line("both of two, weaker rho ≥ 0.1", [_found(a) == 2 for a in strong], Bound(0.65), Bound(0.80)),
        _line("… of those of which an oracle sees both", [_found(a) == 2 for a in strong if _seen(a)]),
        _line("… at least one of them", [_found(a) >= 1 for a in strong]),
        _line("a spurious extra effect beside the right one", extra, Bound(high=0.15), Bound(high=0.05)),
    ]


def _found(a: Answer) -> int:
    return sum(any(a.agrees(n[:2], true) for n in a.named) for true in a.truth)


def unknown_rows(outside: Sequence[Answer], visible: Sequence[Answer]) -> list[Row]:
    """Return how well effects outside the catalogue are told from known ones."""
    seen = [a for a in outside if a.size >= VISIBLE]
    of = {k: [a for a in seen if a.kind == k] for k in ("outside", "left_out")}
    return [
        _line(
            "outside the catalogue recognised",
            [a.flagged for a in seen],
            Bound(0.85),
            Bound(0.95),
            "rho ≥ 0.1; verdict unexplained or partly explained",
        ),
        _line("… of those unknown ones that an oracle sees", [a.flagged for a in seen if _seen(a)]),
        _line("… nobody's effect", [a.flagged for a in of["outside"]]),
        _line("… effect taken out of the catalogue", [a.flagged for a in of["left_out"]]),
        _line("… and nothing named", [a.flagged and not a.named for a in seen]),
        _line(
            "known called unknown",
            [a.flagged for a in visible],
            Bound(high=0.10),
            Bound(high=0.05),
            "the same verdicts",
        ),
        _line("… unexplained, nothing named", [a.verdict == "unexplained" and not a.named for a in visible]),
        _line("known called none", [a.verdict == "none" and not a.named for a in visible]),
    ]


def confidence(answers: Sequence[Answer]) -> Calibration | None:
    """Return the calibration of the first answer, over all cases in which anything was named."""
    named = [a for a in answers if a.named]
    right = [any(a.agrees(a.named[0][:2], t) for t in a.truth) and a.kind not in _NOBODY for a in named]
    return calibration([a.named[0][2] for a in named], right)


_NOBODY = ("outside", "left_out", "healthy")  # whatever is named there is wrong


def confidence_rows(answers: Sequence[Answer]) -> list[Row]:
    """Return the calibration of the first answer."""
    found, count = confidence(answers), sum(bool(a.named) for a in answers)
    error, brier = (None, None) if found is None else (found.error, found.brier)
    return [
        Row(
            "expected calibration error",
            error,
            Bound(high=0.08),
            Bound(high=0.04),
            count=count,
            kind="number",
            note="ten bins of equal mass, all kinds of cases",
        ),
        Row("Brier score", brier, count=count, kind="number"),
    ]


def shrink_rows(right: Sequence[Answer]) -> list[Row]:
    """Return expected against achieved reduction, where the first answer is right."""
    given = [a.shrink for a in right if a.shrink is not None]
    off = [abs(x["promised"] - x["delivered"]) for x in given]
    strong = [a.shrink["delivered"] for a in right if a.shrink is not None and a.size >= STRONG]
    return [
        Row(
            "expected against achieved reduction, median difference",
            _median(off),
            Bound(high=0.07),
            Bound(high=0.03),
            count=len(off),
            kind="number",
        ),
        _line("… 90 % interval covers", [_covers(x) for x in given], Bound(0.80, 0.97), Bound(0.87, 0.93)),
        Row(
            "achieved reduction when right, rho ≥ 0.5, median",
            _median(strong),
            Bound(0.85),
            Bound(0.95),
            count=len(strong),
            kind="number",
            note="on the validation log",
        ),
        _line("… at least 0.85", [x >= 0.85 for x in strong]),
    ]


def _covers(x) -> bool:  # type: ignore[no-untyped-def]
    """Whether promise and delivery meet: the promise's own interval if it has one, else delivery's."""
    own = x.get("promised_interval")
    low, high = own or x["interval"]
    return bool(low <= (x["delivered"] if own else x["promised"]) <= high)


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None
