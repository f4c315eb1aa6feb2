"""Forward steps with re-checks: name at most three effects, or none.

The threshold of a step is what healthy draws reach, drawn from the residual that the best candidate
leaves. An effect too small to matter joins the base without a name. After the steps each member is
judged again given the others, and replaced where another effect does its work better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.bank import Shelf, fill
from pinotwin.diagnosis.calibration import Calibration, calibrate
from pinotwin.diagnosis.context import Context
from pinotwin.diagnosis.healthy import healthy_draws
from pinotwin.diagnosis.ledger import Ledger, build_ledger, residual_of
from pinotwin.diagnosis.search import (
    Judged,
    Key,
    Screened,
    Settings,
    admit,
    joint_worth,
    polish,
    screen,
)
from pinotwin.diagnosis.shrinking import plain_stage
from pinotwin.diagnosis.stage import Stage

LATENCY = 3e-4  # [s] a delay below this is every machine's own and gets no name
MATTERS = 0.01  # gap power over noise power below which an effect is too small to matter
LEFT_OVER = 0.10  # of an effect's gain: what its linearised column may leave for others on its axis
LEFT_OVER_ELSEWHERE = 0.03  # the same for other axes, which share the rigid body with it
LOWEST = 18.0  # no threshold is lower
LOWEST_CHANGE = 20.0  # the same against a twin, whose own small errors count as well
PAIRED = 6  # best effects of which all pairs are judged jointly


@dataclass(frozen=True)
class Named:
    """One effect that was found, with what else could do its work.

    Attributes:
        judged: the effect given the other ones.
        rivals: other effects given the other ones, best first.
        threshold: held-out gain that a healthy machine reaches.
        calibration: of its own search, where that was not the one of the decision.
    """

    judged: Judged
    rivals: tuple[Judged, ...]
    threshold: float
    calibration: Calibration | None = None


@dataclass(frozen=True)
class Decision:
    """What a search decided.

    Attributes:
        named: effects, largest gain first.
        quiet: effects admitted without a name.
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


def decide(
    context: Context, stage: Stage, theta: Floats, settings: Settings,
    tell: Callable[[str, float], None],
) -> Decision:  # fmt: skip
    """Name the effects that the base model misses."""
    tell("building the catalogue on this motion", 0.15)
    shelves = fill(context, stage, settings.leave_out)
    tell("what this motion can tell apart", 0.22)
    calibration = calibrate(context, stage, theta, shelves, settings)
    search = _Search(context, shelves, stage, theta, settings)
    first = search.run(tell)
    tell("checking the found effects against each other", 0.8)
    named = search.rechecked()
    unseen = tuple(j.key for j in first.judged if not j.identifiable)
    final = admit(stage, [*search.quiet, *(n.judged for n in named)])
    return Decision(
        named, tuple(search.quiet), stage, final, first, unseen, calibration, tuple(search.steps)
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
    threshold: float = 20.0

    @property
    def lowest(self) -> float:
        return LOWEST_CHANGE if self.stage.base.change else LOWEST

    def run(self, tell: Callable[[str, float], None]) -> Screened:
        """Admit one effect (or a pair) after the other; return the first screen."""
        rough = plain_stage(self.stage)
        first: Screened | None = None
        for step in range(self.settings.most + 3):
            tell(f"screening, step {step + 1}", 0.3 + 0.08 * step)
            taken = [j.key for j in (*self.quiet, *self.found)]
            here = admit(self.stage, [*self.quiet, *self.found])
            ledger = build_ledger(here, self.theta)
            seen = self._screen(ledger, taken)
            first = first or seen
            full = len(self.found) >= self.settings.most
            if not seen.judged or self.lowest > seen.judged[0].G or full:
                break
            best = [self._simplest(ledger, seen)]
            best = self._pair(ledger, seen, best[0]) or best
            self.threshold = self._chance(here, best, taken, step)
            self.steps.append((self.threshold, best[0].G))
            if self.threshold > max(j.G for j in best):
                break
            plain = admit(rough, [*self.quiet, *self.found])
            for j in best:
                trivial = len(best) == 1 and _trivial(j, here, self.found, plain)
                (self.quiet if trivial else self.found).append(j)
        assert first is not None
        return first

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

    def _chance(
        self, here: Stage, best: Sequence[Judged], taken: Sequence[Key], step: int
    ) -> float:  # fmt: skip
        """Return the gain that healthy draws reach, drawn from the residual that the best leaves."""
        under = admit(here, best)
        rng = np.random.default_rng([self.settings.seed, step])
        drawn = healthy_draws(under, build_ledger(under, self.theta), self.settings.draws, rng)
        seen = self._screen(build_ledger(here, self.theta, drawn), taken)
        return max(seen.threshold(self.settings.alpha), self.lowest)

    def _pair(self, ledger: Ledger, seen: Screened, best: Judged) -> list[Judged] | None:
        """Return two effects that together beat the best one with its best company, or None.

        Greedy steps miss pairs that hide each other.
        """
        if len(self.found) + 2 > self.settings.most:
            return None
        some = [best, *(j for j in seen.judged[1:] if j.identifiable and self.lowest < j.G)][
            :PAIRED
        ]
        gains = {(a, b): joint_worth(ledger, some[a], some[b])
                 for a, b in combinations(range(len(some)), 2)}  # fmt: skip
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
                others = [j for j in self.found if j is not member]
                ledger = build_ledger(admit(self.stage, [*self.quiet, *others]), self.theta)
                seen = self._screen(ledger, [j.key for j in (*self.quiet, *others)])
                best = polish(self.context, ledger, seen.judged[0])
                own = next((j for j in seen.judged if j.key == member.key), member)
                own = best if best.key == own.key else polish(self.context, ledger, own)
                if self.threshold > max(best.G, own.G):
                    self.found, changed = others, True
                    break
                if best.key != member.key and own.G + max(6.0, 0.02 * own.G) < best.G:
                    own, changed = best, True
                self.found[k] = own
                rivals = tuple(j for j in seen.judged if j.key != own.key and j.identifiable)
                named.append(Named(own, rivals[:12], self.threshold))
            if not changed:
                break
        named.sort(key=lambda n: -n.judged.G)
        return tuple(named)


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
    if least > judged.G:
        return True
    if stage.base.change:  # a twin's own parameters absorb a change, at the price of their prior
        return least > _effort(judged, plain)
    return least > _power(plain) - _power(admit(plain, [judged]))


def _effort(judged: Judged, stage: Stage) -> float:
    """Return the squared effort of an effect on a plain stage, in units of the noise."""
    columns = stage.project(judged.candidate.columns)
    return float(sum(np.sum((x @ judged.theta) ** 2) for x in columns if x is not None))


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
