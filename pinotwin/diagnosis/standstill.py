"""Friction with a memory: what is missing or has changed about it shows where an axis stands or turns round.

The other effects are sought on rows in motion, where dry friction is a function of the speed. Presliding is
not to be seen there. Here all rows are looked at, but for these families alone: at rest the form of every
law of friction is in error, and a search of the whole catalogue would find position and pushes in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.admission import Judged, admit
from pinotwin.diagnosis.bank import Shelf, shelf
from pinotwin.diagnosis.calibration import calibrate
from pinotwin.diagnosis.catalogue import families
from pinotwin.diagnosis.confidence_set import rejected
from pinotwin.diagnosis.context import Context, Family
from pinotwin.diagnosis.decide import Decision, Named
from pinotwin.diagnosis.healthy import healthy_draws
from pinotwin.diagnosis.isolability import not_isolable
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.prepare import Ready, with_rest_of
from pinotwin.diagnosis.search import Settings, polish, screen
from pinotwin.diagnosis.trivial import rows_of
from pinotwin.signals import clipped_rms

FORM = 0.08  # deviance per row that the form of a law may be in error by at rest: no threshold is lower
SLOW = 0.06  # of an axis' top speed: a friction that falls beyond is no effect of standstill
RESTLESS = 1.5  # noise with standstill over noise in motion; healthy virtual machines reach 1.3
ROUGH = 1.4  # the same from row to row, at rest alone; 300 axes of healthy virtual machines reach 1.33
STILL = 0.01  # of an axis' top speed: rest
FEW = 200  # rows that are not enough to be compared
USUAL = 0.97  # of the differences from row to row: the others hold the moments at which friction gives way
MOST = 2  # effects that are sought here
ELSEWHERE = frozenset({"external_force", "ripple_modulated"})  # not of friction


def look_at_rest(start: Ready, rest: Ready, decision: Decision, settings: Settings) -> tuple[Ready, Decision]:
    """Return the stage and the decision with the friction that shows at standstill and reversals.

    Both are as they were where nothing is found.

    Args:
        start: rows in motion.
        rest: all rows, from :func:`pinotwin.diagnosis.prepare.at_rest`.
        decision: what was found in motion.
        settings: of the search.
    """
    wanted = _sought(start.context, settings.leave_out)
    room = min(MOST, settings.most - len(decision.named))
    if not wanted or room < 1:
        return start, decision
    shelves = [shelf(start.context, rest.search_stage, f) for f in wanted]
    named = _steps(rest, decision, shelves, settings, room)
    if not named:
        return start, decision
    given = [*decision.quiet, *decision.leavings, *(n.judged for n in decision.named)]
    return _joined(start, rest, decision, _sure(rest, shelves, settings, given, named))


def restless(start: Ready, rest: Ready) -> dict[int, str]:
    """Return the joints whose runs of one command differ more at rest than in motion, in words."""
    moving, still = start.stage.noise, rest.stage.noise
    if moving.kind != "repeats":
        return {}
    rough = {j: x for j in moving.rms if (x := roughness_at_rest(rest, j)) > ROUGH}
    level = {j: x for j in moving.rms if (x := still.rms.get(j, 0.0) / moving.rms[j]) > RESTLESS}
    return {
        j: f"runs of one command differ from row to row {x:.1f} times as much at standstill as in motion"
        for j, x in rough.items()
    } | {
        j: f"runs of one command differ {x:.1f} times as much with standstill as in motion"
        for j, x in level.items()
    }


def roughness_at_rest(rest: Ready, joint: int) -> float:
    """Return by how much more repeats differ from row to row at rest than in motion; 0 without either.

    Where dry friction stops an axis is decided by noise, and the effort that holds it there differs from
    run to run by much; but it stays.
    """
    rows = rest.stage.rows
    at = [k for k, c in enumerate(rows.channels) if c.joint == joint and not rows.validation[c.log]]
    jumps: tuple[list[Floats], list[Floats]] = [], []
    for a, b in combinations(at, 2):
        one, two = rows.channels[a], rows.channels[b]
        if rows.commands[one.log] != rows.commands[two.log]:
            continue
        common, i, k = np.intersect1d(one.centres, two.centres, return_indices=True)
        jump = np.diff(rest.residuals[a][i] - rest.residuals[b][k])
        speed = np.abs(rows.motions[one.log].v[:, joint])
        still = speed[common] < STILL * speed.max(initial=0.0)
        near = np.diff(common) == rows.thinner.factor
        jumps[0].append(jump[near & still[1:] & still[:-1]])
        jumps[1].append(jump[near & ~still[1:] & ~still[:-1]])
    sizes = [np.concatenate(x) if x else np.zeros(0) for x in jumps]
    if min(map(len, sizes)) < FEW:
        return 0.0
    still, going = (clipped_rms(x, USUAL) for x in sizes)
    return still / max(going, 1e-300)


def _sought(context: Context, leave_out: frozenset[str]) -> list[Family]:
    """Return the families of friction with a memory, at the shapes that show at rest."""
    out = []
    for family in families(context, leave_out=leave_out):
        if not _is_sought(context, family):
            continue
        if family.effect == "stribeck":
            joint = context.machine.axis(str(family.axis)).index
            slow = [s for s in family.shapes if s["v_s"] < SLOW * context.speed(joint)]
            family = replace(family, shapes=slow)
        out.append(family)
    return out


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
        if not seen.judged or FORM * rows_of(seen.judged[0], here) > seen.judged[0].G:
            break
        best = polish(rest.context, ledger, seen.judged[0])
        threshold = _chance(rest, shelves, plain, best, (here, taken, step))
        if threshold > best.G:
            break
        rivals = tuple(j for j in seen.judged if j.key != best.key and j.identifiable)
        named.append(Named(best, rivals, threshold))
    return named


def _chance(
    rest: Ready,
    shelves: Sequence[Shelf],
    settings: Settings,
    best: Judged,
    where: tuple,  # type: ignore[type-arg]
) -> float:
    """Return the gain that healthy draws reach, drawn from the residual that the best leaves."""
    here, taken, step = where
    under = admit(here, [best])
    rng = np.random.default_rng([settings.seed, 50 + step])
    drawn = healthy_draws(under, build_ledger(under, rest.theta), settings.draws, rng)
    seen = screen(rest.context, shelves, build_ledger(here, rest.theta, drawn), settings, taken)
    return max(seen.threshold(settings.alpha), FORM * rows_of(best, here))


def _sure(
    rest: Ready,
    shelves: Sequence[Shelf],
    settings: Settings,
    given: Sequence[Judged],
    named: Sequence[Named],
) -> list[Named]:
    """Return them with what this motion's rows at rest can tell apart."""
    plain = replace(settings, leave_out=settings.leave_out | ELSEWHERE)
    known = calibrate(rest.context, rest.search_stage, rest.theta, shelves, plain)
    out = []
    for n in named:
        beside = [*given, *(m.judged for m in named if m is not n)]
        under, rng = admit(rest.search_stage, beside), np.random.default_rng([settings.seed, 41])
        same = not_isolable(rest.context, shelves, under, n.judged, plain)
        off = rejected(rest.search_stage, rest.theta, beside, [n.judged, *n.rivals], rng)
        out.append(replace(n, calibration=known, alike=same, rejected=off))
    return out


def _joined(start: Ready, rest: Ready, decision: Decision, named: Sequence[Named]) -> tuple[Ready, Decision]:
    """Return both with the found effects, their axes with rows at rest."""
    joints = {joint for n in named for joint in n.judged.joints}
    wider = with_rest_of(start, rest, joints)
    every = sorted([*decision.named, *named], key=lambda n: -n.judged.G)
    searched = wider.search_stage
    final = admit(searched, [*decision.quiet, *(n.judged for n in every)])
    return wider, replace(decision, named=tuple(every), searched=searched, stage=final)
