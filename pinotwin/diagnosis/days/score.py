"""One score for every cause: held-out log density of all that was recorded, less what the healthy day has to be.

Rows are gathered in cells, with the columns [a zero, those of a healthy day, those of causes, residual]. A cause is
then a set of columns, of which each cell tells by its Gram matrix. Cells are Student's t, so that one bad cell decides
nothing, and vary more where a cause acts whose form is not quite right. Columns of a healthy day have a standard normal
prior and leave by Schur complement, log by log.
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
        x: columns on the rows of every cell, over their noise, zeros after its last row, shape (p, c, n).
        rows: independent ones of each cell, shape (c,). log, fold: of each, shape (c,).
        constant: what is added to the log density of each [nats], shape (c,).
        day: columns of a healthy day, the first after the zero.
        at: cause -> its columns.
    """

    x: Floats
    rows: Floats
    log: Ints
    fold: Ints
    constant: Floats
    day: int
    at: dict[str, Ints]

    def columns(self, name: str, count: int) -> Ints:
        """Return the columns of a cause, ``count`` times the zero where it does not act, shape (count,)."""
        return self.at.get(name, np.zeros(count, dtype=np.intp))


def padded(cells: Sequence[Floats]) -> Floats:
    """Return cells, (n, p) each, as one array (p, c, n) with zeros after the last row of each."""
    out = np.zeros((cells[0].shape[1], len(cells), max(map(len, cells))))
    for k, x in enumerate(cells):
        out[:, k, : len(x)] = x.T
    return out


@dataclass(frozen=True, eq=False)
class Scored:
    """The score of one set of columns.

    Attributes:
        held: log density of every cell by numbers that do not know it, one array an equation [nats].
        full: the same by numbers that know all. left, left_full: squared residual of every cell, likewise.
        theta: numbers, shape (p,). covariance: theirs, shape (p, p).
        days: what of the columns of a healthy day is taken off, of every log of every equation, shape (d,) each.
        costs: log prior of the healthy day of every log [nats], shape (logs,).
    """

    held: list[Floats]
    full: list[Floats]
    left: list[Floats]
    left_full: list[Floats]
    theta: Floats
    covariance: Floats
    days: list[Floats]
    costs: Floats

    @property
    def error(self) -> Floats:
        """Standard errors of the numbers, shape (p,)."""
        return errors(self.covariance)

    @property
    def cost(self) -> float:
        """Log prior of the healthy days of all logs [nats]."""
        return float(self.costs.sum())


def score(
    use: Sequence[tuple[Cells, Ints]],
    count: int,
    prior: Floats | None = None,
    fixed: Floats | None = None,
    *,
    form: bool = True,
) -> Scored:
    """Return the score of a cause, at the likelier of two maxima: about nothing, and about what equal weights tell.

    ``use``: equations with the columns of the cause in each, shape (count,); ``prior``: widths of its numbers, shape
    (count,); ``fixed``: these numbers, where they are known already; ``form``: whether its form may be off.
    """
    views = [(c, at, np.flatnonzero(c.log == log)) for c, at in use for log in np.unique(c.log)]
    gram, rows, fold, constant = _stacked(views, count)
    penalty = 1e-8 * np.eye(count) if prior is None else np.diag(1.0 / np.square(prior))
    x = _likeliest(gram, rows, penalty, fixed)
    acts = np.zeros_like(x)
    acts[..., -count - 1 : -1] = x[..., -count - 1 : -1]
    size = _left(gram, acts) / np.maximum(rows, 1e-9)
    part = _part(_left(gram, x), rows, size) if form and count else 0.0
    wide = 1.0 + part**2 * size
    weights = (SETTINGS.freedom + rows) / (SETTINGS.freedom * wide + _left(gram, x))
    without = fold != np.arange(SETTINGS.folds)[:, None]
    x, theta, information = _solved(gram, np.hstack([weights, weights * without]), penalty, fixed)
    left, whose = _left(gram, x), [c.log[own[0]] for c, _, own in views]
    costs = np.asarray(-0.5 * np.bincount(whose, np.sum(x[:, 0, : -count - 1] ** 2, axis=1)), dtype=float)

    def by_equation(cells: Floats) -> list[Floats]:
        pairs = list(zip(cells[:, 0], views, strict=True))
        return [np.concatenate([x[: len(own)] for x, (c, _, own) in pairs if c is one]) for one, _ in use]

    unseen, left = np.take_along_axis(left, 1 + fold, axis=1), left[:, :1]
    held, full = (by_equation(density(x, rows, wide) + constant) for x in (unseen, left))
    covariance = np.linalg.pinv(information[0]) if count else np.zeros((0, 0))
    days = [own[: c.day] for own, (c, _, _) in zip(x[:, 0], views, strict=True)]
    return Scored(held, full, by_equation(unseen), by_equation(left), theta[0], covariance, days, costs)


def _part(left: Floats, rows: Floats, size: Floats) -> float:
    """Return the likeliest part of what a cause does by which its form is off [1]; ``size``: its square in a row."""
    parts = [0.0, *np.geomspace(SETTINGS.share, SETTINGS.trace, 4).tolist()]
    return max(parts, key=lambda part: float(density(left, rows, 1.0 + part**2 * size).sum()))


def _likeliest(gram: Floats, rows: Floats, penalty: Floats, fixed: Floats | None) -> Floats:
    """Return the residual combinations (v, 1, p) that are most probable.

    A day has none of its own at the start, for by equal weights a narrow prior is broken at any price. Nor has a
    cause; but what explains the loud cells may leave the quiet ones worse, and is looked for from its own numbers.
    """
    nu, count = SETTINGS.freedom, len(penalty)
    starts = np.zeros((1, count))
    if count and fixed is None:
        _, equal, _ = _solved(gram, np.ones_like(rows), penalty, None)
        starts = np.vstack([starts, equal])
    x = np.zeros((len(gram), len(starts), gram.shape[-1]))
    x[..., -count - 1 :] = np.column_stack([-starts, np.ones(len(starts))])
    for _ in range(4):
        x, theta, _ = _solved(gram, (nu + rows) / (nu + _left(gram, x)), penalty, fixed)
        if len(theta) > 1:  # one step tells which is the likelier
            prior = np.sum(x[..., : -count - 1] ** 2, axis=(0, 2)) + np.sum(theta @ penalty * theta, axis=1)
            best = int(np.argmax(density(_left(gram, x), rows).sum(axis=(0, 2)) - 0.5 * prior))
            x = x[:, [best]]
    return x


def _stacked(views: Sequence[tuple[Cells, Ints, Ints]], count: int) -> tuple[Floats, Floats, Ints, Floats]:
    """Return Gram matrices (v, c, p, p), rows, folds and constants (v, 1, c) side by side, filled up with zeros.

    A view is what one log tells of one equation: its cells, the columns of the cause, and which cells.
    """
    day, most = max(c.day for c, _, _ in views), max(len(own) for _, _, own in views)
    gram = np.zeros((len(views), most, day + count + 1, day + count + 1))
    rows, fold, constant = np.zeros((3, len(views), 1, most))
    for k, (c, at, own) in enumerate(views):
        columns = np.r_[1 : 1 + c.day, np.zeros(day - c.day), at, len(c.x) - 1].astype(np.intp)
        x = c.x[columns, own[0] : own[-1] + 1]  # those of one log are side by side
        gram[k, : len(own)] = x.swapaxes(0, 1) @ x.transpose(1, 2, 0)
        told = np.stack([c.rows, c.fold, c.constant])[:, own]
        rows[k, 0, : len(own)], fold[k, 0, : len(own)], constant[k, 0, : len(own)] = told
    return gram, rows, fold.astype(np.intp), constant


def _left(gram: Floats, x: Floats) -> Floats:
    """Return the squared residual of every cell at combinations of columns (v, f, p), shape (v, f, c)."""
    views, cells, p, _ = gram.shape
    square = (x[..., None] * x[..., None, :]).reshape(views, -1, p * p)
    return np.maximum(square @ gram.reshape(views, cells, p * p).swapaxes(1, 2), 0.0)


def density(left: Floats, rows: Floats, wide: Floats | float = 1.0) -> Floats:
    """Return the log density of cells [nats], but for a constant, from squared residual and rows, (c,) each.

    ``wide``: by how much more each varies [1].
    """
    nu = SETTINGS.freedom
    return np.asarray(-0.5 * ((nu + rows) * np.log1p(left / (nu * wide)) + rows * np.log(wide)))


def _solved(
    gram: Floats, weights: Floats, penalty: Floats, fixed: Floats | None
) -> tuple[Floats, Floats, Floats]:
    """Return residual combinations (v, f, p) of all views, numbers and information, for weights (v, f, c)."""
    (views, cells, size, _), many, p = gram.shape, weights.shape[1], len(penalty)
    N = (weights @ gram.reshape(views, cells, size * size)).reshape(views, many, size, size)
    m = size - p - 1
    own = N[..., :m, :m] + np.eye(m)
    d = 1.0 / np.sqrt(np.einsum("vfii->vfi", own))[..., None]  # units of a day's columns lie far apart
    A = d * np.linalg.solve(own * d * d.swapaxes(2, 3), N[..., :m, m:] * d)
    rest = N[..., m:-1, m:] - N[..., m:-1, :m] @ A
    information, right = penalty + rest[..., :p].sum(axis=0), rest[..., p].sum(axis=0)
    theta = np.tile(np.zeros(p) if fixed is None else fixed, (many, 1))
    if fixed is None and p:
        scale = 1.0 / np.sqrt(np.maximum(np.einsum("fii->fi", information), 1e-300))
        scaled = information * scale[:, :, None] * scale[:, None] + 1e-9 * np.eye(p)
        theta = np.linalg.solve(scaled, (right * scale)[..., None])[..., 0] * scale
    x = np.ones((views, many, size))
    x[..., m:-1] = -theta
    x[..., :m] = (A[..., :p] @ theta[..., None])[..., 0] - A[..., p]
    return x, theta, information


def errors(covariance: Floats) -> Floats:
    """Return the standard errors of numbers from their covariance (p, p), shape (p,)."""
    return np.asarray(np.sqrt(np.abs(np.diag(covariance))))


def squared(density_: Floats, rows: Floats) -> Floats:
    """Return the squared residual of cells from their log density [nats] and rows, (c,) each; see :func:`density`."""
    nu = SETTINGS.freedom
    return np.asarray(nu * np.expm1(-2.0 * density_ / (nu + rows)))


def opened(c: Cells, left: Floats) -> float:
    """Return the squared residual of an equation over what a healthy one has [1], from that of its cells."""
    return float(left.sum() / max(c.rows.sum(), 1e-9))
