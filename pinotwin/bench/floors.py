"""What others would do: stepwise BIC, and orthogonal matching pursuit, on inverse-dynamics regressors.

Both take measured motion, filtered and differentiated, white noise for granted, nothing held out, and one
column (or few) per effect of the catalogue. The base model's friction shapes are given to them as the truth
has them, an advantage that no user has. Each returns its best effect with a score; the threshold is set
later, so that they accuse healthy machines as often as the diagnosis does (:mod:`pinotwin.bench.scoring`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.bench.cases import Case
from pinotwin.bench.floor_columns import Atom, Scene, atoms
from pinotwin.bench.plants import virtual
from pinotwin.bench.produce import Sealed
from pinotwin.bench.ratio import at_truth
from pinotwin.effects import Effect
from pinotwin.logs.prepare import prepare
from pinotwin.twin import Twin

ROWS = 700
"""Samples of each log that are used."""
Pick = tuple[str, str | None, float]


def floors(case: Case, sealed: Sealed, twin: Twin | None) -> dict[str, Pick]:
    """Return the first effect that each floor would name, with its score."""
    scenes = _scenes(case, sealed, twin)
    axes = [a.name for a in sealed.machine.axes.values()]
    joints = [sealed.machine.axes[a].index for a in axes]
    base = np.concatenate([s.base for s in scenes], axis=1)[joints]
    gap = np.concatenate([s.gap for s in scenes], axis=1)[joints]
    W = base.reshape(-1, base.shape[2])
    y = gap.reshape(-1)
    # Every axis counts by the size of what its own model leaves.
    left = np.sqrt(np.mean(_rest(_basis(W), y[:, None])[:, 0].reshape(gap.shape) ** 2, axis=1))
    weight = np.repeat(1.0 / np.maximum(left, 1e-9 * max(left.max(), 1e-12)), gap.shape[1])
    Q = _basis(W * weight[:, None])
    r = _rest(Q, (y * weight)[:, None])[:, 0]
    best: dict[str, Pick] = {}
    for j, axis in zip(joints, axes, strict=True):
        for atom in atoms(scenes, sealed.machine, j, axis, case.situation, case.leave_out):
            X = atom.values[joints].reshape(len(r), -1) * weight[:, None]
            _better(best, "stepwise_bic", atom, _bic(Q, X, r, atom.shapes))
            _better(best, "pursuit", atom, _correlation(X, r))
    return best


def _scenes(case: Case, sealed: Sealed, twin: Twin | None) -> list[Scene]:
    effects: Sequence[Effect]
    if twin is None:
        truth = virtual(case.machine)
        effects = [at_truth(e, truth) for e in sealed.machine.effects]
    else:
        effects = twin.effects
    motions = [prepare(sealed.machine, log) for log in sealed.logs]
    if twin is None:
        effects = [e.fitted_to(motions[0]) for e in effects]
    return [Scene.of(m, effects, sealed.machine, twin, ROWS) for m in motions]


def _better(best: dict[str, Pick], name: str, atom: Atom, score: float) -> None:
    if name not in best or score > best[name][2]:
        best[name] = (atom.effect, atom.axis, score)


def _basis(W: Floats) -> Floats:
    """Return orthonormal columns that span others, shape (n, rank)."""
    size = np.linalg.norm(W, axis=0)
    A = W[:, size > 0.0] / size[size > 0.0]
    power, V = np.linalg.eigh(A.T @ A)
    keep = power > 1e-10 * power.max()
    return np.asarray(A @ (V[:, keep] / np.sqrt(power[keep])))


def _rest(Q: Floats, X: Floats) -> Floats:
    """Return what of some columns lies outside the span of a basis."""
    rows = np.flatnonzero(X.any(axis=1))  # a column of one axis is zero at all others
    return np.asarray(X - Q @ (Q[rows].T @ X[rows]))


def _bic(Q: Floats, X: Floats, r: Floats, shapes: int) -> float:
    """Return by how much the Bayesian information criterion falls when columns are added."""
    rest, total, n = _rest(Q, X), float(r @ r), len(r)
    size = np.linalg.norm(rest, axis=0)
    keep = size > 1e-3 * np.linalg.norm(X, axis=0)
    if not keep.any():
        return -float(np.log(n))
    A = rest[:, keep] / size[keep]
    solved = np.linalg.solve(A.T @ A + 1e-9 * np.eye(A.shape[1]), A.T @ r)
    gain = min(float(solved @ (A.T @ r)), 0.999999 * total)
    return n * float(np.log(total / (total - gain))) - (A.shape[1] + shapes) * float(np.log(n))


def _correlation(X: Floats, r: Floats) -> float:
    """Return the largest correlation of a column with the residual, as matching pursuit takes it."""
    size = np.linalg.norm(X, axis=0)
    keep = size > 0.0
    whole = float(np.linalg.norm(r))
    if not keep.any() or whole <= 0.0:
        return 0.0
    return float(np.max(np.abs(r @ X[:, keep]) / size[keep])) / whole
