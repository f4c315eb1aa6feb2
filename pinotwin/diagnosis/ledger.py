"""Block sums of a stage and of candidates: all that a candidate's evidence is computed from.

With a base ``B`` (prior precision L0) and a candidate ``C``, all whitened, a ledger holds L = B'B + L0 and
B'y of all rows and of all but each fold, and the sums of a candidate are g = C'y - C'B L^-1 B'y and
S = C'C - C'B L^-1 B'C; see :mod:`pinotwin.diagnosis.worth`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.stage import Piece, Stage, scatter_precision

RIDGE = 1e-9
NOTHING = 1e-14  # whitened length below which a column is not there


@dataclass(frozen=True)
class Group:
    """One log within one fold: its pieces' rows, and what integrates the scatter out of it."""

    fold: int
    log: int
    S: Ints  # indices of scattered base columns, shape (s,)
    M: Floats  # (S'S + Sigma^-1)^-1, shape (s, s)
    SB: Floats  # S'B, shape (s, p)
    Sy: Floats  # shape (s, d)


@dataclass(frozen=True)
class Ledger:
    """Block sums of a stage.

    Attributes:
        stage: whose sums they are.
        groups: (fold, log) pairs.
        roots: inverse Cholesky factors R of L of all rows, and of all rows but each fold, so that
            L^-1 = R' R, shape (folds + 1, p, p).
        right: B'Y of all rows, and of all but each fold, shape (folds + 1, p, d).
        theta: coefficients of the base from all rows, shape (p,).
        Y: measured (first) and drawn efforts per piece, whitened, each of shape (m, d).
    """

    stage: Stage
    groups: tuple[Group, ...]
    roots: Floats
    right: Floats
    theta: Floats
    Y: tuple[Floats, ...]

    def solve(self, k: int, x: Floats) -> Floats:
        """Return L_k^-1 x, with k = 0 for all rows and f + 1 for all but fold f."""
        flat = x.reshape(x.shape[0], -1)
        return np.asarray(self.roots[k].T @ (self.roots[k] @ flat)).reshape(x.shape)


def build_ledger(stage: Stage, theta: Floats | None = None, drawn: Sequence[Floats] | None = None) -> Ledger:
    """Return the block sums of a stage.

    Args:
        stage: whitened rows.
        theta: coefficients that set the size of the run-to-run scatter; None leaves it out.
        drawn: per piece, efforts of healthy machines to be judged as well, shape (m, draws).
    """
    p = stage.base.count
    keys = sorted({(int(b), x.channel.log) for x in stage.pieces for b in np.unique(x.block)})
    precision = np.full(p, np.inf) if theta is None else scatter_precision(stage.base, stage.noise, theta)
    S = np.flatnonzero(np.isfinite(precision))
    folds = stage.blocks
    Y = tuple(
        np.column_stack([piece.y, *([] if drawn is None else [drawn[k]])])
        for k, piece in enumerate(stage.pieces)
    )
    A, r = np.zeros((folds, p, p)), np.zeros((folds, p, Y[0].shape[1]))
    groups = []
    for fold, log in keys:
        BB, By = np.zeros((p, p)), np.zeros(r.shape[1:])
        for k, rows in _members(stage, fold, log):
            piece = stage.pieces[k]
            B, y = piece.B[rows], Y[k][rows]
            BB[np.ix_(piece.columns, piece.columns)] += B.T @ B
            By[piece.columns] += B.T @ y
        M = np.linalg.inv(BB[np.ix_(S, S)] + np.diag(precision[S])) if len(S) else np.zeros((0, 0))
        SB, Sy = BB[S], By[S]
        groups.append(Group(fold, log, S, np.asarray(M, dtype=float), SB, Sy))
        A[fold] += BB - SB.T @ M @ SB
        r[fold] += By - SB.T @ (M @ Sy)
    return _factored(stage, tuple(groups), A, r, Y)


def _members(stage: Stage, fold: int, log: int):  # type: ignore[no-untyped-def]
    for k, piece in enumerate(stage.pieces):
        if piece.channel.log == log:
            rows = piece.block == fold
            if rows.any():
                yield k, rows


def _factored(stage: Stage, groups: tuple[Group, ...], A: Floats, r: Floats, Y: tuple[Floats, ...]) -> Ledger:
    whole, right = A.sum(axis=0) + stage.base.precision, r.sum(axis=0)
    # Each column by its own size: beside an encoder error's 1e6 others must not count as nothing.
    scale = np.sqrt(np.diag(whole))
    scale = np.where(scale > NOTHING, scale, 1.0)
    roots = [_root(whole, scale, RIDGE)]
    rights = [right]
    for fold in range(stage.blocks):
        roots.append(_root(whole - A[fold], scale, 10 * RIDGE))
        rights.append(right - r[fold])
    theta = roots[0].T @ (roots[0] @ right[:, 0])
    return Ledger(stage, groups, np.array(roots), np.array(rights), theta, Y)


def _root(L: Floats, scale: Floats, ridge: float) -> Floats:
    """Return R with L^-1 = R' R, columns scaled to one and held by a ridge."""
    lower = cholesky(L / np.outer(scale, scale) + ridge * np.eye(len(scale)), lower=True)
    inverse = solve_triangular(lower, np.eye(len(scale)), lower=True)
    return np.asarray(inverse / scale)


@dataclass(frozen=True)
class Moments:
    """What the block sums of candidates of k columns owe to the base alone, whatever the effort.

    Attributes:
        raw: squared length of every column, shape (folds + 1, I, k); entry 0 of all rows, f + 1 of all
            but fold f.
        S: C'C with the base projected out, shape (folds + 1, I, k, k).
        X: L^-1 B'C, shape (folds + 1, I, k, p).
        CSM: per group, what takes the run's own scatter out of C'y, shape (I k, s).
    """

    raw: Floats
    S: Floats
    X: Floats
    CSM: tuple[Floats, ...]


@dataclass(frozen=True)
class Sums:
    """Block sums of a batch of candidates with their efforts.

    Attributes:
        known: what does not depend on the effort.
        g: C'y with the base projected out, shape (folds + 1, I, k, d).
    """

    known: Moments
    g: Floats


def sums(ledger: Ledger, batch: Sequence[Floats | None], known: Moments | None = None) -> Sums:
    """Return the block sums of candidates.

    Args:
        ledger: of the base.
        batch: whitened columns per piece, each of shape (m, I, k), or None.
        known: moments of the same batch with the same base.
    """
    known = moments(ledger, batch) if known is None else known
    stage = ledger.stage
    count, k, p = known.X.shape[1:]
    Cy = np.zeros((stage.blocks, count * k, ledger.right.shape[2]))
    for group, csm in zip(ledger.groups, known.CSM, strict=True):
        for n, rows in _members(stage, group.fold, group.log):
            C = batch[n]
            if C is not None:
                own = np.asarray(C[rows], dtype=float)
                Cy[group.fold] += own.reshape(len(own), -1).T @ ledger.Y[n][rows]
        if len(group.S):
            Cy[group.fold] -= csm @ group.Sy
    g = _leave_out(Cy) - known.X.reshape(-1, count * k, p) @ ledger.right
    return Sums(known, g.reshape(stage.blocks + 1, count, k, -1))


def moments(ledger: Ledger, batch: Sequence[Floats | None]) -> Moments:
    """Return the moments of candidates; see :func:`sums`."""
    stage = ledger.stage
    count, k = next(x.shape for x in batch if x is not None)[1:]
    p, folds = stage.base.count, stage.blocks
    CC, CB, CSM = np.zeros((folds, count, k, k)), np.zeros((folds, count * k, p)), []
    for group in ledger.groups:
        cc, cb = np.zeros((count, k, k)), np.zeros((count * k, p))
        for n, rows in _members(stage, group.fold, group.log):
            C, piece = batch[n], stage.pieces[n]
            if C is None:
                continue
            own = np.asarray(C[rows], dtype=float)
            cc += np.einsum("nik,nil->ikl", own, own) if k > 1 else (own**2).sum(0)[:, :, None]
            cb[:, piece.columns] += own.reshape(len(own), -1).T @ piece.B[rows]
        csm = cb[:, group.S] @ group.M
        if len(group.S):
            own_s = cb[:, group.S].reshape(count, k, -1)
            cc -= np.einsum("iks,ils->ikl", csm.reshape(count, k, -1), own_s)
            cb -= csm @ group.SB
        CSM.append(csm)
        CC[group.fold] += cc
        CB[group.fold] += cb
    whole, flat = _leave_out(CC), _leave_out(CB)
    Z = flat @ ledger.roots.transpose(0, 2, 1)
    Z3 = Z.reshape(folds + 1, count, k, p)
    S = whole - ((Z3 @ Z3.transpose(0, 1, 3, 2)) if k > 1 else (Z3**2).sum(axis=3)[:, :, :, None])
    X = (Z @ ledger.roots).reshape(folds + 1, count, k, p)
    return Moments(np.einsum("fikk->fik", whole), S, X, tuple(CSM))


def _leave_out(x: Floats) -> Floats:
    whole = x.sum(axis=0)
    return np.concatenate([whole[None], whole[None] - x])


def residual_of(piece: Piece, theta: Floats) -> Floats:
    """Return the whitened residual of a piece, shape (m,)."""
    return np.asarray(piece.y - piece.B @ theta[piece.columns])
