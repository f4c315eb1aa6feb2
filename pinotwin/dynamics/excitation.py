r"""Which parameters a set of regressor rows can tell apart.

Columns are scaled to unit length first, so that units do not matter. With the singular values s and
right vectors V of the scaled matrix, the determinedness of parameter k is

    d_k = 1 / sqrt(sum_i V_ki² / s_i²)
        = |part of column k that no other column explains| / |column k|

1 for a parameter that stands alone, 0 for one that cannot be found (the inverse square root of the
variance inflation factor; Belsley, Kuh, Welsch 1980, doi:10.1002/0471725153). Directions with s
below ``tolerance`` times the largest are not excited; the parameters in them are named as groups of
which only sums, fewer than members, are determined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError

_MEMBER = 0.01  # share of a parameter's unit vector that lies in the unexcited subspace
_LINK = 0.02  # coupling of two parameters through that subspace


TOLERANCE = 1e-3
"""A direction, or a column times its size, below this fraction of the largest is not excited. With 1 % noise and 6000
samples that is about 10 % standard error."""


@dataclass(frozen=True)
class Group:
    """Parameters that the rows cannot tell apart.

    Attributes:
        names: the members.
        free: number of combinations of them that stay undetermined; equal to the number of members
            if nothing is known about any.
    """

    names: tuple[str, ...]
    free: int


@dataclass(frozen=True)
class Excitation:
    """What a set of rows determines.

    Attributes:
        names: the parameters.
        condition: ratio of the largest to the smallest singular value of the column-scaled matrix without its
            empty columns; inf if columns are dependent.
        determinedness: 0 to 1 for every parameter, shape (b,).
        scale: root-mean-square of every column [effort per parameter], shape (b,).
        unexcited: groups that cannot be told apart, and parameters without any effect.
    """

    names: tuple[str, ...]
    condition: float
    determinedness: Floats
    scale: Floats
    unexcited: tuple[Group, ...]

    @property
    def rank(self) -> int:
        """Number of combinations of parameters that the rows determine."""
        return len(self.names) - sum(group.free for group in self.unexcited)

    @property
    def determined(self) -> tuple[str, ...]:
        """Parameters that are in no unexcited group."""
        lost = {name for group in self.unexcited for name in group.names}
        return tuple(name for name in self.names if name not in lost)


def excitation(W: Floats, names: Sequence[str], *, size: Floats | None = None) -> Excitation:
    """Return what regressor rows determine.

    Args:
        W: rows of the regressor of all joints, stacked (and weighted, if the joints differ in
            noise), shape (rows, b).
        names: name of every column.
        size: expected magnitude of every parameter, e.g. |P pi| of the CAD model; tells a column
            that is empty for practical purposes from one in small units. None for one magnitude for
            all.

    Raises:
        DataError: W is not (rows, len(names)) or holds values that are not finite.
    """
    W = np.asarray(W, dtype=float)
    if W.ndim != 2 or W.shape[1] != len(names) or len(W) == 0:
        raise DataError(f"regressor has shape {W.shape}, expected (rows > 0, {len(names)})")
    finite = np.atleast_1d(np.isfinite(W).all(axis=0))
    if not finite.all():
        bad = [n for n, ok in zip(names, finite.tolist(), strict=True) if not ok]
        raise DataError(f"regressor columns {bad} hold values that are not finite; select rows first")
    scale = np.sqrt(np.mean(W**2, axis=0))
    effort = scale if size is None else scale * np.abs(size)
    alive = effort > TOLERANCE * effort.max(initial=0.0)
    s, V = _spectrum(W[:, alive] / (scale[alive] * np.sqrt(len(W))))
    weak = s <= TOLERANCE * s.max(initial=0.0)
    d = np.zeros(len(names))
    with np.errstate(divide="ignore"):
        d[alive] = 1.0 / np.sqrt(np.sum((V / s) ** 2, axis=1)) if s.all() else _singular(V, s)
        condition = float(s[0] / s[-1]) if len(s) else np.inf
    groups = [Group((names[k],), 1) for k in np.flatnonzero(~alive).tolist()]
    groups += _groups(V[:, weak], [names[k] for k in np.flatnonzero(alive).tolist()])
    return Excitation(tuple(names), condition, d, scale, tuple(groups))


def _spectrum(S: Floats) -> tuple[Floats, Floats]:
    """Return all singular values (zeros for missing rows) and right vectors as columns."""
    b = S.shape[1]
    if b == 0:
        return np.zeros(0), np.zeros((0, 0))
    R = np.zeros((b, b))
    R[: min(S.shape)] = np.linalg.qr(S, mode="r")
    _, s, Vt = np.linalg.svd(R)
    return np.where(s > np.finfo(float).eps * b * s[0], s, 0.0), Vt.T


def _singular(V: Floats, s: Floats) -> Floats:
    """Return d when some s are zero: 0 for parameters that have a part in those directions."""
    good = s > 0.0
    lost: Mask = np.sum(V[:, ~good] ** 2, axis=1) > 1e-12
    return np.where(lost, 0.0, 1.0 / np.sqrt(np.sum((V[:, good] / s[good]) ** 2, axis=1)))


def _groups(V: Floats, names: Sequence[str]) -> list[Group]:
    """Return the parameters that the subspace V (b, k) couples, as connected groups."""
    projector = V @ V.T
    left: Ints = np.flatnonzero(np.diag(projector) > _MEMBER)
    count, group = scipy.sparse.csgraph.connected_components(
        np.abs(projector[np.ix_(left, left)]) > _LINK, directed=False
    )
    parts = [left[group == k] for k in range(count)]
    return [
        Group(tuple(names[k] for k in part), max(1, round(float(projector[part, part].sum()))))
        for part in parts
    ]
