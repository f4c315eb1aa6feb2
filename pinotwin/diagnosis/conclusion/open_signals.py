"""Signals that are open beside what the verdict was judged on: every signal counts."""

from __future__ import annotations

import math
from dataclasses import replace

from pinotwin.diagnosis.grade import OPEN, stays
from pinotwin.diagnosis.result import Diagnosis, Verdict
from pinotwin.system.phrases import SIGNALS


def with_open_signals(found: Diagnosis) -> Diagnosis:
    """Return the diagnosis with every signal left open that its grades call open, beside the verdict on the efforts."""
    off = {
        (axis, signal): stays(g.after, g.noise, g.expected, g.variation)
        for axis, row in found.gap.items()
        for signal, g in row.items()
        if signal not in found.unexplained.get(axis, {}) and found.grade(axis, signal) in OPEN
    }
    if not off:
        return found
    said = [_said(axis, signal, x, found) for (axis, signal), x in off.items()]
    unexplained = {axis: dict(row) for axis, row in found.unexplained.items()}
    for axis, signal in off:
        g = found.gap[axis][signal]
        unexplained.setdefault(axis, {})[signal] = min((g.after / g.rms) ** 2, 1.0)
    verdict: Verdict = "partly_explained" if found.effects else "unexplained"
    parts = [] if found.recording else said
    told = [found.sentence, *parts]
    if found.verdict == "none":  # that nothing was found stands first, and does not hold
        told = [*parts, *found.sentence.split(". ")[1:]]
    return replace(found, verdict=verdict, sentence=". ".join(told), unexplained=unexplained)


def _said(axis: str, signal: str, times: float, found: Diagnosis) -> str:
    known = math.isfinite(found.gap[axis][signal].misfit)
    if signal == "e" and found.grade(axis, signal) == "not explained" and not found.effects:
        return (
            f"{axis} follows its command unlike its twin: the tracking error is {times:.1f} times the validation "
            "error, although the effort agrees. Check its controller and its command shaping"
        )
    size = f"{times:.3g} times the twin's expected error" if known else f"{times:.1%} of the signal"
    word = "partly" if found.grade(axis, signal) == "partly explained" else "not"
    return f"the {SIGNALS[signal]} of {axis} is {word} explained: {size} remains"
