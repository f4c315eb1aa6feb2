"""What a person reads first, and what stays open on every axis: every signal counts."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.conclusion.sizes import change_text
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.grade import OPEN, grade, stays
from pinotwin.diagnosis.phrases import effect_words
from pinotwin.diagnosis.result import Diagnosis, Found, Gap
from pinotwin.diagnosis.rules import RULES
from pinotwin.system.phrases import JUDGED, SIGNALS, capital, joined


def judge(
    c: Comparison,
    patterns: Mapping[str, str],
    gaps: Mapping[str, Mapping[str, Gap]],
    effects: Sequence[Found],
    possible: Sequence[Found] = (),
) -> tuple[str, dict[str, dict[str, float]], list[str]]:
    """Return the sentence, axis -> signal -> share [1] that stays open, and notes; ``patterns``: what that follows."""
    judged = {axis: row for axis, row in gaps.items() if axis not in c.gate.silent}
    open_axes = {axis: row["u"] for axis, row in judged.items() if row["u"].is_open()}
    told = {axis for e in effects for axis in _axes(e)}
    known = gaps.keys() - told
    unsure = [axis for e in possible for axis in _axes(e) & known if not _agrees(gaps[axis]["u"])]
    left = (*open_axes, *patterns, *unsure, *(name for name in c.gate.silent if name in gaps))
    ratio = {axis: gaps[axis]["u"].after / max(gaps[axis]["u"].rms, 1e-300) for axis in left}
    unexplained = {axis: {"u": float(np.clip(x**2, 0.0, 1.0))} for axis, x in ratio.items()}
    notes = [
        f"{axis}: the residual is {row['u'].after / row['u'].expected:.1f} times the twin's expected error, and "
        "no single cause explains it. This motion may lie outside the data of the twin"
        for axis, row in judged.items()
        if _odd(row["u"]) and axis not in unexplained
    ]
    runs = [] if c.apart is None else [c.apart.words(change=c.change)]
    still = {axis: row for axis, row in judged.items() if axis in unexplained}
    first = _sentence(c, effects, unexplained, still or judged, patterns)
    sentence = ". ".join([*first, *unsure_words(possible), *runs, *unjudged(c, told)])
    return sentence, unexplained, notes


def _axes(e: Found) -> set[str]:
    """Return the axis of an effect, and those that it acts on: a load on one link weighs on others."""
    return {str(e.axis), *e.acts}


def _agrees(g: Gap) -> bool:
    """Whether the gap of an axis, before any cause, is no more than what is left anyway."""
    return grade(g.rms, g.expected, g.noise) in ("agrees", "within misfit")


def _quiet(g: Gap) -> bool:
    """Whether what a gap was, and what is left of it, is what the model leaves anyway, or noise."""
    if np.isfinite(g.misfit):
        return not _odd(g)
    return grade(g.rms, None, g.noise) == "agrees"


def _odd(g: Gap) -> bool:
    return bool(np.isfinite(g.misfit) and g.after > RULES.odd * g.level)


def unjudged(c: Comparison, told: Collection[str]) -> list[str]:
    """Return what is said of axes that are not judged, and of effects that these logs cannot show."""
    silent = {**c.gate.silent, **c.gate.unknown}
    out = [
        f"{axis} is not judged: {why.partition('; ')[0]}" for axis, why in silent.items() if axis not in told
    ]
    spoilt: dict[str, list[str]] = {}
    for axis in [x for x in c.gate.nameless if x not in told]:
        spoilt.setdefault(c.gate.nameless[axis].partition("; ")[0].partition(": ")[0], []).append(axis)
    out += [f"No cause is named on {', '.join(axes)}: {why}" for why, axes in spoilt.items()]
    astray = [x for x in c.gate.strays if x not in told and not c.gate.asks("tracking", x)]
    out += [f"{x} does not follow its command: check the unit, sign and axis of the command" for x in astray]
    barred = {axis: row for axis, row in c.gate.effects.items() if axis not in c.gate.nameless}
    if barred:
        names = list(dict.fromkeys(name for row in barred.values() for name in row))
        axes = "" if set(barred) == set(c.machine.axes) else f" on {', '.join(barred)}"
        out.append(f"These logs cannot show {joined([effect_words(x) for x in names])}{axes}")
    return out


def _sentence(
    c: Comparison,
    effects: Sequence[Found],
    unexplained: Collection[str],
    gaps: Mapping[str, Mapping[str, Gap]],
    patterns: Mapping[str, str],
) -> list[str]:
    if not gaps:
        return [] if c.gate.silent else ["No axis moves enough to be judged"]
    if not effects and not unexplained:
        if c.change:
            return ["No change found: the residual is no larger than on the twin's own data"]
        return ["No missing effect found in these logs"]
    parts = [said(e) for e in effects]
    text = "; ".join(parts[:4]) + (f"; and {len(parts) - 4} more" if len(parts) > 4 else "")
    loud = [a for a, row in gaps.items() if a in patterns or not _quiet(row["u"])]
    size = {a: g.rms / g.expected if g.expected > 0.0 else g.nrmse for a in loud for g in [gaps[a]["u"]]}
    largest = max(loud, key=lambda a: size[a], default="")
    asked = largest and (effects or not c.gate.silent or gaps[largest]["u"].is_open())
    if asked and not any(largest in _axes(e) for e in effects):
        share = f"{gaps[largest]['u'].nrmse:.1%} of its effort"
        text += ("; " if text else "") + f"no known effect explains the residual of {largest} ({share})"
        text += f"; it {patterns[largest]}" if largest in patterns else ""
    if effects:
        part = " in part" if unexplained else ""
        text = (f"has changed{part}: " if c.change else f"the model misses{part} ") + text
    return [capital(text)] if text else []


def said(e: Found) -> str:
    """Return an effect with size and share: ``Y viscous friction from 51 to 297 N·s/m (90 %: ...), explains ...``."""
    what, shrink = f"{e.axis or ''} {effect_words(e.effect)}".strip(), next(iter(e.shrink.values()), None)
    explains = [] if shrink is None else [f"explains {max(shrink.share, 0.0):.0%} of the variance"]
    return ", ".join([what + change_text(e), *explains, f"confidence {e.confidence:.0%}"])


def unsure_words(possible: Sequence[Found]) -> list[str]:
    """Return the causes that are too unsure to be named, in one sentence; none without any."""
    return [JUDGED["possible"].format(causes="; ".join(map(said, possible)))] if possible else []


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
    unexplained = {axis: dict(row) for axis, row in found.unexplained.items()}
    for axis, signal in off:
        g = found.gap[axis][signal]
        unexplained.setdefault(axis, {})[signal] = min((g.after / g.rms) ** 2, 1.0)
    parts = [] if found.recording else [_left_open(*at, x, found) for at, x in off.items()]
    told = [found.sentence, *parts]
    if found.verdict == "none":  # that nothing was found stands first, and does not hold
        told = [*parts, *found.sentence.split(". ")[1:]]
    return replace(found, sentence=". ".join(told), unexplained=unexplained)


def _left_open(axis: str, signal: str, times: float, found: Diagnosis) -> str:
    known = math.isfinite(found.gap[axis][signal].misfit)
    if signal == "e" and found.grade(axis, signal) == "not explained" and not found.effects:
        return (
            f"{axis} follows its command unlike its twin: the tracking error is {times:.1f} times the validation "
            "error, although the effort agrees. Check its controller and its command shaping"
        )
    size = f"{times:.3g} times the twin's expected error" if known else f"{times:.1%} of the signal"
    word = "partly" if found.grade(axis, signal) == "partly explained" else "not"
    return f"The {SIGNALS[signal]} of {axis} is {word} explained: {size} remains"
