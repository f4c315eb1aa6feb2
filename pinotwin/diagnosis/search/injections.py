"""How sure a name is: the cause found, put into stretches of the residual that the model leaves anyway.

The residual that remains (of a twin: on its own logs) is cut into stretches that are laid over the
motion in another order, and the cause is added at the size found. The share of such trials in which the
same search names it first is its confidence: it falls where the model is poor and where another cause
looks alike on this motion. Misfit that is no noise is thereby kept as it is; nothing Gaussian is assumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.forward import Found, Step, key, refused, simplest
from pinotwin.diagnosis.search.scan import Scored, Searcher

TRIALS, RIVALS = 10, 5
STRETCH = 1.0
"""Length of the stretches that are laid in another order [s]."""


def confidences(
    comparison: Comparison,
    found: Found,
    rng: np.random.Generator,
    *,
    rules: Rules = RULES,
    trials: int = TRIALS,
) -> list[float]:
    """Return the confidence of every cause of a search."""
    return [_confidence(comparison, found, step, rng, rules, trials) for step in found.steps]


def _confidence(
    c: Comparison, found: Found, step: Step, rng: np.random.Generator, rules: Rules, trials: int
) -> float:
    entries = [step.chosen, *step.rivals[:RIVALS]]
    wins = 0
    for _ in range(trials):
        trial = _trial(c, found, step.chosen, rng)
        searcher = Searcher(trial)
        again = [x for e in entries if (x := searcher.score(e.effect, e.table)) is not None]
        fit = sorted((x for x in again if not refused(x, searcher, rules)), key=lambda x: -x.gain)
        wins += bool(fit) and same_cause(simplest(fit, rules), step.chosen)
    return float((wins + rules.prior_right) / (trials + rules.prior_right + rules.prior_wrong))


def same_cause(a: Scored, b: Scored) -> bool:
    """Whether two candidates are one cause as far as any motion can tell."""
    one, other = named(a.effect), named(b.effect)
    alike = other.name in one.inseparable or one.name in other.inseparable
    return key(a) == key(b) or (alike and one.axis == other.axis)


def _trial(c: Comparison, found: Found, cause: Scored, rng: np.random.Generator) -> Comparison:
    """Return the comparison with what the model leaves anyway laid in another order, and the cause put in."""
    left = found.searcher.residual()
    leaves = {j: left[j] * c.floor[j] for j in left}
    source = c.new if c.own is None else c.own
    residual = leaves if c.own is None else c.own.residual
    new = _laid(c.new, source, residual, cause.table[0], cause, rng)
    unseen = None
    if c.unseen is not None:
        unseen = _laid(c.unseen, source, residual, cause.table[-1], cause, rng)
    return replace(c, new=new, unseen=unseen)


def _laid(
    target: Sample,
    source: Sample,
    residual: Mapping[int, Floats],
    columns: Mapping[int, Floats],
    cause: Scored,
    rng: np.random.Generator,
) -> Sample:
    out = {}
    size = max(4, round(STRETCH / (target.motion.step * target.motion.decimation)))
    for j in target.joints:
        n = len(target.residual[j])
        r = residual.get(j, np.zeros(0))
        out[j] = _shuffled(r, n, size, rng) if len(r) > size else np.zeros(n)
        if j in columns:
            out[j] = out[j] + columns[j] @ cause.judged.theta
    del source
    return replace(target, residual=out)


def _shuffled(r: Floats, n: int, size: int, rng: np.random.Generator) -> Floats:
    """Return stretches of a residual drawn with replacement, n rows in all."""
    starts = rng.integers(0, len(r) - size, size=-(-n // size))
    return np.concatenate([r[s : s + size] for s in starts])[:n]


def pairs_alike(steps: Sequence[Step], share: float = 0.9) -> list[tuple[str, str]]:
    """Return names that these logs hardly tell apart: rivals that close nearly as much as what was named."""
    out: list[tuple[str, str]] = []
    for step in steps:
        effect = named(step.chosen.effect)
        out += [(effect.name, other) for other in effect.inseparable]
        for rival in step.rivals:
            near = rival.gain > share * step.chosen.gain and rival.joint == step.chosen.joint
            if near and not isinstance(rival.effect, Pattern):
                pair = (effect.name, named(rival.effect).name)
                if pair[0] != pair[1] and pair not in out:
                    out.append(pair)
    return out
