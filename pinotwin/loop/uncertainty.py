"""Intervals of poles and residues that survive coloured errors.

What a model leaves is never white, so the covariance is the sandwich H^-1 M H^-1 with M from block sums of
the score (:func:`pinotwin.solve.sandwich.batch_means`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.loop.projection import Projection
from pinotwin.loop.sections import discretise
from pinotwin.solve.sandwich import batch_means


@dataclass(frozen=True)
class Covariance:
    """Covariance of the poles and of what follows from them.

    Attributes:
        poles: of the logarithms of the free parameters, shape (np, np); NaN rows for those held.
        joint: of (all logarithms, all scaled residues), held ones zero, shape (np + ny nc,)
            squared.
        blocks: number of blocks.
    """

    poles: Floats
    joint: Floats
    blocks: int


def covariance(projection: Projection, theta: Floats, held: Mask) -> Covariance:
    """Return the covariance at the optimum.

    Args:
        projection: the separable problem.
        theta: logarithms of the parameters at the optimum, shape (np,).
        held: parameters on a bound, taken as known, shape (np,).
    """
    tangents, scores = _linearised(projection, theta)
    ny, nc = projection.layout.outputs, projection.layout.residues
    count = len(theta)
    free = [t[:, np.concatenate([~held, np.ones(t.shape[1] - count, dtype=bool)])] for t, _ in tangents]
    # Columns: free poles, then the free directions of the residues, output after output.
    poles = int(np.sum(~held))
    total = poles + sum(t.shape[1] - poles for t in free)
    H, S = np.zeros((total, total)), np.zeros((len(free[0]), total))
    T = np.zeros((count + ny * nc, total))
    T[np.flatnonzero(~held), np.arange(poles)] = 1.0
    at = poles
    for k, G in enumerate(free):
        places = np.concatenate([np.arange(poles), np.arange(at, at + G.shape[1] - poles)])
        H[np.ix_(places, places)] += G.T @ G
        S[:, places] += G * scores[k][:, None]
        rows = slice(count + k * nc, count + (k + 1) * nc)
        to_residues = tangents[k][1]
        T[rows, :poles] = to_residues[:, :count][:, ~held]
        T[rows, at : at + G.shape[1] - poles] = to_residues[:, count:]
        at += G.shape[1] - poles
    own, blocks = batch_means(H, S, poles or total, ny * len(S))
    joint = T @ own @ T.T
    found = joint[:count, :count].copy()
    found[held], found[:, held] = np.nan, np.nan
    return Covariance(found, joint, blocks)


def _linearised(projection: Projection, theta: Floats) -> tuple[list[tuple[Floats, Floats]], list[Floats]]:
    """Return per output (tangent (n, np + nz), that of the residues (nc, np + nz)), residual."""
    sections = projection.layout.shaped(theta)
    discrete = discretise(sections, projection.step)
    wide = projection.filtered(discrete)
    lengths = projection.blocks[:, 1] - projection.blocks[:, 0]
    rows = np.concatenate([wide[m, :, :n].T for m, n in enumerate(lengths)])
    misfit = projection.evaluate(theta)
    tangents, residuals = [], []
    columns = projection.columns
    phi = rows[:, columns.phi]
    for k, c in enumerate(misfit.residues):
        ties = projection.layout.ties(sections, k, projection.scales.gains(k))
        directions, moves = ties.particular()[1], ties.moves(c)
        slopes = np.zeros((len(rows), len(theta)))
        for i, pairs in enumerate(columns.slopes):
            slopes[:, i] = rows[:, pairs[:, 0]] @ c[pairs[:, 1]]
        to_residues = np.concatenate([moves, directions], axis=1)
        tangent = phi @ to_residues
        tangent[:, : len(theta)] += slopes
        both = np.column_stack([tangent, rows[:, columns.output + k] - phi @ c])
        projection.clear_free(discrete, sections, both)
        tangents.append((both[:, :-1], to_residues))
        residuals.append(both[:, -1])
    return tangents, residuals
