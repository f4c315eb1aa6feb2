"""Causes one after the other: the one that closes most on unseen rows first, each beside those before it.

A candidate must close a positive share of its axis' residual on rows that were not fitted, with an interval above
zero, and its size be many times what leaving out stretches moves it by. Of those that close as much, the one with
fewest numbers is taken. Where a pattern without a name wins, nothing is named; friction by which runs may differ is no
cause, and what closes less than it is judged beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import Joined, named
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.data.scatter import by_days, scattered
from pinotwin.diagnosis.evidence.bodies import possible
from pinotwin.diagnosis.evidence.bootstrap import lower_bound
from pinotwin.diagnosis.evidence.held_out import Judged
from pinotwin.diagnosis.evidence.springs import fits
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.parsimony import Duel, duel, richer
from pinotwin.diagnosis.search.scan import Scored, Searcher, Table, listed_elsewhere
from pinotwin.diagnosis.search.shortlist import Shortlist
from pinotwin.effects import Effect
from pinotwin.effects.family import FRICTION, TRANSMISSION


@dataclass(frozen=True, eq=False)
class Step:
    """One turn of the search."""

    chosen: Scored  # what was taken in
    rivals: Sequence[Scored]  # the other best candidates of that turn, one a name and axis, best first
    searcher: Searcher = field(repr=False)  # the ground on which the turn was made
    # trials against a relative with more numbers, if one closed more
    duel: Duel | None = field(default=None, repr=False)
    instead: Sequence[Scored] = ()  # causes of one axis each, for which it stands

    def again(self, simplest: Scored, fit: Sequence[Scored], scored: Sequence[Scored]) -> Scored:
        """Return what is chosen on other logs: the same questions, put again."""
        if self.duel is not None:
            return self.duel.again(simplest, fit)
        keys = {one.key for one in self.instead}
        if simplest.key not in keys:
            return simplest
        both = sum(one.gain for one in scored if one.key in keys)
        return next((one for one in fit if one.key == self.chosen.key and one.gain >= both), simplest)


@dataclass(frozen=True, eq=False)
class Found:
    """What a search has found."""

    steps: Sequence[Step]  # turns, in order
    # the best candidate that was not taken in, and why not; None if there was none
    last: tuple[Scored, str] | None
    # friction by which runs differ, then the best candidates of the last turn, one a name and axis, best first
    left: Sequence[Scored] = field(repr=False)
    first: Searcher = field(repr=False)  # the ground without any cause
    # the ground with all causes among its columns, and those that the machine lists already
    searcher: Searcher = field(repr=False)


def search(
    comparison: Comparison,
    candidates: Sequence[Effect],
    *,
    rules: Rules = RULES,
    most: int | None = None,
    tell: Callable[[str, float], None] | None = None,
) -> Found:
    """Return the causes that the data support."""
    first = searcher = Searcher(comparison)
    shortlist = Shortlist(candidates, rules)
    steps: list[Step] = []
    usual: list[Scored] = []
    listed: list[Scored] = []
    last, ranked = None, list[Scored]()
    while len(steps) < (most or rules.most):
        if tell:
            tell("searching for causes", len(steps) / (len(steps) + 2.0))
        ranked = rank(searcher, shortlist.of(searcher))
        taken = {one.key for one in (*(s.chosen for s in steps), *listed)}
        answers = [(r, refused(r, searcher, rules)) for r in ranked if r.key not in taken]
        causes = [(r, why) for r, why in answers if not _a_trace(r, steps, searcher, rules)]
        fit = [r for r, why in causes if not why and not _doubtful(r, answers)]
        if not comparison.change:
            fit = _with_play(fit, causes, searcher, rules)
        last = answers[0] if answers else None
        if not fit:
            break
        scatters = [r for r, why in answers if why.endswith(_BY_SCATTER)]
        friction = _usual_before(fit, scatters, {one.joint for one in usual})
        if friction is not None:
            usual.append(friction)
            searcher = _beside(comparison, steps, [*listed, *usual])
            continue
        able = _richest(fit)
        winner = simplest(able, searcher, rules)
        held = _duel(winner, able, searcher, rules)
        winner = winner if held is None else held.won_by(held.simpler, held.richer)
        winner = _first_of_two(winner, able, searcher, shortlist, rules)
        rivals = [r for r in one_each(ranked) if r.key != winner.key]
        steps.append(Step(winner, rivals, searcher, held))
        if not isinstance(winner.effect, Pattern):
            steps = _without_superfluous(comparison, steps, [*listed, *usual], rules)
        steps = _as_one(steps, rules)
        searcher = _beside(comparison, steps, [*listed, *usual])
        own = [s for s in steps if listed_elsewhere(s.chosen, searcher, rules)]
        steps, listed = [s for s in steps if s not in own], [*listed, *(s.chosen for s in own)]
    if usual:
        searcher = _beside(comparison, steps, listed)
    return Found(steps, last, [*usual, *one_each(ranked)], first, searcher)


def _beside(comparison: Comparison, steps: Sequence[Step], more: Sequence[Scored]) -> Searcher:
    """Return the ground with the causes of some steps among its columns, and what is there but is no cause."""
    return Searcher(comparison, [*(s.chosen for s in steps), *more])


def _first_of_two(
    winner: Scored, able: Sequence[Scored], searcher: Searcher, shortlist: Shortlist, rules: Rules
) -> Scored:
    """Return the first of two plain causes that together close as much as a table or a curve, with fewer numbers."""
    if winner.numbers < rules.rich or not named(winner.effect).held:
        return winner
    plain = [r for r in able if _plain_beside(winner, r, rules)]
    if not plain:
        return winner
    first = simplest(sorted(plain, key=lambda r: -r.gain), searcher, rules)
    if first.gain < rules.first_part * winner.gain:
        return winner
    beside = Searcher(searcher.comparison, [*searcher.found, first])
    ranked = rank(beside, shortlist.of(beside))
    second = next((r for r in ranked if _plain_beside(winner, r, rules)), None)
    if second is None or first.numbers + second.numbers >= winner.numbers:
        return winner
    return first if first.gain + second.gain > rules.as_good_kin * winner.gain else winner


def _as_one(steps: Sequence[Step], rules: Rules) -> list[Step]:
    """Return the causes with one of several axes for two of one axis each, where it closes as much as both together.

    A load's weight looks like a drive's scale on the axis that lifts it, and its inertia is a small gap of another.
    """
    last = steps[-1].chosen
    for at, step in enumerate(steps[:-1]):
        both = {step.chosen.joint, last.joint}
        if len(both) < 2 or max(len(one.table[0]) for one in (step.chosen, last)) > 1:
            continue
        for one in step.rivals:
            alone = both <= set(one.table[0]) and one.gain >= step.chosen.gain + last.gain
            if alone and not refused(one, step.searcher, rules):
                pair = (step.chosen, last)
                rivals = [*pair, *(r for r in step.rivals if r.key not in {one.key, last.key})]
                kept = [s for s in steps[:-1] if s is not step]
                return [*kept[:at], Step(one, rivals, step.searcher, instead=pair), *kept[at:]]
    return list(steps)


def _plain_beside(rich: Scored, one: Scored, rules: Rules) -> bool:
    """Whether a candidate has few numbers, and acts where a table or a curve does and on what that depends on."""
    if isinstance(one.effect, Pattern) or one.numbers >= rules.rich or one.joint != rich.joint:
        return False
    return named(one.effect).depends == named(rich.effect).depends


def _usual_before(fit: Sequence[Scored], scatters: Sequence[Scored], known: Collection[int]) -> Scored | None:
    """Return friction by which runs may differ that closes more than what would be named on its axis, if any."""
    best = {one.joint: one for one in reversed(fit)}
    beating = (s for s in scatters if s.joint in best and s.gain > best[s.joint].gain)
    return next((s for s in beating if s.joint not in known), None)


def _a_trace(one: Scored, steps: Sequence[Step], searcher: Searcher, rules: Rules) -> bool:
    """Whether a candidate is small beside the gap of an axis that has a cause: what its form leaves over."""
    same = [named(s.chosen.effect) for s in steps if s.chosen.joint == one.joint]
    if not same:
        return False
    before, now = (s.power((one.joint,)) for s in (steps[0].searcher, searcher))
    name = named(one.effect).name
    if any(name in e.imitates or name in e.contains for e in same):
        return one.gain < rules.second_share_kin * before
    most = rules.second_part * now
    return one.gain < rules.second_share * before and (
        one.gain < most or one.gain < rules.second_rows * _rows(one, searcher.comparison)
    )


TURNING = ("presliding", "hysteresis")  # What friction keeps in mind as it turns round

_UNCERTAIN = "squared standard errors a number"
_BY_SCATTER = "of the friction, by which runs of one machine may differ"
_NOTHING_CERTAIN = "explains nothing for certain on held-out rows"


def _doubtful(one: Scored, answers: Sequence[tuple[Scored, str]]) -> bool:
    """Whether play or a spring that looks like a candidate closes more of its axis, and is only not certain."""
    return any(
        (why.endswith(_UNCERTAIN) or why == _NOTHING_CERTAIN)
        and better.key[1] == one.key[1]
        and better.gain > one.gain
        and _looks_like(better, one)
        for better, why in answers
    )


def _with_play(
    fit: Sequence[Scored], answers: Sequence[tuple[Scored, str]], searcher: Searcher, rules: Rules
) -> list[Scored]:
    """Return candidates that are taken in, best first, with play and springs that close more than a delay."""
    least = replace(rules, share_played=rules.share_structure)
    late = [r for r, why in answers if why and any(_less_and_late(one, r) for one in fit)]
    more = [r for r in late if not refused(r, searcher, least)]
    return sorted([*fit, *more], key=lambda r: -r.gain) if more else list(fit)


def _less_and_late(one: Scored, played: Scored) -> bool:
    """Whether a candidate is a delay of the same axis as play or a spring that looks like it, and closes less."""
    late = named(one.effect).name == "delay" and one.key[1] == played.key[1]
    return late and one.gain < played.gain and _looks_like(played, one)


def _looks_like(played: Scored, one: Scored) -> bool:
    """Whether a candidate is play or a spring, and another one what that is taken for."""
    effect = named(played.effect)
    return effect.family is TRANSMISSION and named(one.effect).name in effect.imitates


def _richest(fit: Sequence[Scored]) -> list[Scored]:
    """Return the candidate with most numbers of every name and axis: few points stand in for many told too badly."""
    most: dict[tuple[str, str | None], int] = {}
    for one in fit:
        most[one.key] = max(one.numbers, most.get(one.key, 0))
    return [one for one in fit if one.numbers == most[one.key]]


def _without_superfluous(
    comparison: Comparison, steps: Sequence[Step], beside: Sequence[Scored], rules: Rules
) -> list[Step]:
    """Return the causes without those that the last one has made needless, beside what is there but is no cause."""
    kept = list(steps)
    for step in list(steps[:-1]):
        others = _beside(comparison, [s for s in kept if s is not step], beside)
        again = others.score(step.chosen.effect, step.chosen.table)
        if again is None or again.gain < rules.needless * step.chosen.gain:
            kept.remove(step)
    return kept


POLISHED, NEAR = 6, 0.5
"""Candidates of one turn whose shapes are polished: so many, if they close this share of the best."""


def rank(searcher: Searcher, tables: Sequence[tuple[Effect, Table]]) -> list[Scored]:
    """Return the best candidate of every name, axis and number of coefficients, shapes polished, best first.

    A table of few points may stand where a finer one, which closes more, is told too badly by a short log.
    """
    best: dict[tuple[str, str | None, int], Scored] = {}
    for effect, table in tables:
        one = _admitted(searcher.score(effect, table), searcher)
        if one is None or one.gain <= 0.0:
            continue
        group = (*one.key, one.numbers)
        if group not in best or one.gain > best[group].gain:
            best[group] = one
    ranked = sorted(best.values(), key=lambda s: -s.gain)
    near = [s for s in one_each(ranked)[:POLISHED] if s.gain > NEAR * ranked[0].gain]
    better = {id(s): t for s in near if (t := _admitted(searcher.polished(s), searcher)) is not None}
    return sorted((better.get(id(s), s) for s in ranked), key=lambda s: -s.gain)


def one_each(ranked: Sequence[Scored]) -> list[Scored]:
    """Return the first candidate of every name and axis."""
    first: dict[tuple[str, str | None], Scored] = {}
    for one in ranked:
        first.setdefault(one.key, one)
    return list(first.values())


def simplest(ranked: Sequence[Scored], searcher: Searcher, rules: Rules) -> Scored:
    """Return the candidate with fewest numbers among those that close as much as the best.

    A relative with fewer numbers may close a little less, for the richer one can bend itself to what the model never
    had; likewise an effect of the catalogue beside a pattern. What no relative leaves of a very large gap is many
    times what the twin leaves: it is not passed over, nor is what the best does not leave, if that leaves no more than
    the twin does. Of as many numbers the one on fewer axes is taken (a constant force of one of two slides that stand
    upright on each other looks like a shared inertia), of bodies that on the last link. What closes the gaps of
    several axes of a change is not replaced by what closes one.
    """
    best = _best_effect(ranked, rules)
    several = _also_closed(best, searcher, rules)
    kin = {*named(best.effect).contains, *named(best.effect).imitates, *named(best.effect).inseparable}
    most = _most_left(best, searcher, rules)
    close = []
    for one in ranked:
        related = one is best or (one.joint == best.joint and named(one.effect).name in kin)
        enough = rules.as_good_kin if related else rules.as_good
        near = one.gain >= enough * best.gain and (related or best.gain - one.gain < most)
        if near and several <= set(one.table[0]):
            close.append(one)
    return min(close, key=lambda s: (s.numbers, -_link(s), len(s.table[0]), -s.gain))


def _most_left(best: Scored, searcher: Searcher, rules: Rules) -> float:
    """Return by how much less than the best a candidate that is no relative of it may close, floor units."""
    c = searcher.comparison
    if not c.change:
        return np.inf
    return _rows(best, c) * (rules.as_good_left if met(best, searcher, rules) else rules.as_good_most)


def met(one: Scored, searcher: Searcher, rules: Rules) -> bool:
    """Whether a cause leaves of its axis no more than the twin does anyway."""
    before = searcher.power((one.joint,))
    closed = sum(float(x.sum()) for x in searcher.main_gains(one))
    return before - closed < rules.met * _rows(one, searcher.comparison)


def _duel(winner: Scored, able: Sequence[Scored], searcher: Searcher, rules: Rules) -> Duel | None:
    """Return the trials of the winner against a relative with more numbers, if one closes more."""
    rival = richer(winner, able)
    if rival is None or searcher.comparison.own is None:
        return None
    return duel(winner, rival, searcher.comparison, rules, finest_of(rival, searcher, rules))


def finest_of(rival: Scored, searcher: Searcher, rules: Rules) -> float:
    """Return how well trials may agree; of a rival that leaves what the twin does its absolute lead counts."""
    if not met(rival, searcher, rules):
        return rules.least_spread
    return min(rules.least_spread, rules.least_left * _rows(rival, searcher.comparison) / rival.gain)


def _best_effect(ranked: Sequence[Scored], rules: Rules) -> Scored:
    """Return the best candidate; where that is a pattern, the best simpler effect that closes nearly as much."""
    best = ranked[0]
    if not isinstance(best.effect, Pattern):
        return best
    enough = rules.as_good_kin if best.numbers <= 3 else rules.as_good_curve
    simpler = (r for r in ranked if r.joint == best.joint and r.numbers <= best.numbers)
    near = (r for r in simpler if not isinstance(r.effect, Pattern) and r.gain >= enough * best.gain)
    return next(near, best)


def _also_closed(one: Scored, searcher: Searcher, rules: Rules) -> set[int]:
    """Return the joints whose gap a candidate closes by more than the twin's misfit may differ by; of a change."""
    c = searcher.comparison
    if len(one.table[0]) < 2 or not c.change:
        return set()
    out = set()
    for at, j in enumerate(c.new.joints):
        if j not in one.table[0]:
            continue
        closed = float(searcher.gains_at(one, j)[0].sum())
        power = float(searcher.alone_by_joint[0][:, at].sum())
        if closed > max(rules.excess * len(c.new.residual[j]), rules.share * power):
            out.add(j)
    return out


def _link(one: Scored) -> int:
    effect = named(one.effect)
    body = effect.name == "payload" and effect.axis is not None
    return one.order if body else 0


def _admitted(one: Scored | None, searcher: Searcher) -> Scored | None:
    """Return a candidate with its coefficients held to what they can be; None where it asks for what no machine has."""
    if one is None or not allowed(one, searcher.comparison):
        return None
    if isinstance(one.effect, (Pattern, Joined)) or named(one.effect).name == "payload":
        return one
    low, high = (x - known(one.effect, searcher.comparison) for x in _bounds(one, searcher.comparison))
    theta = one.judged.theta
    return one if ((low <= theta) & (theta <= high)).all() else searcher.bounded(one, low, high)


def allowed(one: Scored, comparison: Comparison) -> bool:
    """Whether the coefficients, once they have changed, can be those of the effect: by two standard errors."""
    if isinstance(one.effect, Pattern):
        return True
    theta, covariance = one.judged.theta, one.judged.covariance
    if one.effect.name == "payload":
        return possible(theta, covariance, comparison.machine.model, removal=comparison.change)
    if isinstance(one.effect, Joined):
        return _dissipates(one, comparison)
    played = one.effect.family is TRANSMISSION and not comparison.change
    if played and not fits(comparison, one.judged, one.joint):
        return False
    error = 2.0 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if one.effect.logged_effort:
        error = -error  # a factor that is not told from zero measures no effort
    value = known(one.effect, comparison) + theta
    low, high = _bounds(one, comparison)
    return bool(((low - error <= value) & (value <= high + error)).all()) and one.effect.possible(theta)


def _bounds(one: Scored, comparison: Comparison) -> tuple[Floats, Floats]:
    """Return within which values the coefficients of an effect lie."""
    low, high = (np.array([getattr(c, x) for c in one.effect.coefficients()]) for x in ("lower", "upper"))
    if one.effect.logged_effort and one.effect.axis in comparison.gate.turned:
        factor = np.isfinite(low)  # that drive counts its effort the other way
        return np.where(factor, -np.inf, low), np.where(factor, low, high)
    # A machine's inertia was fitted without the spring: what that leaves of it is no bound for the load's.
    bounded = comparison.change or one.effect.family is not TRANSMISSION
    return low, high if bounded else np.full_like(high, np.inf)


def _dissipates(one: Scored, comparison: Comparison) -> bool:
    """Whether friction that changes in the course of a log brakes in every stretch of it."""
    j, new = one.joint, comparison.new
    course = one.table[0][j] @ (known(one.effect, comparison, one.judged) + one.judged.theta)
    power = np.bincount(new.block[j], course * new.motion.v[new.samples(j), j], new.blocks)
    return bool((power >= -1e-9 * np.abs(power).max(initial=0.0)).all())


def known(effect: Effect, comparison: Comparison, beside: Judged | None = None) -> Floats:
    """Return the coefficients that the base has of an effect of the same kind; zeros where it has none."""
    if isinstance(effect, Joined):
        return np.concatenate([known(part, comparison, beside) for part in effect.parts])
    twin = comparison.twin
    for own, where in zip(twin.effects, twin.slices, strict=True):
        if (own.name, own.axis) == (effect.name, effect.axis) and comparison.change:
            if len(twin.theta[where]) == len(effect.coefficients()):
                return twin.theta[where]
        elif (own.name, own.axis) == (effect.name, effect.axis) and beside is not None:
            return twin.theta[where] + beside.base[where]
    return np.zeros(len(effect.coefficients()))


def refused(one: Scored, searcher: Searcher, rules: Rules) -> str:
    """Return why a candidate is not taken in; empty if it is."""
    c = searcher.comparison
    share = one.share if c.change else _beyond_noise(one, searcher, rules)
    if share < _least_share(one, change=c.change, rules=rules):
        return f"explains {share:.0%} of its axis' residual"
    if one.judged.strength < (rules.strength_change if c.change else rules.strength_structure):
        return f"is {one.judged.strength:.1f} {_UNCERTAIN}"
    elsewhere = searcher.ground.alone.unseen - one.judged.unseen
    if lower_bound(one.judged, searcher.ground) <= 0.0 or (len(elsewhere) and elsewhere.sum() <= 0.0):
        return _NOTHING_CERTAIN
    closed = float(sum(x.sum() for x in searcher.main_gains(one)))
    small = not _complete(one, searcher, rules)
    if small and c.change and closed < rules.excess * _rows(one, c):
        return "explains less than the twin's validation error may vary"
    closed = c.floor[one.joint] * float(np.sqrt(max(closed, 0.0) / max(_rows(one, c), 1)))
    moved = closed / max(c.new.size(one.joint), 1e-300)
    least = rules.least_size(change=c.change) if small else rules.complete_size
    if not c.change and named(one.effect).name in TURNING and share < rules.turning_share:
        least = rules.turning
    if moved < least:
        return f"moves its axis' effort by {moved:.1%}"
    held_over = min(rules.cycle * c.new.motion.step, rules.longest_cycle)
    if not c.change and one.effect.name == "delay" and abs(one.judged.theta[0]) < held_over:
        return "is less than half a cycle, by which any drive leads that holds its effort"
    rubs = named(one.effect).family is FRICTION or isinstance(one.effect, Pattern)
    if (
        c.change
        and rubs
        and closed < (most := by_days(c, one.joint, rules)) * c.friction[one.joint]
        and _scatters(one, searcher, rules)
    ):
        return f"is no more than {most:.0%} {_BY_SCATTER}"
    return ""


def _least_share(one: Scored, *, change: bool, rules: Rules) -> float:
    if change:
        return rules.share
    played = named(one.effect).family is TRANSMISSION
    return rules.share_played if played else rules.share_structure


def _complete(one: Scored, searcher: Searcher, rules: Rules) -> bool:
    """Whether a cause closes most of what two runs of one command share beyond their noise."""
    c = searcher.comparison
    return (
        one.joint in c.noise
        and not (named(one.effect).family is FRICTION and named(one.effect).sharp)
        and one.numbers <= rules.complete_numbers
        and one.judged.strength > rules.complete_strength
        and _beyond_noise(one, searcher, rules) > rules.complete
    )


def _beyond_noise(one: Scored, searcher: Searcher, rules: Rules) -> float:
    """Return the share that a candidate closes of what is left without the noise, at the joints it acts on."""
    return one.gain / max(searcher.power_beyond_noise(one.table[0], rules.noise_part), 1e-300)


def _scatters(one: Scored, searcher: Searcher, rules: Rules) -> bool:
    """Whether friction that is the twin's own, only a little more or less of it, closes as much as a candidate.

    Another form of friction is no scatter: a level that goes with the load differs from run to run by no such curve.
    """
    c, j = searcher.comparison, one.joint
    closed = float(searcher.main_gains(one)[0].sum())
    left = searcher.residual()[j] * c.floor[j]
    return scattered(c, j, by_days(c, j, rules), left) > rules.scatter_part * closed


def _rows(one: Scored, comparison: Comparison) -> int:
    """Return the number of rows of the axis that a candidate moves most, validation logs included."""
    samples = [comparison.new, comparison.unseen]
    return sum(len(s.residual[one.joint]) for s in samples if s is not None and one.joint in s.joints)
