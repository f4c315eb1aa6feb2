"""Which alternatives the data do not reject: the model confidence set of Hansen, Lunde & Nason (2011).

doi:10.3982/ECTA5771. Each model is the base with one effect; its losses are squared whitened errors on
blocks that were not fitted, summed over stretches of time that are longer than what noise remembers. The
worst model goes as long as the stretches, resampled, say that it is worse than the others in the mean; the
p-value of a model is the largest that stood up to the moment it went.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.admission import Judged, Key, admit
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.shrinking import stretches
from pinotwin.diagnosis.stage import Stage

RESAMPLES = 1000
LEVEL = 0.1  # a model with a lower p-value is rejected
MOST = 6  # best models that are compared


def rejected(
    stage: Stage,
    theta: Floats,
    given: Sequence[Judged],
    models: Sequence[Judged],
    rng: np.random.Generator,
) -> dict[Key, float]:
    """Return the p-values of the models that the data reject.

    Args:
        stage: fitted rows.
        theta: coefficients that set the run-to-run scatter.
        given: effects that all models hold.
        models: effects of which one is added to each, the named one first.
        rng: of the resampling.
    """
    if models[0].family.local:
        return {}  # no other block foretells an event
    some = [x for x in models if not x.family.local][:MOST]
    losses = np.array([_losses(stage, theta, given, x) for x in some])
    p = confidence_set(losses, rng)
    return {x.key: float(v) for x, v in zip(some, p, strict=True) if v < LEVEL}


def confidence_set(losses: Floats, rng: np.random.Generator) -> Floats:
    """Return the p-value of every model (T_max statistic), shape (m,).

    Args:
        losses: of every model on every block, shape (m, blocks).
        rng: of the resampling.
    """
    m, count = losses.shape
    picks = rng.integers(0, count, (RESAMPLES, count))
    weights = np.array([np.bincount(p, minlength=count) for p in picks]) / count
    mean, drawn = losses.mean(axis=1), losses @ weights.T
    alive, p, out = list(range(m)), 0.0, np.ones(m)
    while len(alive) > 1:
        worse = mean[alive] - mean[alive].mean()
        shifted = drawn[alive] - drawn[alive].mean(axis=0) - worse[:, None]
        spread = np.maximum(shifted.std(axis=1), 1e-300)
        t = worse / spread
        p = max(p, float(np.mean((shifted / spread[:, None]).max(axis=0) >= t.max())))
        out[alive[int(np.argmax(t))]] = p
        alive.pop(int(np.argmax(t)))
    out[alive[0]] = 1.0
    return out


def _losses(stage: Stage, theta: Floats, given: Sequence[Judged], model: Judged) -> Floats:
    """Return the held-out losses of one model per stretch of time, their sum less its evidence."""
    under = admit(stage, [*given, model])
    ledger = build_ledger(under, theta)
    folds = [ledger.solve(f + 1, ledger.right[f + 1][:, :1])[:, 0] for f in range(under.blocks)]
    squares, labels = [], []
    for piece in under.pieces:
        own = np.array(folds)[piece.block][:, piece.columns]
        squares.append((piece.y - np.einsum("nk,nk->n", piece.B, own)) ** 2)
        labels.append(stretches(stage, piece))
    place = np.unique(np.concatenate(labels), return_inverse=True)[1]
    blocks = np.bincount(place, np.concatenate(squares))
    # What is not in the errors (the price of a search, a twin's strained belief) counts everywhere alike.
    return np.asarray(blocks - (model.G + blocks.sum()) / len(blocks))
