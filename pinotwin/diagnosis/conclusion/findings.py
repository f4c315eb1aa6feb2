"""What is named: each cause with its size, its shrink on rows not fitted, and its rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.diagnosis.candidates.catalogue import Joined, named
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.conclusion.explained import Account, Closed, Turn
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.evidence.bodies import body_of, body_sizes
from pinotwin.diagnosis.evidence.springs import inertias
from pinotwin.diagnosis.result import Found, Size
from pinotwin.diagnosis.search.forward import known as known_of
from pinotwin.diagnosis.search.scan import Scored

LIKELY = 0.5  # Share of the winner's gain from which a rival is worth a line


def effects_named(account: Account, levels: Mapping[int, float]) -> list[Found]:
    """Return the effects that a search has found, patterns left out; ``levels``: joint -> RMS of its gap [N or N·m]."""
    return [_named(account, turn, levels) for turn in account.turns]


def _named(account: Account, turn: Turn, levels: Mapping[int, float]) -> Found:
    c, one = account.comparison, turn.step.chosen
    effect = named(one.effect)
    closed = account.all_of(turn)
    acts = {c.machine.names[j]: x.shrink(levels[j], c.machine.names[j]) for j, x in closed.items()}
    names = [x.name for x in one.effect.coefficients()]
    theta = dict(zip(names, one.judged.theta.tolist(), strict=True))
    shapes = dict(zip((s.name for s in effect.shapes()), effect.shape_values(), strict=True))
    sizes = sizes_of(c, one)
    own = {f"{effect.name}.{x.name}" for x in effect.coefficients()}
    rode = isinstance(one.effect, Joined)  # its own number comes before that of what it rides on
    for s in sizes:
        if s.name.endswith(".resonance"):
            shapes["resonance"] = s.after
    return Found(
        effect=effect.name,
        axis=effect.axis,
        confidence=turn.sure,
        shape=shapes,
        theta=theta,
        shrink={"u": acts[c.machine.names[one.joint]]},
        alternatives=_rivals(account, turn, closed[one.joint]),
        moves=_moves(one, sizes),
        gain=one.gain / max(_rows(c), 1),
        size=sorted(sizes, key=lambda s: s.name not in own) if rode else sizes,
        listed=effect,
        acts=acts,
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
    now = known_of(one.effect, c, one.judged if isinstance(one.effect, Joined) else None) + theta
    half = 1.645 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = []
    for k, x in enumerate(one.effect.coefficients()):
        was = float(before[k]) if abs(before[k]) > ROUNDED * abs(now[k]) else 0.0
        low, high = (float(np.clip(now[k] + h, min(x.lower, now[k]), np.inf)) for h in (-half[k], half[k]))
        rows.append(Size(f"{effect.name}.{x.name}", was, float(now[k]), x.unit, (low, high)))
    resonance = _resonance(c, one)
    return rows if resonance is None else [resonance, *rows]


def _resonance(c: Comparison, one: Scored) -> Size | None:
    """Return the mode of a flexible drive with its motor free, from that with the motor held."""
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


def _rivals(account: Account, turn: Turn, won: Closed) -> list[Mapping[str, Any]]:
    """Return other effects that close nearly as much of the gap of the winner's main axis."""
    step, joint, near = turn.step, turn.step.chosen.joint, []
    for r in step.rivals:
        acts = joint in r.table[0] and not isinstance(r.effect, Pattern)
        if acts and r.gain > LIKELY * step.chosen.gain:
            again = turn.ground.score(r.effect, r.table) or r
            near.append((named(r.effect), account.closed(turn.ground, again, joint).bounded))
    total = max(sum(share for _, share in near), 1e-300)
    return [
        {
            "effect": effect.name,
            "axis": effect.axis,
            "probability": (1.0 - turn.sure) * share / total,
            "share": share,
            "why": f"explains {share:.0%} of the variance; the named cause explains {won.bounded:.0%}",
        }
        for effect, share in near[:5]
        if share > 0.0
    ]


def pushes_named(account: Account, levels: Mapping[int, float]) -> list[Found]:
    """Return the pushes on every axis as one named effect each; their gap is that with the pushes in it."""
    c, out = account.comparison, []
    for pushed, sure in account.pushed:
        axis = c.machine.names[pushed.joint]
        unit = "N·m" if c.machine.rotary[pushed.joint] else "N"
        largest = max(pushed.episodes, key=lambda e: abs(e.force))
        half = 1.645 * largest.error
        size = Size(
            "largest disturbance", 0.0, largest.force, unit, (largest.force - half, largest.force + half)
        )
        acts = {axis: account.pushes(pushed).shrink(levels[pushed.joint], axis)}
        theta = {f"f{k}": e.force for k, e in enumerate(pushed.episodes)}
        shape = {f"start{k}": e.start for k, e in enumerate(pushed.episodes)}
        gain = pushed.gain / max(_rows(c), 1)
        shrink = {"u": acts[axis]}
        out.append(
            Found("external_force", axis, sure, shape, theta, shrink, [], size=[size], gain=gain, acts=acts)
        )
    return out
