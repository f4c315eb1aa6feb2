"""The named effects with confidence, shrink, alternatives, and what they share with the base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.diagnosis.advice import CLASSES, same_class
from pinotwin.diagnosis.decide import Decision, Named, confidences
from pinotwin.diagnosis.gaps import Gaps
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.result import Found, Shrink
from pinotwin.diagnosis.search import Judged, admit
from pinotwin.diagnosis.shrinking import held_out, shrink
from pinotwin.twin.twin import effect_keys

SET = 0.9  # probability that the stated alternatives cover
Pairs = list[tuple[str, str, str | None]]


def findings(
    start: Ready, decision: Decision, gap: Gaps, rng: np.random.Generator
) -> tuple[list[Found], list[list[str]], Pairs]:
    """Return the effects, the groups that cannot be told apart, and the pairs to separate."""
    effects, pairs = [], []
    confusable: list[list[str]] = []
    for named in decision.named:
        options = _merged(named)
        probability = sum(p for j, p in options if j is named.judged)
        others = _covering(options, named.judged)
        moves = _moves(start, decision, named.judged)
        effects.append(_found(start, decision, gap, named, probability, others, moves, rng))
        for item in others:
            if item["probability"] > 0.2:
                axis = item["axis"]
                confusable.append([_label(named.judged), f"{axis}.{item['effect']}"])
                pairs.append((named.judged.candidate.effect, str(item["effect"]), axis))
    confusable += _exact(decision)
    effects.sort(key=lambda e: -max((x.share * x.before for x in e.shrink.values()), default=0.0))
    return effects, confusable, pairs


def _merged(named: Named) -> list[tuple[Judged | None, float]]:
    """Return the options, those of the named effect's own class and axis counted with it."""
    out: list[tuple[Judged | None, float]] = []
    own = 0.0
    for judged, p in confidences(named):
        if judged is not None and _same(judged, named.judged):
            own += p
        else:
            out.append((judged, p))
    return sorted([*out, (named.judged, own)], key=lambda x: -x[1])


def _same(a: Judged, b: Judged) -> bool:
    if not same_class(a.candidate.effect, b.candidate.effect):
        return False
    return a.candidate.axis == b.candidate.axis or a.candidate.effect == "payload"


def _covering(options: Sequence[tuple[Judged | None, float]], own: Judged) -> list[dict[str, Any]]:
    """Return the alternatives that, with the named effect, reach the stated probability."""
    out: list[dict[str, Any]] = []
    total = 0.0
    for judged, p in options:
        if total >= SET:
            break
        total += p
        if judged is own:
            continue
        effect = "none" if judged is None else judged.candidate.effect
        axis = None if judged is None else judged.candidate.axis
        why = (
            "the gap may be chance"
            if judged is None
            else (
                f"explains {judged.G / max(own.G, 1e-9):.0%} as much of the gap on data not fitted"
            )
        )
        out.append({"effect": effect, "axis": axis, "probability": p, "why": why})
    kin = next((g for g in CLASSES if own.candidate.effect in g), frozenset())
    for effect in sorted(kin - {own.candidate.effect}):
        out.append({"effect": effect, "axis": own.candidate.axis, "probability": 0.0,
                    "why": "the same in an axis' own signals, whatever the motion"})  # fmt: skip
    return out


def _found(  # noqa: PLR0913
    start: Ready, decision: Decision, gap: Gaps, named: Named, probability: float,
    others: Sequence[Mapping[str, Any]], moves: dict[str, tuple[float, float, float]],
    rng: np.random.Generator,
) -> Found:  # fmt: skip
    judged = named.judged
    candidate = judged.candidate
    return Found(
        effect=candidate.effect,
        axis=candidate.axis,
        confidence=probability,
        shape=dict(candidate.shape),
        theta=dict(zip(candidate.names, map(float, judged.theta), strict=True)),
        shrink=_alone(start, decision, gap, judged, rng),
        alternatives=others,
        moves=moves,
        gain=judged.G,
    )


def _alone(
    start: Ready, decision: Decision, gap: Gaps, judged: Judged, rng: np.random.Generator
) -> dict[str, Shrink]:
    """Return the shrink of the effect alone, on the axis where it does most."""
    rows = start.stage.rows
    after = held_out(gap.plain, [*decision.quiet, judged], start.theta)
    joints = {joint for joint, _ in judged.candidate.columns[0]} & set(rows.joints)
    found = []
    for joint in joints:
        x = shrink(gap.before, after, joint, start.stage.noise.rms[joint], rng)
        if x is not None:
            found.append(((x.before**2 - x.after**2) / start.stage.noise.rms[joint] ** 2, joint, x))
    return {"u": max(found, key=lambda y: y[:2])[2]} if found else {}


def _moves(
    start: Ready, decision: Decision, judged: Judged
) -> dict[str, tuple[float, float, float]]:
    """Return the base parameters that move most when the effect is admitted."""
    base = start.stage.base
    bare = build_ledger(admit(start.search_stage, decision.quiet), start.theta)
    full = build_ledger(admit(start.search_stage, [*decision.quiet, judged]), start.theta)
    count = base.count
    before, after = bare.theta[:count] + base.mean, full.theta[:count] + base.mean
    unit = np.zeros((len(bare.theta), count))
    unit[:count] = np.eye(count)
    error = np.sqrt(np.maximum(np.diag(bare.solve(0, unit)[:count]), 0.0))
    sigmas = (after - before) / np.maximum(error, 1e-300)
    order = np.argsort(np.abs(sigmas))[::-1][:6]
    names = base.names
    shapes = {
        f"{k}.{s.name}"
        for k, e in zip(effect_keys(base.effects), base.effects, strict=True)
        for s in e.shapes()
    }
    return {
        names[k]: (float(before[k]), float(after[k]), float(sigmas[k]))
        for k in order
        if abs(sigmas[k]) > 1.0 and "position_table" not in names[k] and names[k] not in shapes
    }


def _label(judged: Judged) -> str:
    axis = judged.candidate.axis
    return judged.candidate.effect if axis is None else f"{axis}.{judged.candidate.effect}"


def _exact(decision: Decision) -> list[list[str]]:
    """Return the effects that this log cannot tell from the base model itself."""
    return [
        [effect if axis is None else f"{axis}.{effect}", "base model"]
        for effect, axis in decision.unseen
        if effect not in ("ripple", "ripple_modulated", "position_table")
    ]
