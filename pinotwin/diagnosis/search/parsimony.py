"""A cause with few numbers against a relative with more: which of the two would have left what was seen.

Either is put into the twin's own residual, and both are fitted (parametric bootstrap cross-fitting, Wagenmakers et al.
2004, doi:10.1016/j.jmp.2003.11.004): the richer, which may bend itself to what the twin never had, is taken only where
the simpler one's trials never come near what was seen. Of two that jump at reversals (Coulomb friction, hysteresis)
the simpler one stands: they differ at rows where no log knows the direction as well as a trial does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.rules import Rules
from pinotwin.diagnosis.search.scan import Scored, Searcher
from pinotwin.diagnosis.search.trials import TRIALS, trial
from pinotwin.effects.family import FRICTION


@dataclass(frozen=True, eq=False)
class Duel:
    """Two relatives, and the ratios of their gains where either is the truth."""

    simpler: Scored  # closes a little less with fewer numbers
    richer: Scored  # the other
    # logarithm of the richer one's gain over the simpler one's in trials with the simpler put in
    under_simpler: Floats
    under_richer: Floats  # the same with the richer put in
    rules: Rules  # thresholds
    finest: float  # trials that agree better than this tell no more [of the logarithm]

    def won_by(self, simpler: Scored, richer: Scored) -> Scored:
        """Return which of the two, as scored on some logs, would have left what is seen there."""
        if min(simpler.gain, richer.gain) <= 0.0:
            return simpler
        seen = float(np.log(richer.gain / simpler.gain))
        far, near = (_distance(seen, x, self.finest) for x in (self.under_simpler, self.under_richer))
        return richer if far > self.rules.outdone and near < self.rules.nearer * far else simpler

    def again(self, simplest: Scored, fit: Sequence[Scored]) -> Scored:
        """Return what is chosen on other logs where the simplest candidate is this: the same question, put again."""
        if simplest.key != self.simpler.key:
            return simplest
        return next((self.won_by(simplest, one) for one in fit if one.key == self.richer.key), simplest)


def richer(winner: Scored, fit: Sequence[Scored]) -> Scored | None:
    """Return the relative of the winner that closes most; None if there is none that closes more."""
    return max((one for one in fit if _relative(one, winner)), key=lambda one: one.gain, default=None)


def duel(winner: Scored, rival: Scored, comparison: Comparison, rules: Rules, finest: float) -> Duel:
    """Return the trials of the winner against a relative with more numbers."""
    rng = np.random.default_rng(0)
    under = [_ratios(comparison, put, winner, rival, rng) for put in (winner, rival)]
    return Duel(winner, rival, under[0], under[1], rules, finest)


def _relative(one: Scored, winner: Scored) -> bool:
    """Whether a candidate closes more than the winner, acts on the same joint, is like it, and no larger form of it."""
    if isinstance(one.effect, Pattern) or one.joint != winner.joint or one.gain <= winner.gain:
        return False
    a, b = named(one.effect), named(winner.effect)
    like = b.name in a.imitates or a.name in b.imitates
    jump = all(e.family is FRICTION and e.sharp for e in (a, b))
    return like and not jump and a.name != b.name and b.name not in a.contains


def _ratios(c: Comparison, put: Scored, winner: Scored, rival: Scored, rng: np.random.Generator) -> Floats:
    """Return the logarithm of the rival's gain over the winner's in trials with one of them put in."""
    out = []
    for _ in range(TRIALS):
        searcher = Searcher(trial(c, {}, put, rng))
        a, b = (searcher.score(one.effect, one.table) for one in (winner, rival))
        if a is not None and b is not None and min(a.gain, b.gain) > 0.0:
            out.append(float(np.log(b.gain / a.gain)))
    return np.asarray(out)


def _distance(seen: float, ratios: Floats, finest: float) -> float:
    """Return how many standard deviations a ratio lies off those of the trials; none where trials tell nothing."""
    if len(ratios) < TRIALS // 2:
        return 0.0
    return float(abs(seen - ratios.mean()) / max(ratios.std(ddof=1), finest))
