"""The named effects with confidence, shrink, alternatives, and what they share with the base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.diagnosis.admission import Judged, admit
from pinotwin.diagnosis.advice import CLASSES
from pinotwin.diagnosis.calibration import Calibration, alike, tempered
from pinotwin.diagnosis.decide import Decision, Named
from pinotwin.diagnosis.gaps import Gaps
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.result import Found, Shrink
from pinotwin.diagnosis.shrinking import held_out, on_fitted, shrink
from pinotwin.diagnosis.verdict import Left
from pinotwin.effects.layout import effect_keys

SET = 0.9  # probability that the stated alternatives cover
WARMTH = 0.01  # temperature per gain that columns of first order ask for, whatever injections say
CLOSE = 0.4  # of the evidence: a rival is not told from an answer that leaves part of the gap open
UNKNOWN = 0.6  # weight of a cause in no catalogue, beside 1 of a rival as good as the answer
WHY = {
    "none": "the gap may be chance",
    "unknown": "part of the gap stays: the cause may be in no catalogue",
}
Pairs = list[tuple[str, str, str | None]]


def findings(
    start: Ready, decision: Decision, gap: Gaps, left: Left, rng: np.random.Generator
) -> tuple[list[Found], list[list[str]], Pairs]:
    """Return the effects, the groups that cannot be told apart, and the pairs to separate."""
    effects, pairs = [], []
    confusable: list[list[str]] = []
    for named in decision.named:
        partial = bool(named.judged.joints & set(left.open))
        known = named.calibration or decision.calibration
        options = _options(named, known, partial=partial)
        probability = sum(p for j, p in options if j is named.judged)
        others = _covering(options, named)
        moves = _moves(start, decision, named.judged)
        effects.append(_found(start, decision, gap, named, probability, others, moves, rng))
        confusable += [[_name(named.judged.key), _name(key)] for key in named.alike]
        if partial:
            confusable += [[_name(named.judged.key), _name(j.key)] for j in _close(named)]
        for item in others:
            if item["probability"] > 0.2 and item["effect"] not in WHY:
                axis = item["axis"]
                confusable.append([_name(named.judged.key), _name((item["effect"], axis))])
                pairs.append((named.judged.candidate.effect, str(item["effect"]), axis))
    confusable += _exact(decision)
    confusable = [list(x) for x in dict.fromkeys(tuple(g) for g in confusable)]
    return _in_order(effects, decision), confusable, pairs


def _in_order(effects: Sequence[Found], decision: Decision) -> list[Found]:
    """Return the effects by what they explain; what was found at rest after what its axis shows in motion.

    At rest there is more to explain than any law of friction does: what another effect leaves there looks
    like presliding, and may be more than the effect itself.
    """
    rest = {n.judged.key for n in decision.named if n.calibration is not None}
    gain = {(e.effect, e.axis): e.gain for e in effects}
    for key in rest:
        moving = [g for other, g in gain.items() if other[1] == key[1] and other not in rest]
        gain[key] = min([gain[key], *(0.999 * g for g in moving)])
    return sorted(effects, key=lambda e: -gain[e.effect, e.axis])


def _options(named: Named, calibration: Calibration, *, partial: bool) -> list[tuple[Judged | str, float]]:
    """Return the named effect, its rivals, ``none`` and ``unknown`` with probabilities, best first.

    Options of the named effect's own class and axis count with it. The share of right answers among
    injections that looked as sure replaces the probability of the first; the others share the rest.

    An answer that leaves part of the gap open has not the form of the cause to the letter. Evidence does
    not tell it then from a rival on its axis that explains nearly as much, nor from a cause that is in no
    catalogue.
    """
    every: list[Judged | str] = [named.judged, *named.rivals, "none"]
    G = np.array([named.judged.G, *(j.G for j in named.rivals)])
    p = tempered(G, named.threshold, max(calibration.warmth, WARMTH))
    own = float(sum(x for j, x in zip(every, p, strict=True) if _same(j, named.judged)))
    rest = [(j, float(x)) for j, x in zip(every, p, strict=True) if not _same(j, named.judged)]
    sure = calibration.confidence(own, partial=partial)
    if partial:
        weight = UNKNOWN / max(sum(x for _, x in rest), 1e-300)
        close = {id(j): j.G / named.judged.G for j in _close(named)}
        rest = [(j, close.get(id(j), 0.0) + 0.1 * weight * x) for j, x in rest]
        rest.append(("unknown", UNKNOWN))
    left = sum(x for _, x in rest)
    scale = (1.0 - sure) / left if left > 0.0 else 0.0
    out: list[tuple[Judged | str, float]] = [(named.judged, sure)]
    out += [(j, x * scale) for j, x in rest]
    return sorted(out, key=lambda x: -x[1])


def _close(named: Named) -> list[Judged]:
    """Return the rivals on the named effect's axis that explain nearly as much of the gap."""
    own = named.judged
    return [
        j
        for j in named.rivals
        if j.candidate.axis == own.candidate.axis and j.G > CLOSE * own.G and not _same(j, own)
    ]


def _same(a: Judged | str, b: Judged) -> bool:
    return not isinstance(a, str) and alike(a.key, b.key)


def _covering(options: Sequence[tuple[Judged | str, float]], named: Named) -> list[dict[str, Any]]:
    """Return the alternatives that, with the named effect, reach the stated probability.

    Without those that the model confidence set rejects.
    """
    own = named.judged
    out: list[dict[str, Any]] = []
    total = 0.0
    for judged, p in options:
        if total >= SET:
            break
        total += p
        if judged is own:
            continue
        if not isinstance(judged, str) and judged.key in named.rejected:
            continue
        if isinstance(judged, str):
            effect, axis, why = judged, None, WHY[judged]
        else:
            effect, axis = judged.key
            share = judged.G / max(own.G, 1e-9)
            why = f"explains {share:.0%} as much of the gap on data not fitted"
        out.append({"effect": effect, "axis": axis, "probability": p, "why": why})
    kin = next((g for g in CLASSES if own.candidate.effect in g), frozenset())
    for effect in sorted(kin - {own.candidate.effect}):
        out.append(
            {
                "effect": effect,
                "axis": own.candidate.axis,
                "probability": 0.0,
                "why": "the same in an axis' own signals, whatever the motion",
            }
        )
    return out


def _found(  # noqa: PLR0913
    start: Ready,
    decision: Decision,
    gap: Gaps,
    named: Named,
    probability: float,
    others: Sequence[Mapping[str, Any]],
    moves: dict[str, tuple[float, float, float]],
    rng: np.random.Generator,
) -> Found:
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
    both = [*decision.quiet, judged]
    if judged.family.local:
        before, after = (on_fitted(gap.plain, x, start.theta) for x in (decision.quiet, both))
    else:
        before, after = gap.before, held_out(gap.plain, both, start.theta)
    found = []
    for joint in judged.joints & set(rows.joints):
        x = shrink(before, after, joint, start.stage.noise.rms[joint], rng)
        if x is not None:
            found.append(((x.before**2 - x.after**2) / start.stage.noise.rms[joint] ** 2, joint, x))
    shrinks = {"u": max(found, key=lambda y: y[:2])[2]} if found else {}
    own = gap.together.get(str(judged.candidate.axis), {})
    if len(decision.named) == 1 and "e" in own:
        shrinks["e"] = own["e"]
    return shrinks


def _moves(start: Ready, decision: Decision, judged: Judged) -> dict[str, tuple[float, float, float]]:
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


def _name(key: tuple[str, str | None]) -> str:
    effect, axis = key
    return effect if axis is None else f"{axis}.{effect}"


def _exact(decision: Decision) -> list[list[str]]:
    """Return the effects that this log cannot tell from the base model itself."""
    return [
        [_name(key), "base model"]
        for key in decision.unseen
        if key[0] not in ("ripple", "ripple_modulated", "position_table", "rotor_inertia")
    ]
