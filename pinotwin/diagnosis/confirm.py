"""What validation logs object to: an effect that does not foretell them needs more evidence to be named.

The fitted blocks share their commands with each other, so that an error in the form of the base model
repeats in all of them and looks like an effect. Another command does not repeat it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.admission import Judged, admit
from pinotwin.diagnosis.decide import Decision, Named
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.shrinking import held_out, plain_stage, shrink

FORETOLD = 0.1  # share of the gap that an effect must take away on the validation logs
MORE = 5.0  # times the threshold, the evidence that names an effect all the same


def confirmed(start: Ready, decision: Decision, rng: np.random.Generator) -> Decision:
    """Return the decision without the effects that validation logs do not bear out."""
    if not any(start.stage.rows.validation):
        return decision
    kept = tuple(n for n in decision.named if _stands(start, decision, n, rng))
    final = admit(decision.searched, [*decision.quiet, *(n.judged for n in kept)])
    return replace(decision, named=kept, stage=final)


def _stands(start: Ready, decision: Decision, named: Named, rng: np.random.Generator) -> bool:
    """Whether an effect, given the other ones, is foretold or beyond doubt."""
    own = named.judged
    if own.family.local or MORE * named.threshold < own.G:
        return True
    others = [n.judged for n in decision.named if n is not named]
    return _delivered(start, [*decision.quiet, *others], own, rng) > FORETOLD


def _delivered(
    start: Ready, others: Sequence[Judged], own: Judged, rng: np.random.Generator
) -> float:  # fmt: skip
    """Return the largest share of a joint's gap that the effect takes away on validation logs."""
    plain = plain_stage(start.stage)
    before = held_out(plain, others, start.theta)
    after = held_out(plain, [*others, own], start.theta)
    found = (shrink(before, after, j, start.stage.noise.rms[j], rng) for j in own.joints
             if j in start.stage.noise.rms)  # fmt: skip
    return max((x.share for x in found if x is not None), default=-1.0)
