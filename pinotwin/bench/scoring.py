"""Scores of a bench: what was put in against what was named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.diagnosis.advice import same_class

ABOUT_EQUAL = (
    frozenset({"ripple", "ripple_modulated", "position_table"}),
    frozenset({"payload", "inertial_coupling"}),
)
"""Effects of the truth that a finite log states only as a class (isolability)."""


@dataclass(frozen=True)
class Answer:
    """What was said about one case.

    Attributes:
        number: of the case.
        machine: machine.
        situation: structure or change.
        kind: healthy, single, double, outside.
        truth: (effect, axis, size) put in.
        rho: gap-to-noise power ratio of each axis' effort.
        verdict: verdict.
        named: (effect, axis, confidence), best first.
        sets: effects in the stated 90 % set of the first one, as (effect, axis).
        shrink: delivered share on validation of the first one, with its interval and promise.
        seconds: time that the diagnosis took [s].
        floors: answer of each floor, name -> (effect, axis).
    """

    number: int
    machine: str
    situation: str
    kind: str
    truth: tuple[tuple[str, str, float], ...]
    rho: dict[str, float]
    verdict: str
    named: tuple[tuple[str, str | None, float], ...]
    sets: tuple[tuple[str, str | None], ...]
    shrink: tuple[float, float, float, float] | None
    seconds: float
    floors: dict[str, tuple[str, str | None] | None]

    @property
    def size(self) -> float:
        """Largest gap-to-noise ratio over the axes."""
        return max(self.rho.values(), default=0.0)

    def right(self, k: int = 0, truth: int = 0) -> bool:
        """Whether the k-th named effect is a true one (its class, and its axis)."""
        return k < len(self.named) and agree(self.named[k][:2], self.truth[truth][:2])


def agree(said: tuple[str, str | None], true: tuple[str, str]) -> bool:
    """Whether an answer names the true effect, classes merged, on the true axis."""
    alike = any({said[0], true[0]} <= group for group in ABOUT_EQUAL)
    if not alike and not same_class(said[0], true[0]):
        return False
    return said[1] == true[1] or true[0] in ("payload", "inertial_coupling")


BINS = ((0.02, 0.1), (0.1, 0.5), (0.5, 3.0), (3.0, np.inf))


def score(answers: Sequence[Answer]) -> dict[str, Any]:
    """Return the table of scores."""
    healthy = [a for a in answers if a.kind == "healthy"]
    single = [a for a in answers if a.kind == "single"]
    double = [a for a in answers if a.kind == "double"]
    outside = [a for a in answers if a.kind == "outside"]
    visible = [a for a in single if a.size >= 0.1]
    right = [a for a in visible if a.right()]
    return {
        "healthy": {"cases": len(healthy), "false_alarms": _share([bool(a.named) for a in healthy]),
                    "unexplained": _share([a.verdict == "unexplained" for a in healthy])},
        "single": {
            "cases": len(single),
            "top1_rho_above_0.1": _share([a.right() for a in visible]),
            "top1_by_rho": {f"{lo:g}-{hi:g}": _bin(single, lo, hi) for lo, hi in BINS},
            "in_named": _share([any(a.right(k) for k in range(len(a.named))) for a in visible]),
            "truth_in_set": _share([any(agree(s, a.truth[0][:2]) for s in a.sets)
                                    for a in visible if a.named]),
            "mean_set": float(np.mean([float(len(a.sets)) for a in visible if a.named] or [np.nan])),
            "spurious_extra": _share([len(a.named) > 1 for a in right]),
            "called_unknown": _share([not a.named and a.verdict == "unexplained" for a in visible]),
            "called_none": _share([a.verdict == "none" for a in visible]),
        },
        "by_effect": {e: _effect([a for a in visible if a.truth[0][0] == e])
                      for e in sorted({a.truth[0][0] for a in visible})},
        "double": {"cases": len(double), "both": _share([_both(a) for a in double if a.size >= 0.1]),
                   "one": _share([_one(a) for a in double if a.size >= 0.1])},
        "outside": {"cases": len(outside),
                    "recognised": _share([a.verdict in ("unexplained", "partly_explained")
                                          for a in outside if a.size >= 0.1]),
                    "named_nothing": _share([not a.named for a in outside if a.size >= 0.1])},
        "calibration_error": calibration(visible),
        "shrink": _shrinks(right),
        "seconds": {"median": float(np.median([a.seconds for a in answers] or [np.nan]))},
        "floors": {name: _floor(answers, name) for name in _floors(answers)},
        "confusion": confusion(single),
    }  # fmt: skip


def _share(flags: Sequence[bool]) -> dict[str, float] | None:
    flags = list(flags)
    return {"share": float(np.mean(flags)), "of": len(flags)} if flags else None


def _bin(single: Sequence[Answer], low: float, high: float) -> dict[str, float] | None:
    return _share([a.right() for a in single if low <= a.size < high])


def _effect(answers: Sequence[Answer]) -> dict[str, float] | None:
    return _share([a.right() for a in answers])


def _both(a: Answer) -> bool:
    said = [n[:2] for n in a.named]
    return all(any(agree(s, t[:2]) for s in said) for t in a.truth)


def _one(a: Answer) -> bool:
    return any(agree(n[:2], t[:2]) for n in a.named for t in a.truth)


def calibration(answers: Sequence[Answer]) -> dict[str, Any] | None:
    """Return the expected calibration error of the first named effects."""
    pairs = [(a.named[0][2], a.right()) for a in answers if a.named]
    if len(pairs) < 10:
        return None
    pairs.sort()
    bins = np.array_split(np.array(pairs, dtype=float), min(10, len(pairs) // 5))
    rows = [(float(b[:, 0].mean()), float(b[:, 1].mean()), len(b)) for b in bins]
    error = sum(abs(c - r) * n for c, r, n in rows) / len(pairs)
    return {"ece": error, "bins": rows}


def _shrinks(answers: Sequence[Answer]) -> dict[str, Any] | None:
    rows = [a.shrink for a in answers if a.shrink is not None]
    if not rows:
        return None
    x = np.array(rows)
    strong = np.array([a.shrink[0] for a in answers if a.shrink is not None and a.size >= 0.5])
    return {
        "median_delivered_rho_above_0.5": float(np.median(strong)) if len(strong) else None,
        "median_difference": float(np.median(np.abs(x[:, 0] - x[:, 3]))),
    }


def _floors(answers: Sequence[Answer]) -> list[str]:
    return sorted({name for a in answers for name in a.floors})


def _floor(answers: Sequence[Answer], name: str) -> dict[str, Any]:
    healthy = [a for a in answers if a.kind == "healthy" and name in a.floors]
    visible = [a for a in answers if a.kind == "single" and a.size >= 0.1 and name in a.floors]
    hits = []
    for a in visible:
        said = a.floors[name]
        hits.append(said is not None and agree(said, a.truth[0][:2]))
    return {
        "false_alarms": _share([a.floors[name] is not None for a in healthy]),
        "top1_rho_above_0.1": _share(hits),
    }


def confusion(single: Sequence[Answer]) -> dict[str, dict[str, int]]:
    """Return true effect -> answer -> count, for gaps above a tenth of the noise power."""
    out: dict[str, Counter[str]] = {}
    for a in single:
        if a.size < 0.1:
            continue
        said = a.named[0][0] if a.named else a.verdict
        if a.named and a.named[0][0] == a.truth[0][0] and not a.right():
            said += " (other axis)"
        out.setdefault(a.truth[0][0], Counter())[said] += 1
    return {k: dict(v) for k, v in sorted(out.items())}
