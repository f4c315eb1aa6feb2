"""What is named: each cause with its size, its shrink on rows not fitted, and its rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.candidates.episodes import Episodes
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.evidence.bodies import body_of, body_sizes
from pinotwin.diagnosis.evidence.bootstrap import share_interval
from pinotwin.diagnosis.evidence.springs import inertias
from pinotwin.diagnosis.others.servo import ServoChange
from pinotwin.diagnosis.result import Found, Shrink, Size
from pinotwin.diagnosis.search.forward import Found as Search
from pinotwin.diagnosis.search.forward import Step
from pinotwin.diagnosis.search.forward import known as known_of
from pinotwin.diagnosis.search.scan import Scored, Searcher

LIKELY = 0.5
"""Share of the winner's gain from which a rival is worth a line."""


def effects_named(comparison: Comparison, found: Search, confidence: Sequence[float]) -> list[Found]:
    """Return the effects that a search has found, patterns left out."""
    out = []
    for step, sure in zip(found.steps, confidence, strict=True):
        if not isinstance(step.chosen.effect, Pattern):
            out.append(_named(comparison, step, sure))
    return out


def _named(c: Comparison, step: Step, sure: float) -> Found:
    one, effect = step.chosen, named(step.chosen.effect)
    names = [x.name for x in one.effect.coefficients()]
    theta = dict(zip(names, one.judged.theta.tolist(), strict=True))
    shapes = dict(zip((s.name for s in effect.shapes()), effect.shape_values(), strict=True))
    sizes = sizes_of(c, one)
    for s in sizes:
        if s.name.endswith(".resonance"):
            shapes["resonance"] = s.after
    return Found(
        effect=effect.name,
        axis=effect.axis,
        confidence=sure,
        shape=shapes,
        theta=theta,
        shrink={"u": shrink_of(c, one, step.searcher)},
        alternatives=_rivals(step, sure),
        moves=_moves(one, sizes),
        gain=one.gain / max(_rows(c), 1),
        size=sizes,
        listed=effect,
    )


def _rows(c: Comparison) -> int:
    return sum(len(r) for r in c.new.residual.values())


ROUNDED = 1e-9
"""Share of what a number is now below which it was none before: a fit leaves 2e-14 of what rests at zero."""


def sizes_of(c: Comparison, one: Scored) -> list[Size]:
    """Return what changed from what to what, in the effect's own numbers."""
    effect = named(one.effect)
    theta, covariance = one.judged.theta, one.judged.covariance
    if effect.name == "payload":
        return body_sizes(body_of(theta, covariance), theta, covariance)
    before = known_of(one.effect, c)
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = []
    for k, x in enumerate(one.effect.coefficients()):
        after = before[k] + float(theta[k])
        half = 1.645 * float(error[k])
        was = before[k] if abs(before[k]) > ROUNDED * abs(after) else 0.0
        rows.append(Size(f"{effect.name}.{x.name}", was, after, x.unit, (after - half, after + half)))
    resonance = _resonance(c, one)
    return rows if resonance is None else [resonance, *rows]


def _resonance(c: Comparison, one: Scored) -> Size | None:
    """Return the mode of a flexible drive with its motor free, from that with the motor held.

    A load that is the share s of an axis' inertia swings with the motor at f / sqrt(1 - s). Of a machine the
    inertia is that fitted beside the spring.
    """
    effect = named(one.effect)
    known = inertias(c, one.judged, one.joint)
    if effect.name not in ("drive_flexibility", "joint_flexibility") or known is None:
        return None
    carried, whole = known
    share, error = float(one.judged.theta[-1]), float(np.sqrt(one.judged.covariance[-1, -1]))
    held = float(effect.shape_values()[0])

    def free(x: float) -> float:
        return held / float(np.sqrt(np.clip(1.0 - x * carried / whole, 1e-3, 1.0)))

    if not 0.0 < share * carried < whole:
        return None
    span = (free(share - 1.645 * error), free(share + 1.645 * error))
    return Size(f"{effect.name}.resonance", float("nan"), free(share), "Hz", span)


def _moves(one: Scored, sizes: Sequence[Size]) -> dict[str, tuple[float, float, float]]:
    error = np.sqrt(np.maximum(np.diag(one.judged.covariance), 1e-300))
    return {
        f"{named(one.effect).axis}.{s.name}": (s.before, s.after, abs(s.after - s.before) / float(e))
        for s, e in zip((x for x in sizes if np.isfinite(x.before)), error, strict=False)
    }


def shrink_of(c: Comparison, one: Scored, searcher: Searcher) -> Shrink:
    """Return how far the gap of an effect's main axis shrinks by it alone, on rows not fitted."""
    fitted, beyond = searcher.alone_by_joint
    gains, unseen = searcher.main_gains(one)
    at = list(c.new.joints).index(one.joint)
    before, gained = fitted[:, at], gains
    promised = _share(before, gained)
    count, on = len(c.new.residual[one.joint]), "held-out blocks"
    if len(unseen) and c.unseen is not None and one.joint in c.unseen.joints:
        before = beyond[:, list(c.unseen.joints).index(one.joint)]
        gained = unseen
        count, on = len(c.unseen.residual[one.joint]), "validation"
    share = _share(before, gained)
    low, high = share_interval(before, before - gained)
    level = c.floor[one.joint] * float(np.sqrt(before.sum() / max(count, 1)))
    after = level * float(np.sqrt(max(1.0 - share, 0.0)))
    return Shrink(level, after, share, (low, min(high, 1.0)), promised, on)


def _share(before: Floats, gained: Floats) -> float:
    return float(np.clip(gained.sum() / max(before.sum(), 1e-300), -1.0, 1.0))


def _rivals(step: Step, sure: float) -> list[Mapping[str, Any]]:
    """Return other effects that close nearly as much, with how they stand against the winner."""
    out: list[Mapping[str, Any]] = []
    near = [
        r for r in step.rivals if r.gain > LIKELY * step.chosen.gain and not isinstance(r.effect, Pattern)
    ]
    total = sum(r.gain for r in near)
    whole = step.chosen.gain / max(step.chosen.share, 1e-300)  # the gap of all joints that the winner acts on
    for r in near[:5]:
        effect = named(r.effect)
        out.append(
            {
                "effect": effect.name,
                "axis": effect.axis,
                "probability": (1.0 - sure) * r.gain / total,
                "why": f"closes {r.gain / whole:.0%} where {named(step.chosen.effect).name} closes "
                f"{step.chosen.share:.0%} of the squared gap",
            }
        )
    return out


def servo_named(changes: Sequence[ServoChange]) -> list[Found]:
    """Return the changes of the servo as named effects."""
    out = []
    for x in changes:
        size = Size(x.name, x.before, x.after, x.unit, x.interval)
        shrink = {}
        if x.gap[0] > 0.0:
            low = max(2.0 * x.share - 1.0, 0.0)
            shrink = {"law": Shrink(x.gap[0], x.gap[1], x.share, (low, 1.0), x.share, "held-out blocks")}
        shape = {"limit": x.after} if x.effect == "saturation" else {}
        theta = {x.name.replace(" ", "_"): x.after - (0.0 if np.isinf(x.before) else x.before)}
        out.append(Found(x.effect, x.axis, x.confidence, shape, theta, shrink, [], size=[size], gain=x.share))
    return out


def pushes_named(c: Comparison, found: Sequence[Episodes], confidence: Sequence[float]) -> list[Found]:
    """Return the pushes on every axis as one named effect each."""
    out = []
    for pushed, sure in zip(found, confidence, strict=True):
        axis = c.machine.names[pushed.joint]
        unit = "N·m" if c.machine.rotary[pushed.joint] else "N"
        largest = max(pushed.episodes, key=lambda e: abs(e.force))
        level = float(np.sqrt(np.mean(c.new.residual[pushed.joint] ** 2)))
        half = 1.645 * largest.error
        size = Size("largest push", 0.0, largest.force, unit, (largest.force - half, largest.force + half))
        shrink = Shrink(
            before=level,
            after=level * float(np.sqrt(max(1.0 - pushed.share, 0.0))),
            share=pushed.share,
            interval=pushed.interval,
            promised=pushed.share,
            on="held-out rows of the pushes",
        )
        theta = {f"f{k}": e.force for k, e in enumerate(pushed.episodes)}
        shape = {f"start{k}": e.start for k, e in enumerate(pushed.episodes)}
        gain = pushed.gain / max(_rows(c), 1)
        out.append(
            Found("external_force", axis, sure, shape, theta, {"u": shrink}, [], size=[size], gain=gain)
        )
    return out
