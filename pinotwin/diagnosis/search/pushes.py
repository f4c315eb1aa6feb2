"""Pushes from outside: which are named, and how sure they are.

A push must stand out of what the twin leaves anyway, the axis move meanwhile, and no cause that comes with the motion,
nor friction of one run, close as much. Trials in the twin's own residual, laid in another order, tell how sure it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.episodes import Episodes, episodes
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.data.scatter import by_days, scattered
from pinotwin.diagnosis.evidence.repeatable import habit
from pinotwin.diagnosis.rules import Rules
from pinotwin.diagnosis.search.forward import Found
from pinotwin.diagnosis.search.injections import posterior
from pinotwin.diagnosis.search.scan import Scored, Searcher
from pinotwin.diagnosis.search.trials import TRIALS, laid

RIVALS = 3  # Causes that come with the motion that a push is held against in each trial


def pushes(c: Comparison, found: Found, rules: Rules) -> list[Episodes]:
    """Return the pushes that close more than any cause on the same axis does."""
    out = []
    for at, j in enumerate(c.new.joints):
        if not c.gate.admits("external_force", c.machine.names[j]):
            continue
        seen = _standing(c, found, j, rules)
        if seen is None:
            continue
        _, pushed = seen
        before, rest = (float(s.alone_by_joint[0][:, at].sum()) for s in (found.first, found.searcher))
        rival = max((r.gain for r in _rivals(found, j)), default=0.0)
        days = scattered(c, j, by_days(c, j, rules))
        if pushed.gain > rules.push_better * max(before - rest, rival, days):
            out.append(pushed)
    return out


def only_sure(c: Comparison, found: Found, sure: Sequence[float], rules: Rules) -> Found:
    """Return a search with the causes that are sure: the others account for nothing, and are rivals of a push.

    Pushes where the motion asks for them look like a cause with a memory, which trials do not confirm.
    """
    kept = [s for s, x in zip(found.steps, sure, strict=True) if x >= rules.named]
    doubted = [s.chosen for s, x in zip(found.steps, sure, strict=True) if x < rules.named]
    first = found.steps[0].rivals if found.steps else ()
    searcher = Searcher(c, [s.chosen for s in kept])
    return replace(found, steps=kept, left=[*doubted, *first, *found.left], searcher=searcher)


def _standing(c: Comparison, found: Found, joint: int, rules: Rules) -> tuple[Comparison, Episodes] | None:
    """Return what pushes were found on (all that is left, or without the habit, the better) and those standing out."""
    left = found.searcher.residual()[joint] * c.floor[joint]
    seen = list[tuple[Comparison, Episodes]]()
    for ground in (c, without_habit(c, joint, rules)):
        if ground is None:
            continue
        gone = c.new.residual[joint] - ground.new.residual[joint]
        if _episodes(ground, left - gone, joint, rules) is None:
            continue
        pushed = _episodes(ground, ground.new.residual[joint], joint, rules)
        if pushed is not None and stands_out(ground, pushed, rules):
            seen.append((ground, _in_all(c, ground, pushed)))
    return max(seen, key=lambda pair: pair[1].gain, default=None)


def without_habit(c: Comparison, joint: int, rules: Rules) -> Comparison | None:
    """Return the comparison without what the twin leaves of an axis whenever it moves so; None if that is little."""
    known = None if c.own is None or joint not in c.own.joints else habit(c.new, c.own, joint, rules)
    if known is None or c.own is None:
        return None
    new = replace(c.new, residual={**c.new.residual, joint: known.new})
    own = replace(c.own, residual={**c.own.residual, joint: known.own})
    unit = max(known.left, rules.habit_unit)
    return replace(c, new=new, own=own, floor={**c.floor, joint: unit * c.floor[joint]})


def _episodes(c: Comparison, left: Floats, joint: int, rules: Rules) -> Episodes | None:
    """Return the pushes in what is left of an axis [N or N·m]."""
    own = None if c.own is None else {j: c.own.residual[j] / c.floor[j] for j in c.own.joints if j in c.floor}
    return episodes(c.new, {joint: left / c.floor[joint]}, own, c.own, c.floor, joint, rules)


def _in_all(c: Comparison, ground: Comparison, pushed: Episodes) -> Episodes:
    """Return pushes with what they close of all that is left, in its floor's units."""
    j = pushed.joint
    unit = (ground.floor[j] / c.floor[j]) ** 2
    r = c.new.residual[j] / c.floor[j]
    before, gains = np.bincount(c.new.block[j], r * r, c.new.blocks).astype(float), unit * pushed.gains
    share = float(gains.sum() / max(before.sum(), 1e-300))
    return replace(pushed, gain=unit * pushed.gain, share=share, gains=gains)


def stands_out(c: Comparison, pushed: Episodes, rules: Rules) -> bool:
    """Whether pushes are larger than what the twin leaves anyway, on an axis that moves, and no vibration."""
    floor, rows = c.floor[pushed.joint], len(pushed.rows)
    forces = [(abs(e.force) / floor, e.end - e.start) for e in pushed.episodes]
    for_a_moment = any(
        size > rules.push_strong and (length > rules.push_short or size > 2.0 * rules.push_strong)
        for size, length in forces
    )
    for_long = pushed.gain > rules.excess * rows and max(size for size, _ in forces) > rules.push_long
    closed = floor * float(np.sqrt(max(pushed.gain, 0.0) / rows))
    large = closed > rules.push_size * c.new.size(pushed.joint)
    seconds = rows * c.new.motion.step * c.new.motion.decimation
    seldom = pushed.times <= max(rules.push_often * seconds, 1.0)
    of_machine = pushed.share >= rules.share_structure and pushed.swinging <= rules.push_swings
    return (
        (for_a_moment or for_long)
        and large
        and seldom
        and (c.change or of_machine)
        and _moving_share(c, pushed, rules) > rules.push_moving
    )


def push_confidence(
    c: Comparison, found: Found, pushed: Episodes, rng: np.random.Generator, rules: Rules
) -> float:
    """Return how sure the pushes on an axis are: the share of trials in which they are named again."""
    j = pushed.joint
    seen = _standing(c, found, j, rules)
    ground = c if seen is None else seen[0]
    course = pushed.course
    rivals = _rivals(found, j)[:RIVALS]
    anyway = ground.own.residual[j] if ground.own else found.searcher.residual()[j] * c.floor[j] - course
    wins = 0
    for _ in range(TRIALS):
        residual = laid(c.new, anyway, len(course), rng) + course
        trial = replace(ground, new=replace(ground.new, residual={**ground.new.residual, j: residual}))
        again = _episodes(trial, residual, j, rules)
        if again is None or not stands_out(trial, again, rules) or not _same(again, pushed):
            continue
        searcher = Searcher(trial)
        scored = (searcher.score(r.effect, r.table) for r in rivals)
        closed = max((r.gain for r in scored if r is not None), default=0.0)
        wins += again.gain > rules.push_better * max(closed, scattered(trial, j, by_days(trial, j, rules)))
    return posterior(wins, TRIALS, rules)


def _same(a: Episodes, b: Episodes) -> bool:
    """Whether two findings lie at the same time for the most part, or are one course of force."""
    if float(np.sum(a.rows & b.rows)) > 0.5 * max(float(a.rows.sum()), float(b.rows.sum())):
        return True
    both = float(a.course @ b.course)
    return both > 0.5 * max(float(a.course @ a.course), float(b.course @ b.course))


def _rivals(found: Found, joint: int) -> list[Scored]:
    """Return the causes that come with the motion and act on an axis alone, best first, named or not."""
    seen = [*(found.steps[0].rivals if found.steps else ()), *(s.chosen for s in found.steps), *found.left]
    own = [r for r in seen if set(r.table[0]) == {joint}]
    return sorted(own, key=lambda r: -r.gain)


def _moving_share(c: Comparison, pushed: Episodes, rules: Rules) -> float:
    """Return the share of a push's rows at which its axis moves, fast enough for its twin's friction to have turned."""
    axis = c.machine.axes[c.machine.names[pushed.joint]]
    speed = np.abs(c.new.motion.v[:, pushed.joint])
    turned = [e.turned(axis.rotary) for e in c.twin.effects if e.axis == axis.name]
    least = max(rules.stands * speed.max(initial=0.0), *turned, 0.0)
    return float(np.mean(speed[c.new.samples(pushed.joint)][pushed.rows] > least))
