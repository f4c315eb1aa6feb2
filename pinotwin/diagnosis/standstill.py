"""Friction with a memory: what is missing or has changed about it shows where an axis stands or turns round.

The other effects are sought on rows in motion, where dry friction is a function of the speed. Presliding is
not to be seen there. Here all rows are looked at, but for these families alone: at rest the form of every
law of friction is in error, and a search of the whole catalogue would find position and pushes in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.bank import Shelf, shelf
from pinotwin.diagnosis.calibration import calibrate
from pinotwin.diagnosis.catalogue import families
from pinotwin.diagnosis.context import Context, Family
from pinotwin.diagnosis.decide import MATTERS, Decision, Named, rows_of
from pinotwin.diagnosis.healthy import healthy_draws
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.prepare import Ready, at_rest, with_rest_of
from pinotwin.diagnosis.search import Judged, Settings, admit, polish, screen

LOWEST = 60.0  # no threshold is lower: at rest the form of the law is in error as well
MOST = 2  # effects that are sought here
ELSEWHERE = frozenset({"external_force", "ripple_modulated"})  # not of friction


def look_at_rest(
    start: Ready, decision: Decision, settings: Settings, tell: Callable[[str, float], None]
) -> tuple[Ready, Decision]:
    """Return the stage and the decision with the friction that shows at standstill and reversals.

    Both are as they were where nothing is found.
    """
    tell("friction at standstill and reversals", 0.82)
    wanted = [f for f in families(start.context, leave_out=settings.leave_out)
              if _is_sought(start.context, f)]  # fmt: skip
    room = min(MOST, settings.most - len(decision.named))
    if not wanted or room < 1:
        return start, decision
    rest = at_rest(start)
    shelves = [shelf(start.context, rest.search_stage, f) for f in wanted]
    named = _steps(rest, decision, shelves, settings, room)
    if not named:
        return start, decision
    return _joined(start, rest, decision, _sure(rest, shelves, settings, named))


def _is_sought(context: Context, family: Family) -> bool:
    """Whether a family is one of friction with a memory that the base lets show."""
    if context.base.change:  # a twin's level at rest is not known well enough to call it changed
        return family.effect == "presliding" and context.has("presliding", str(family.axis))
    return family.effect in ("presliding", "stribeck")


def _steps(
    rest: Ready, decision: Decision, shelves: Sequence[Shelf], settings: Settings, room: int
) -> list[Named]:
    """Return what is found in forward steps, given what was found in motion."""
    given = [*decision.quiet, *(n.judged for n in decision.named)]
    plain = replace(settings, leave_out=settings.leave_out | ELSEWHERE)
    named: list[Named] = []
    for step in range(room):
        found = [n.judged for n in named]
        here = admit(rest.search_stage, [*given, *found])
        taken = [j.key for j in (*given, *found)]
        ledger = build_ledger(here, rest.theta)
        seen = screen(rest.context, shelves, ledger, plain, taken)
        if not seen.judged or LOWEST > seen.judged[0].G:
            break
        best = polish(rest.context, ledger, seen.judged[0])
        threshold = _chance(rest, shelves, plain, best, (here, taken, step))
        if max(threshold, MATTERS * rows_of(best, here)) > best.G:
            break
        rivals = tuple(j for j in seen.judged if j.key != best.key and j.identifiable)
        named.append(Named(best, rivals, threshold))
    return named


def _chance(
    rest: Ready, shelves: Sequence[Shelf], settings: Settings, best: Judged,
    where: tuple,  # type: ignore[type-arg]
) -> float:  # fmt: skip
    """Return the gain that healthy draws reach, drawn from the residual that the best leaves."""
    here, taken, step = where
    under = admit(here, [best])
    rng = np.random.default_rng([settings.seed, 50 + step])
    drawn = healthy_draws(under, build_ledger(under, rest.theta), settings.draws, rng)
    seen = screen(rest.context, shelves, build_ledger(here, rest.theta, drawn), settings, taken)
    return max(seen.threshold(settings.alpha), LOWEST)


def _sure(
    rest: Ready, shelves: Sequence[Shelf], settings: Settings, named: Sequence[Named]
) -> list[Named]:
    """Return them with what this motion's rows at rest can tell apart."""
    plain = replace(settings, leave_out=settings.leave_out | ELSEWHERE)
    known = calibrate(rest.context, rest.search_stage, rest.theta, shelves, plain)
    return [replace(n, calibration=known) for n in named]


def _joined(
    start: Ready, rest: Ready, decision: Decision, named: Sequence[Named]
) -> tuple[Ready, Decision]:
    """Return both with the found effects, their axes with rows at rest."""
    joints = {joint for n in named for joint, _ in n.judged.candidate.columns[0]}
    wider = with_rest_of(start, rest, joints)
    every = sorted([*decision.named, *named], key=lambda n: -n.judged.G)
    searched = wider.search_stage
    final = admit(searched, [*decision.quiet, *(n.judged for n in every)])
    return wider, replace(decision, named=tuple(every), searched=searched, stage=final)
