"""How sure a name is: the cause found, put into stretches of the residual that the model leaves anyway.

These (of a twin: of its own logs) are laid over the motion in another order. The confidence is the share of trials in
which the same search names the cause first: misfit that is no noise stays, and nothing Gaussian is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.forward import Found, Step, refused, simplest
from pinotwin.diagnosis.search.scan import Scored, Searcher
from pinotwin.diagnosis.search.trials import TRIALS, trial
from pinotwin.effects.effect import Effect, Paired

RIVALS = 5
NEAR = 0.9  # Share of the gain of what was named from which a rival is hardly told apart from it


def confidences(
    comparison: Comparison, found: Found, rng: np.random.Generator, *, rules: Rules = RULES
) -> list[float]:
    """Return the confidence of every cause of a search."""
    return [_confidence(comparison, found, step, rng, rules) for step in found.steps]


def _confidence(c: Comparison, found: Found, step: Step, rng: np.random.Generator, rules: Rules) -> float:
    entries = [step.chosen, *step.rivals[:RIVALS]]
    wins = 0
    for _ in range(TRIALS):
        searcher = Searcher(trial(c, found.searcher.residual(), step.chosen, rng))
        again = [x for e in entries if (x := searcher.score(e.effect, e.table)) is not None]
        fit = sorted((x for x in again if not refused(x, searcher, rules)), key=lambda x: -x.gain)
        if fit:
            first = simplest(fit, searcher, rules)
            wins += same_cause(step.again(first, fit, again), step.chosen)
    return posterior(wins, TRIALS, rules)


def posterior(wins: int, trials: int, rules: Rules) -> float:
    """Return the confidence after so many trials, some of them won."""
    return float((wins + rules.prior_right) / (trials + rules.prior_right + rules.prior_wrong))


def same_cause(a: Scored, b: Scored) -> bool:
    """Whether two candidates are one cause as far as any motion can tell."""
    one, other = named(a.effect), named(b.effect)
    alike = other.name in one.inseparable or one.name in other.inseparable
    return a.key == b.key or (alike and one.axis == other.axis) or _one_pair(one, other)


def _one_pair(a: Effect, b: Effect) -> bool:
    """Whether two effects are that between the same two axes, listed on either of them."""
    if not (isinstance(a, Paired) and isinstance(b, Paired) and a.name == b.name):
        return False
    return {a.axis, a.partner} == {b.axis, b.partner}


def pairs_alike(steps: Sequence[Step]) -> list[tuple[str, str]]:
    """Return names that these logs hardly tell apart: rivals that close nearly as much as what was named."""
    out: list[tuple[str, str]] = []
    for step in steps:
        effect = named(step.chosen.effect)
        out += [(effect.name, other) for other in effect.inseparable]
        for rival in step.rivals:
            near = rival.gain > NEAR * step.chosen.gain and rival.joint == step.chosen.joint
            if near and not isinstance(rival.effect, Pattern):
                pair = (effect.name, named(rival.effect).name)
                if pair[0] != pair[1] and pair not in out:
                    out.append(pair)
    return out
