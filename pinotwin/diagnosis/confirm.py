"""What validation logs object to: an effect that does not foretell them needs more evidence to be named.

The fitted blocks share their commands with each other, so that an error in the form of the base model
repeats in all of them and looks like an effect. Another command does not repeat it. Where there is none,
and no repeat either that tells the noise, effects need more evidence as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.admission import admit
from pinotwin.diagnosis.decide import Decision, Named
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.shrinking import HeldOut, foretold, held_out, plain_stage, shrink

FORETOLD = 0.1  # share of the gap that an effect must take away on the validation logs
MORE = 3.0  # times the threshold, the evidence that names an effect all the same
UNREFUTED = 1.6  # the same where the logs do not say that it is wrong, or are not there
LEAST = 0.5  # of what an effect foretells of such a log; below by a standard error, it is wrong


def confirmed(start: Ready, decision: Decision, rng: np.random.Generator) -> Decision:
    """Return the decision without the effects that validation logs do not bear out."""
    if not any(start.stage.rows.validation):
        return decision
    return _of(decision, [n for n in decision.named if _stands(start, decision, n, rng)])


def beyond_doubt(start: Ready, decision: Decision) -> Decision:
    """Return the decision without the effects that a healthy machine comes near, of a single log alone."""
    if any(start.stage.rows.validation) or start.stage.noise.kind == "repeats":
        return decision
    return _of(decision, [n for n in decision.named if UNREFUTED * n.threshold < n.judged.G])


def _of(decision: Decision, kept: Sequence[Named]) -> Decision:
    """Return the decision with some of its effects."""
    final = admit(decision.searched, [*decision.quiet, *(n.judged for n in kept)])
    return replace(decision, named=tuple(kept), stage=final)


def _stands(start: Ready, decision: Decision, named: Named, rng: np.random.Generator) -> bool:
    """Whether an effect, given the other ones, is foretold or beyond doubt."""
    own = named.judged
    if own.family.local or MORE * named.threshold < own.G:
        return True
    others = [*decision.quiet, *(n.judged for n in decision.named if n is not named)]
    plain = plain_stage(start.stage)
    before = held_out(plain, others, start.theta)
    after = held_out(plain, [*others, own], start.theta)
    noise = {j: start.stage.noise.rms[j] for j in own.joints if j in start.stage.noise.rms}
    shrinks = (shrink(before, after, j, rms, rng) for j, rms in noise.items())
    if max((x.share for x in shrinks if x is not None), default=-1.0) > FORETOLD:
        return True
    # A base that foretells another motion badly leaves a gap there beside which no effect shows.
    return UNREFUTED * named.threshold < own.G and not any(_wrong(before, after, j) for j in noise)


def _wrong(before: HeldOut, after: HeldOut, joint: int) -> bool:
    """Whether a validation log does not hold what an effect foretells of it."""
    slope, error = foretold(before, after, joint)
    return slope + error < LEAST
