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
from pinotwin.diagnosis.evidence.held_out import SCALED_RIDGE
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.forward import Found, Step, key, refused, simplest
from pinotwin.diagnosis.search.scan import Scored, Searcher
from pinotwin.solve.jackknife import solved

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
        wins += bool(fit) and same_cause(simplest(fit, searcher, rules), step.chosen)
    return posterior(wins, trials, rules)


def posterior(wins: int, trials: int, rules: Rules) -> float:
    """Return the confidence after so many trials, some of them won."""
    return float((wins + rules.prior_right) / (trials + rules.prior_right + rules.prior_wrong))


def same_cause(a: Scored, b: Scored) -> bool:
    """Whether two candidates are one cause as far as any motion can tell."""
    one, other = named(a.effect), named(b.effect)
    alike = other.name in one.inseparable or one.name in other.inseparable
    return key(a) == key(b) or (alike and one.axis == other.axis)


def _trial(c: Comparison, found: Found, cause: Scored, rng: np.random.Generator) -> Comparison:
    """Return the comparison with what the model leaves anyway laid in another order, and the cause put in.

    What the twin always lacked of this very cause is taken off every change; it comes with the motion and is not
    laid elsewhere.
    """
    left = found.searcher.residual()
    residual: Mapping[int, Floats] = {j: left[j] * c.floor[j] for j in left}
    theta = cause.judged.theta
    if c.own is not None:
        always = lacked(c, cause)
        columns = cause.table[1]
        residual = {j: x - columns[j] @ always if j in columns else x for j, x in c.own.residual.items()}
        theta = theta + always
    new = _with(c.new, residual, cause.table[0], theta, rng)
    unseen = None if c.unseen is None else _with(c.unseen, residual, cause.table[-1], theta, rng)
    return replace(c, new=new, unseen=unseen)


def lacked(c: Comparison, cause: Scored) -> Floats:
    """Return the coefficients of a cause that the twin's own logs ask for already, shape (p,)."""
    columns, residual = cause.table[1], {} if c.own is None else c.own.residual
    joints = [j for j in columns if j in residual]
    if not joints:
        return np.zeros(len(cause.judged.theta))
    X = np.concatenate([columns[j] / c.floor[j] for j in joints])
    r = np.concatenate([residual[j] / c.floor[j] for j in joints])
    return solved((X.T @ X)[None], (X.T @ r)[None], SCALED_RIDGE)[0]


def _with(
    target: Sample,
    residual: Mapping[int, Floats],
    columns: Mapping[int, Floats],
    theta: Floats,
    rng: np.random.Generator,
) -> Sample:
    out = {}
    for j in target.joints:
        n = len(target.residual[j])
        out[j] = laid(target, residual[j], n, rng) if j in residual else np.zeros(n)
        if j in columns:
            out[j] = out[j] + columns[j] @ theta
    return replace(target, residual=out)


def laid(target: Sample, residual: Floats, n: int, rng: np.random.Generator) -> Floats:
    """Return n rows of a residual, stretches of :data:`STRETCH` drawn with replacement; zeros where it is shorter."""
    return shuffled(
        residual, n, max(4, round(STRETCH / (target.motion.step * target.motion.decimation))), rng
    )


def shuffled(residual: Floats, n: int, size: int, rng: np.random.Generator) -> Floats:
    """Return n rows of a residual, stretches of so many rows drawn with replacement; zeros where it is shorter."""
    if len(residual) <= size:
        return np.zeros(n)
    starts = rng.integers(0, len(residual) - size, size=-(-n // size))
    return np.concatenate([residual[s : s + size] for s in starts])[:n]


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
