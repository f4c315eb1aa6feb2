"""Forward steps with re-checks: name at most three effects, or none.

The threshold of a step is what healthy draws reach, drawn from the residual that the best candidate
leaves. An effect too small to matter joins the base without a name. After the steps each member is
judged again given the others, and replaced where another effect does its work better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Context
from pinotwin.diagnosis.ledger import build_ledger, residual_of
from pinotwin.diagnosis.search import (
    Cache,
    Judged,
    Screened,
    Settings,
    admit,
    ledger_with_draws,
    screen,
)
from pinotwin.diagnosis.shrinking import plain_stage
from pinotwin.diagnosis.stage import Stage

LATENCY = 3e-4  # [s] a delay below this is every machine's own and gets no name
MATTERS = 0.01  # gap power over noise power below which an effect is too small to matter
LEFT_OVER = 0.10  # of an effect's gain: what its linearised column may leave for others on its axis
LEFT_OVER_ELSEWHERE = 0.03  # the same for other axes, which share the rigid body with it
LOWEST = 10.0  # no threshold is lower
LOWEST_CHANGE = 25.0  # the same against a twin, whose own small errors count as well


@dataclass(frozen=True)
class Named:
    """One effect that was found, with what else could do its work.

    Attributes:
        judged: the effect given the other ones.
        rivals: other effects given the other ones, best first.
        threshold: held-out gain that a healthy machine reaches.
    """

    judged: Judged
    rivals: tuple[Judged, ...]
    threshold: float


@dataclass(frozen=True)
class Decision:
    """What a search decided.

    Attributes:
        named: effects, largest gain first.
        quiet: effects admitted without a name.
        stage: with all of them in its base.
        first: the first screen, of the base alone.
        unseen: effects that this log cannot tell from the base, as (effect, axis).
        steps: threshold and best gain of every step.
    """

    named: tuple[Named, ...]
    quiet: tuple[Judged, ...]
    stage: Stage
    first: Screened
    unseen: tuple[tuple[str, str | None], ...]
    steps: tuple[tuple[float, float], ...] = field(default=())


def decide(
    context: Context,
    stage: Stage,
    theta: Floats,
    settings: Settings,
    tell: Callable[[str, float], None],
) -> Decision:
    """Name the effects that the base model misses."""
    cache: Cache = {}
    rough = plain_stage(stage)
    lowest = LOWEST_CHANGE if stage.base.change else LOWEST
    found: list[Judged] = []
    quiet: list[Judged] = []
    first: Screened | None = None
    threshold, steps = 20.0, []
    for step in range(settings.most + 3):
        here = admit(stage, [*quiet, *found])
        plain = admit(rough, [*quiet, *found])
        taken = [j.key for j in (*quiet, *found)]
        tell(f"screening, step {step + 1}", 0.15 + 0.12 * step)
        seen = screen(context, build_ledger(here, theta), settings, taken, cache)
        first = first or seen
        if not seen.judged or lowest > seen.judged[0].G or len(found) >= settings.most:
            break
        best = seen.judged[0]
        tell(f"healthy draws, step {step + 1}", 0.2 + 0.12 * step)
        ledger = ledger_with_draws(here, theta, settings, step, [best])
        threshold = max(screen(context, ledger, settings, taken, cache).threshold, lowest)
        steps.append((threshold, best.G))
        if threshold > best.G:
            break
        (quiet if _trivial(best, here, found, plain) else found).append(best)
    assert first is not None
    tell("checking the found effects against each other", 0.8)
    named = _rechecked(context, stage, theta, settings, cache, found, quiet, threshold)
    unseen = tuple(j.key for j in first.judged if not j.identifiable)
    final = admit(stage, [*quiet, *(n.judged for n in named)])
    return Decision(named, tuple(quiet), final, first, unseen, tuple(steps))


def _trivial(judged: Judged, stage: Stage, found: Sequence[Judged], plain: Stage) -> bool:
    """Whether an effect is real but too small to matter, or what a first-order column leaves over."""
    axis = judged.candidate.axis
    for other in found:
        share = LEFT_OVER if other.candidate.axis == axis else LEFT_OVER_ELSEWHERE
        if share * other.G > judged.G:
            return True
    if judged.candidate.effect == "delay" and abs(float(judged.theta[0])) < LATENCY:
        return True
    least = MATTERS * rows_of(judged, stage)
    return least > judged.G or _power(plain) - _power(admit(plain, [judged])) < least


def _power(stage: Stage) -> float:
    """Return the squared residual of a plain stage in units of the noise."""
    ledger = build_ledger(stage)
    return float(sum(np.sum(residual_of(p, ledger.theta) ** 2) for p in stage.pieces))


def rows_of(judged: Judged, stage: Stage) -> int:
    """Return the number of rows that an effect acts on."""
    joints = {joint for joint, _ in judged.candidate.columns[0]}
    if judged.candidate.axis is not None:
        own = stage.rows.motions[0].index(judged.candidate.axis)
        joints = {own} if own in joints else joints
    return sum(len(p.y) for p in stage.pieces if p.channel.joint in joints)


def _rechecked(  # noqa: PLR0913
    context: Context, stage: Stage, theta: Floats, settings: Settings, cache: Cache,
    found: list[Judged], quiet: Sequence[Judged], threshold: float,
) -> tuple[Named, ...]:  # fmt: skip
    """Judge each member given the others; drop or swap it; two rounds at most."""
    named: list[Named] = []
    for _ in range(2):
        named, changed = [], False
        for k, member in enumerate(list(found)):
            others = [j for j in found if j is not member]
            here = admit(stage, [*quiet, *others])
            taken = [j.key for j in (*quiet, *others)]
            seen = screen(context, build_ledger(here, theta), settings, taken, cache)
            best = seen.judged[0]
            own = next((j for j in seen.judged if j.key == member.key), member)
            if threshold > best.G:
                found = others
                changed = True
                break
            if best.key != member.key and own.G + max(6.0, 0.02 * own.G) < best.G:
                found[k], own, changed = best, best, True
            rivals = tuple(j for j in seen.judged if j.key != own.key and j.identifiable)
            named.append(Named(own, rivals[:12], threshold))
        if not changed:
            break
    named.sort(key=lambda n: -n.judged.G)
    return tuple(named)


def confidences(named: Named, warmth: float = 0.03) -> list[tuple[Judged | None, float]]:
    """Return the effect, its rivals and None (no effect) with probabilities, best first.

    Evidence ratios exp(G / 2) are far too sure of themselves where columns are first order, so that they
    are tempered in proportion to the gain.
    """
    T = 1.0 + warmth * max(named.judged.G, 0.0)
    options: list[Judged | None] = [named.judged, *named.rivals, None]
    G = np.array([named.threshold if j is None else j.G for j in options])
    p = np.exp(np.clip((G - G.max()) / (2.0 * T), -700.0, 0.0))
    p /= p.sum()
    order = np.argsort(p)[::-1]
    return [(options[int(k)], float(p[k])) for k in order]
