"""One score for every cause: held-out log density of all that was recorded, less what the healthy day has to be.

Rows are summed into cells, one Gram matrix each over [a zero, columns of a healthy day, columns of causes, residual].
A cause is then a set of columns; its score takes a millisecond. Cells are Student's t, so that one bad cell decides
nothing; columns of a healthy day have a standard normal prior and leave by Schur complement, log by log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.settings import SETTINGS


@dataclass(frozen=True, eq=False)
class Cells:
    """The evidence of one equation of one axis, cell by cell.

    Attributes:
        gram: shape (c, p, p). rows: independent rows of each cell, shape (c,). log, fold: of each, shape (c,).
        constant: what is added to the log density of each [nats], shape (c,).
        day: columns of a healthy day, the first after the zero.
        at: cause -> its columns.
    """

    gram: Floats
    rows: Floats
    log: Ints
    fold: Ints
    constant: Floats
    day: int
    at: dict[str, Ints]

    def columns(self, name: str, count: int) -> Ints:
        """Return the columns of a cause, ``count`` times the zero where it does not act, shape (count,)."""
        return self.at.get(name, np.zeros(count, dtype=np.intp))


@dataclass(frozen=True, eq=False)
class Scored:
    """The score of one set of columns.

    Attributes:
        held: log density of every cell by numbers that do not know it, one array an equation [nats].
        full: the same by numbers that know all.
        theta: numbers, shape (p,). covariance: theirs, shape (p, p).
        costs: log prior of the healthy day of every log [nats], shape (logs,).
    """

    held: list[Floats]
    full: list[Floats]
    theta: Floats
    covariance: Floats
    costs: Floats

    @property
    def error(self) -> Floats:
        """Standard errors of the numbers, shape (p,)."""
        return errors(self.covariance)

    @property
    def cost(self) -> float:
        """Log prior of the healthy days of all logs [nats]."""
        return float(self.costs.sum())


@dataclass(frozen=True, eq=False)
class _View:
    """The cells of one log and equation, with the columns that are asked."""

    equation: int
    log: int
    gram: Floats
    rows: Floats
    fold: Ints
    constant: Floats
    day: int


def score(
    use: Sequence[tuple[Cells, Ints]],
    count: int,
    prior: Floats | None = None,
    fixed: Floats | None = None,
    start: Floats | None = None,
) -> Scored:
    """Return the score of a cause.

    Args:
        use: equations with the columns of the cause in each, shape (count,).
        count: numbers of the cause.
        prior: their widths, shape (count,); None for none.
        fixed: the numbers, where they are known already.
        start: numbers about which they are sought, where a cause acts in few cells: nothing by default.
    """
    views = _views(use)
    penalty = 1e-8 * np.eye(count) if prior is None else np.diag(1.0 / np.square(prior))
    # From nothing explained: from equal weights a narrow prior is broken at any price.
    about = np.zeros(count) if start is None else start
    weights = [_weight(v, np.r_[np.zeros(v.day), -about, 1.0])[None] for v in views]
    for _ in range(4):
        step, _, _ = _solved(views, weights, penalty, fixed)
        weights = [_weight(v, x[0])[None] for v, x in zip(views, step, strict=True)]
    parts = [
        np.concatenate([w] + [w * (v.fold != f) for f in range(SETTINGS.folds)])
        for w, v in zip(weights, views, strict=True)
    ]
    steps, theta, information = _solved(views, parts, penalty, fixed)
    held: list[list[Floats]] = [[] for _ in use]
    full: list[list[Floats]] = [[] for _ in use]
    costs = np.zeros(1 + max(v.log for v in views))
    for v, x in zip(views, steps, strict=True):
        held[v.equation].append(_density(v, x[1 + v.fold]))
        full[v.equation].append(_density(v, np.broadcast_to(x[0], (len(v.rows), x.shape[1]))))
        costs[v.log] -= 0.5 * float(x[0, : v.day] @ x[0, : v.day])
    covariance = np.linalg.pinv(information[0]) if count else np.zeros((0, 0))
    return Scored(
        [np.concatenate(x) for x in held], [np.concatenate(x) for x in full], theta[0], covariance, costs
    )


def _views(use: Sequence[tuple[Cells, Ints]]) -> list[_View]:
    views = []
    for k, (c, at) in enumerate(use):
        columns = np.r_[1 : 1 + c.day, at, c.gram.shape[1] - 1].astype(np.intp)
        gram = c.gram[:, columns[:, None], columns]
        for log in np.unique(c.log):
            rows = np.flatnonzero(c.log == log)
            views.append(_View(k, int(log), gram[rows], c.rows[rows], c.fold[rows], c.constant[rows], c.day))
    return views


def _weight(v: _View, x: Floats) -> Floats:
    left = np.maximum(np.einsum("i,cij,j->c", x, v.gram, x), 0.0)
    return np.asarray((SETTINGS.freedom + v.rows) / (SETTINGS.freedom + left))


def density(left: Floats, rows: Floats) -> Floats:
    """Return the log density of cells [nats], but for a constant, from their squared residual and rows, (c,) each."""
    nu = SETTINGS.freedom
    return np.asarray(-0.5 * (nu + rows) * np.log1p(left / nu))


def _density(v: _View, x: Floats) -> Floats:
    """Return the log density of every cell at numbers of shape (cells, p)."""
    left = np.maximum(np.einsum("ci,cij,cj->c", x, v.gram, x), 0.0)
    return density(left, v.rows) + v.constant


def _solved(
    views: Sequence[_View], weights: Sequence[Floats], penalty: Floats, fixed: Floats | None
) -> tuple[list[Floats], Floats, Floats]:
    """Return residual combinations of every view, numbers and information, for every row of weights at once."""
    many, p = weights[0].shape[0], len(penalty)
    information, right, parts = np.tile(penalty, (many, 1, 1)), np.zeros((many, p)), []
    for v, w in zip(views, weights, strict=True):
        N, m = np.tensordot(w, v.gram, 1), v.day
        own = N[:, :m, :m] + np.eye(m)
        d = 1.0 / np.sqrt(np.einsum("fii->fi", own))[:, :, None]  # units of a day's columns lie far apart
        A = d * np.linalg.solve(own * d * d.transpose(0, 2, 1), N[:, :m, m:] * d)
        parts.append(A)
        if p:
            information = information + N[:, m:-1, m:-1] - N[:, m:-1, :m] @ A[:, :, :p]
            right = right + N[:, m:-1, -1] - (N[:, m:-1, :m] @ A[:, :, p:])[..., 0]
    theta = np.zeros((many, p))
    if fixed is not None:
        theta = np.tile(fixed, (many, 1))
    elif p:
        scale = 1.0 / np.sqrt(np.maximum(np.einsum("fii->fi", information), 1e-300))
        scaled = information * scale[:, :, None] * scale[:, None] + 1e-9 * np.eye(p)
        theta = np.linalg.solve(scaled, (right * scale)[..., None])[..., 0] * scale
    steps = [
        np.concatenate(
            [-(A[:, :, p] - (A[:, :, :p] @ theta[..., None])[..., 0]), -theta, np.ones((many, 1))], axis=1
        )
        for A in parts
    ]
    return steps, theta, information


def errors(covariance: Floats) -> Floats:
    """Return the standard errors of numbers from their covariance (p, p), shape (p,)."""
    return np.asarray(np.sqrt(np.abs(np.diag(covariance))))


def squared(density_: Floats, rows: Floats) -> Floats:
    """Return the squared residual of cells from their log density [nats] and rows, (c,) each; see :func:`density`."""
    nu = SETTINGS.freedom
    return np.asarray(nu * np.expm1(-2.0 * density_ / (nu + rows)))


def opened(c: Cells, base: Floats) -> float:
    """Return the squared residual of an equation over what a healthy one has, from its cells' densities [nats]."""
    return float(squared(base - c.constant, c.rows).sum() / max(c.rows.sum(), 1e-9))
