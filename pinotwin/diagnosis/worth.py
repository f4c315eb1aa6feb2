"""Held-out evidence of candidates, from block sums alone.

The gain of admitting a candidate C to a base B, with the sums of :mod:`pinotwin.diagnosis.ledger`, is

    gain = g' S^-1 g

and what it is worth on data it was not fitted to is the predictive deviance over the folds f,

    G = sum_f [ gain(all) - gain(all but f) ] - [ log det S(all) - log det S(all but f) ].

It prices every coefficient (about 2 each where nothing is there) and a shape that was chosen on the
training folds is judged on the fold left out. Both terms are Gaussian evidence ratios (Berger &
Pericchi 1996, doi:10.1080/01621459.1996.10476668, intrinsic Bayes factors).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.ledger import Ledger, Moments, Sums


@dataclass(frozen=True)
class Worth:
    """What a batch of candidates is worth.

    Attributes:
        G: held-out gain in whitened deviance, on the measured and the drawn efforts, shape (I, d).
        gain: in-sample gain on the measured and the drawn efforts, shape (I, d).
        theta: coefficients, shape (I, k).
        share: how much of the columns the base does not explain already, shape (I,).
        sign: sign of the first coefficient, on the measured and the drawn efforts, shape (I, d).
    """

    G: Floats
    gain: Floats
    theta: Floats
    share: Floats
    sign: Floats


def worth(ledger: Ledger, s: Sums, ridge: float = 0.0) -> Worth:
    """Return what candidates are worth on data they were not fitted to.

    Args:
        ledger: of the base.
        s: sums of the candidates.
        ridge: see :class:`~pinotwin.diagnosis.context.Family`.
    """
    gains, logdets = [], []
    known = _held(s.known, ridge)
    for k in range(len(known.S)):
        g, S, size = s.g[k], known.S[k], np.sqrt(np.maximum(known.raw[k], 1e-300))
        normal = S / (size[:, :, None] * size[:, None, :]) + 1e-7 * np.eye(S.shape[1])
        x = np.linalg.solve(normal, g / size[:, :, None])
        gains.append(np.einsum("ikd,ikd->id", x, g / size[:, :, None]))
        logdets.append(np.linalg.slogdet(normal)[1] + 2 * np.log(size).sum(axis=1))
        if k == 0:
            theta = x[:, :, 0] / size
            sign = np.sign(x[:, 0, :])
            share = np.einsum("ikk->i", S) / np.maximum(known.raw[k].sum(axis=1), 1e-300)
    gain, logdet = np.array(gains), np.array(logdets)[:, :, None]
    by_fold = (gain[0] - gain[1:]) - (logdet[0] - logdet[1:])
    G = by_fold.sum(axis=0)
    if ledger.stage.base.change:
        G = G + relief(ledger, replace(s, known=known))
    return Worth(G, gain[0], theta, share, sign)


def _held(known: Moments, ridge: float) -> Moments:
    """Return the moments with a prior precision on every coefficient, the same in every fold."""
    if ridge == 0.0:
        return known
    width = known.S.shape[2]
    level = ridge * known.raw[0].mean(axis=1)
    return replace(
        known,
        raw=known.raw + level[None, :, None],
        S=known.S + level[None, :, None, None] * np.eye(width),
    )


def relief(ledger: Ledger, s: Sums) -> Floats:
    """Return how much less a twin's belief is strained with each candidate, shape (I, d).

    A base parameter that left its prior costs (x - x0)' L0 (x - x0). Data that were fitted hide it from
    the held-out score, since they moved the parameter; a candidate that takes the change upon itself
    gives the cost back.
    """
    g, S, size = s.g[0], s.known.S[0], np.sqrt(np.maximum(s.known.raw[0], 1e-300))
    normal = S / (size[:, :, None] * size[:, None, :]) + 1e-7 * np.eye(S.shape[1])
    c = np.linalg.solve(normal, g / size[:, :, None]) / size[:, :, None]
    X = s.known.X[0]
    count, width, p = X.shape
    prior = ledger.stage.base.precision
    theta = ledger.solve(0, ledger.right[0])
    pull = (X.reshape(-1, p) @ (prior @ theta)).reshape(count, width, -1)
    Q = np.einsum("ikp,ilp->ikl", X, (X.reshape(-1, p) @ prior).reshape(count, width, p))
    return np.asarray(2.0 * np.einsum("ikd,ikd->id", pull, c) - np.einsum("ikd,ikl,ild->id", c, Q, c))
