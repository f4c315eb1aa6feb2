"""Which other effects would look like a found one: its own signature, without noise, screened again.

Isolability of a pair is half the deviance by which the true effect beats the other one (Eriksson, Frisk &
Krysander 2013, doi:10.1016/j.automatica.2013.02.008). It depends on the coefficients and not only on the
families: an orientation error of an axis that bears a constant weight is an offset, of another it is not.
So the signature is taken as it was found (METHODS A2, step 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.admission import RARE, Judged, Key
from pinotwin.diagnosis.bank import Shelf
from pinotwin.diagnosis.context import Context
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.search import Settings, screen
from pinotwin.diagnosis.stage import Stage

REFERENCE = 200.0  # gain that a signature has at least: what coefficients cost is little beside it
MERGED = 3.0  # isolability below which two effects are one
FORM = 0.02  # share of an effect that the form of its columns may be off by


def not_isolable(
    context: Context, shelves: Sequence[Shelf], stage: Stage, found: Judged, settings: Settings
) -> tuple[Key, ...]:
    """Return the effects that this motion cannot tell from a found one.

    Args:
        context: what candidates are made from.
        shelves: the bank.
        stage: with the other found effects in its base.
        found: the effect with its coefficients.
        settings: of the search.
    """
    if found.family.local:
        return ()
    plain = replace(settings, leave_out=settings.leave_out | {"external_force"})
    seen = screen(context, shelves, build_ledger(_signed(stage, found)), plain)
    own = max((_evidence(j) for j in seen.judged if j.key == found.key), default=0.0)
    return tuple(
        j.key
        for j in seen.judged
        if j.key != found.key and own > 0.0 and _lost(own, _evidence(j), found.gain)
    )


def _signed(stage: Stage, found: Judged) -> Stage:
    """Return the stage with the effect's own efforts, not too small, in place of the measured ones."""
    own = stage.project(found.candidate.columns)
    theta = found.theta * np.sqrt(max(REFERENCE / max(found.gain, 1e-9), 1.0))
    pieces = tuple(
        replace(p, y=0.0 * p.y if x is None else x @ theta) for p, x in zip(stage.pieces, own, strict=True)
    )
    return replace(stage, pieces=pieces)


def _evidence(judged: Judged) -> float:
    """Return the held-out gain without what its family costs."""
    return judged.G + judged.family.price + RARE.get(judged.family.effect, 0.0)


def _lost(own: float, other: float, gain: float) -> bool:
    """Whether another effect loses too little of an effect's gain to be told from it."""
    loss = 1.0 - other / own
    return loss < FORM or 0.5 * gain * loss < MERGED
