"""Forward steps with re-checks: name at most three effects, or none.

The threshold of a step is what healthy draws reach, drawn from the residual that the best candidate
leaves. An effect too small to matter joins the base without a name. After the steps each member is
judged again given the others, and replaced where another effect does its work better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.admission import Judged, Key, admit, joint_worth, worth_beside
from pinotwin.diagnosis.bank import Shelf, fill
from pinotwin.diagnosis.calibration import Calibration, calibrate
from pinotwin.diagnosis.confidence_set import rejected
from pinotwin.diagnosis.context import Context
from pinotwin.diagnosis.healthy import healthy_draws
from pinotwin.diagnosis.isolability import not_isolable
from pinotwin.diagnosis.ledger import Ledger, build_ledger
from pinotwin.diagnosis.search import Screened, Settings, polish, screen
from pinotwin.diagnosis.shrinking import plain_stage
from pinotwin.diagnosis.stage import Stage
from pinotwin.diagnosis.trivial import left_by, trivial

LOWEST = 20.0  # no threshold is lower
PAIRED = 6  # best effects of which all pairs are judged jointly


@dataclass(frozen=True)
class Named:
    """One effect that was found, with what else could do its work.

    Attributes:
        judged: the effect given the other ones.
        rivals: other effects given the other ones, best first.
        threshold: held-out gain that a healthy machine reaches.
        calibration: of its own search, where that was not the one of the decision.
        alike: other effects that this motion cannot tell from it.
        rejected: rivals that the data reject: their p-values in the model confidence set.
    """

    judged: Judged
    rivals: tuple[Judged, ...]
    threshold: float
    calibration: Calibration | None = None
    alike: tuple[Key, ...] = ()
    rejected: Mapping[Key, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Decision:
    """What a search decided.

    Attributes:
        named: effects, largest gain first.
        quiet: effects admitted without a name: too small to matter, or never known to the twin.
        leavings: what the columns of named effects leave over, which looked like effects of their own.
        searched: the stage that was searched.
        stage: with all of them in its base.
        first: the first screen, of the base alone.
        unseen: effects that this log cannot tell from the base, as (effect, axis).
        calibration: what the motion can tell apart, found before the data were looked at.
        steps: threshold and best gain of every step.
    """

    named: tuple[Named, ...]
    quiet: tuple[Judged, ...]
    searched: Stage
    stage: Stage
    first: Screened
    unseen: tuple[Key, ...]
    calibration: Calibration
    steps: tuple[tuple[float, float], ...] = field(default=())
    leavings: tuple[Judged, ...] = field(default=())


def decide(
    context: Context,
    stage: Stage,
    theta: Floats,
    settings: Settings,
    tell: Callable[[str, float], None],
) -> Decision:
    """Name the effects that the base model misses."""
    tell("building the catalogue on this motion", 0.15)
    shelves = fill(context, stage, settings.leave_out)
    tell("what this motion can tell apart", 0.22)
    calibration = calibrate(context, stage, theta, shelves, settings)
    search = _Search(context, shelves, stage, theta, settings)
    first = search.run(tell)
    tell("checking the found effects against each other", 0.8)
    named = tuple(search.compared(n) for n in search.rechecked())
    unseen = tuple(j.key for j in first.judged if not j.identifiable)
    final = admit(stage, [*search.quiet, *(n.judged for n in named)])
    left = tuple(j for j, _ in search.leavings)
    return Decision(
        named, tuple(search.quiet), stage, final, first, unseen, calibration, tuple(search.steps), left
    )


@dataclass
class _Search:
    """Forward steps; what was found so far."""

    context: Context
    shelves: Sequence[Shelf]
    stage: Stage
    theta: Floats
    settings: Settings
    found: list[Judged] = field(default_factory=list)
    quiet: list[Judged] = field(default_factory=list)
    steps: list[tuple[float, float]] = field(default_factory=list)
    leavings: list[tuple[Judged, Key]] = field(default_factory=list)
    limits: dict[Key, float] = field(default_factory=dict)

    @property
    def admitted(self) -> list[Judged]:
        """All that is in the base by now, named or not."""
        return [*self.quiet, *(j for j, _ in self.leavings), *self.found]

    def beside(self, member: Judged) -> list[Judged]:
        """Return what a member is judged beside: all but itself and what it leaves over."""
        left = (j for j, owner in self.leavings if owner != member.key)
        return [*self.quiet, *left, *(j for j in self.found if j is not member)]

    def run(self, tell: Callable[[str, float], None]) -> Screened:
        """Admit one effect (or a pair) after the other; return the first screen."""
        rough = plain_stage(self.stage)
        first: Screened | None = None
        for step in range(self.settings.most + 3):
            tell(f"screening, step {step + 1}", 0.3 + 0.08 * step)
            taken = [j.key for j in self.admitted]
            here = admit(self.stage, self.admitted)
            ledger = build_ledger(here, self.theta)
            seen = self._screen(ledger, taken)
            first = first or seen
            full = len(self.found) >= self.settings.most
            if not seen.judged or LOWEST > seen.judged[0].G or full:
                break
            best = [self._simplest(ledger, seen)]
            best = self._pair(ledger, seen, best[0]) or best
            best = self._significant(here, ledger, best, _heads(seen, best), step)
            if not best:
                break
            self._take(best, here, admit(rough, self.admitted))
        assert first is not None
        return first

    def _take(self, best: Sequence[Judged], here: Stage, plain: Stage) -> None:
        """Admit one effect, by name or without, or a pair."""
        for j in best:
            owner = self._owner(j) if len(best) == 1 else None
            if owner is not None:
                self.leavings.append((j, owner))
            elif len(best) == 1 and (j.key in here.base.unknown or trivial(j, here, plain)):
                self.quiet.append(j)
            else:
                self.found.append(j)

    def _owner(self, judged: Judged) -> Key | None:
        """Return the found effect that leaves something over that looks like an effect, or None."""
        for other in self.found:
            if left_by(other, other.G, judged):
                beside = [*self.beside(other), judged]
                gain = worth_beside(self.stage, self.theta, other, beside)
                if left_by(other, gain, judged):
                    return other.key
        return None

    def _simplest(self, ledger: Ledger, seen: Screened) -> Judged:
        """Return the best effect at its best shape; a plain ripple where a modulated one adds little.

        Between the pitches of the grid a modulation takes up what the pitch is off by.
        """
        best = polish(self.context, ledger, seen.judged[0])
        plain = [j for j in seen.judged if j.key == ("ripple", best.key[1])]
        if best.key[0] != "ripple_modulated" or not plain:
            return best
        simple = polish(self.context, ledger, plain[0])
        return simple if simple.G + max(6.0, 0.02 * best.G) > best.G else best

    def _screen(self, ledger: Ledger, taken: Sequence[Key]) -> Screened:
        return screen(self.context, self.shelves, ledger, self.settings, taken)

    def _significant(
        self, here: Stage, ledger: Ledger, best: list[Judged], others: Sequence[Judged], step: int
    ) -> list[Judged]:
        """Return the best, or else the best of another axis, that healthy draws do not reach."""
        limits = self._chance(here, [*best, *others], step)
        top = max(best, key=lambda j: j.G)
        self.steps.append((limits[top.key[1]], top.G))
        if limits[top.key[1]] > top.G:
            past = [j for j in others if limits[j.key[1]] < j.G]
            best = [polish(self.context, ledger, past[0])] if past else []
        self.limits |= {j.key: limits[j.key[1]] for j in best}
        return best

    def _chance(self, here: Stage, best: Sequence[Judged], step: int) -> dict[str | None, float]:
        """Return per axis the gain that healthy draws reach, drawn from what the best ones leave."""
        under = admit(here, best)
        rng = np.random.default_rng([self.settings.seed, step])
        drawn = healthy_draws(under, build_ledger(under, self.theta), self.settings.draws, rng)
        taken = [j.key for j in self.admitted]
        seen = self._screen(build_ledger(here, self.theta, drawn), taken)
        found = seen.thresholds(self.settings.alpha)
        return {axis: max(x, LOWEST) for axis, x in found.items()}

    def _pair(self, ledger: Ledger, seen: Screened, best: Judged) -> list[Judged] | None:
        """Return two effects that together beat the best one with its best company, or None.

        Greedy steps miss pairs that hide each other.
        """
        if len(self.found) + 2 > self.settings.most:
            return None
        some = [best, *(j for j in seen.judged[1:] if j.identifiable and LOWEST < j.G)][:PAIRED]
        gains = {(a, b): joint_worth(ledger, some[a], some[b]) for a, b in combinations(range(len(some)), 2)}
        with_best = [g for (a, _), g in gains.items() if a == 0]
        others = {k: g for k, g in gains.items() if k[0] != 0}
        if not others:
            return None
        (a, b), top = max(others.items(), key=lambda x: x[1])
        if max([best.G, *with_best]) + max(20.0, 0.05 * top) > top:
            return None
        return [some[a], some[b]]

    def rechecked(self) -> tuple[Named, ...]:
        """Judge each member given the others; drop or swap it; two rounds at most."""
        named: list[Named] = []
        for _ in range(2):
            named, changed = [], False
            for k, member in enumerate(list(self.found)):
                others = self.beside(member)
                ledger = build_ledger(admit(self.stage, others), self.theta)
                seen = self._screen(ledger, [j.key for j in others])
                like = [j for j in seen.judged if j.joints & member.joints] or [member]
                best = polish(self.context, ledger, like[0])
                own = next((j for j in like if j.key == member.key), member)
                own = best if best.key == own.key else polish(self.context, ledger, own)
                limit = self.limits.get(member.key, LOWEST)
                if limit > max(best.G, own.G):
                    self.found, changed = [j for j in self.found if j is not member], True
                    break
                if best.key != member.key and own.G + max(6.0, 0.02 * own.G) < best.G:
                    own, changed = best, True
                    self.limits[own.key] = limit
                    self.leavings = [(j, own.key if o == member.key else o) for j, o in self.leavings]
                self.found[k] = own
                rivals = tuple(j for j in like if j.key != own.key and j.identifiable)
                named.append(Named(own, rivals[:12], limit))
            if not changed:
                break
        named.sort(key=lambda n: -n.judged.G)
        return tuple(named)

    def compared(self, named: Named) -> Named:
        """Return a found effect with what else it may be, and what it can not."""
        beside = self.beside(next(j for j in self.found if j.key == named.judged.key))
        under, rng = admit(self.stage, beside), np.random.default_rng([self.settings.seed, 40])
        same = not_isolable(self.context, self.shelves, under, named.judged, self.settings)
        out = rejected(self.stage, self.theta, beside, [named.judged, *named.rivals], rng)
        return replace(named, alike=same, rejected=out)


def _heads(seen: Screened, best: Sequence[Judged]) -> list[Judged]:
    """Return the best effect of every axis that the best ones are not on."""
    out: dict[str | None, Judged] = {}
    taken = {j.key[1] for j in best}
    for j in seen.judged:
        if j.key[1] not in taken and LOWEST < j.G and j.identifiable:
            out.setdefault(j.key[1], j)
    return list(out.values())
