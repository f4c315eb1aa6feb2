"""Which parameters a set of regressor rows can distinguish.

Columns are scaled to unit length, so that units do not matter (Belsley, Kuh, Welsch 1980, doi:10.1002/0471725153).
Parameters in a direction that is not excited are named as groups of which only sums are determined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError


@dataclass(frozen=True)
class Group:
    """Parameters that the rows cannot distinguish."""

    names: tuple[str, ...]  # the members
    # number of combinations of them that stay undetermined; equal to the number of members if nothing is
    # known about any
    free: int


@dataclass(frozen=True)
class Excitation:
    """What a set of rows determines."""

    names: tuple[str, ...]  # the parameters
    # ratio of the largest to the smallest singular value of the column-scaled matrix without its empty
    # columns; inf if columns are dependent
    condition: float
    unexcited: tuple[Group, ...]  # groups that cannot be told apart, and parameters without any effect

    @property
    def rank(self) -> int:
        """Number of combinations of parameters that the rows determine."""
        return len(self.names) - sum(group.free for group in self.unexcited)

    @property
    def determined(self) -> tuple[str, ...]:
        """Parameters that are in no unexcited group."""
        lost = {name for group in self.unexcited for name in group.names}
        return tuple(name for name in self.names if name not in lost)


def excitation(
    W: Floats, names: Sequence[str], *, size: Floats | None = None, tolerance: float = 1e-3
) -> Excitation:
    """Return what regressor rows ``W`` of all joints, stacked and weighted, shape (rows, b), determine.

    ``size`` is the expected magnitude of every parameter, e.g. |P pi| of CAD; None for one for all. A direction, or a
    column times its size, below ``tolerance`` times the largest is not excited: with 1 % noise and 6000 samples about
    10 % standard error. DataError if W is not (rows, len(names)), or not finite.
    """
    W = np.asarray(W, dtype=float)
    if W.ndim != 2 or W.shape[1] != len(names) or len(W) == 0:
        raise DataError(f"regressor has shape {W.shape}, expected (rows > 0, {len(names)})")
    bad = [n for n, column in zip(names, W.T, strict=True) if not np.isfinite(column).all()]
    if bad:
        raise DataError(f"regressor columns {bad} hold values that are not finite; select rows first")
    scale = np.sqrt(np.mean(W**2, axis=0))
    effort = scale if size is None else scale * np.abs(size)
    alive = effort > tolerance * effort.max(initial=0.0)
    scaled = W[:, alive] / (scale[alive] * np.sqrt(len(W)))
    b = scaled.shape[1]
    R = np.zeros((b, b))  # missing rows make singular values of zero
    R[: min(scaled.shape)] = np.linalg.qr(scaled, mode="r")
    _, s, Vt = np.linalg.svd(R)
    s = np.where(s > np.finfo(float).eps * b * s.max(initial=0.0), s, 0.0)
    weak = s <= tolerance * s.max(initial=0.0)
    with np.errstate(divide="ignore"):
        condition = float(s[0] / s[-1]) if len(s) else np.inf
    groups = [Group((names[k],), 1) for k in np.flatnonzero(~alive).tolist()]
    groups += _groups(Vt[weak].T, [names[k] for k in np.flatnonzero(alive).tolist()])
    return Excitation(tuple(names), condition, tuple(groups))


def _groups(V: Floats, names: Sequence[str], member: float = 0.01, link: float = 0.02) -> list[Group]:
    """Return connected groups of parameters of the subspace V (b, k): in it by ``member``, coupled by ``link``."""
    projector = V @ V.T
    left: Ints = np.flatnonzero(np.diag(projector) > member)
    coupled = np.abs(projector[np.ix_(left, left)]) > link
    count, group = scipy.sparse.csgraph.connected_components(coupled, directed=False)
    parts = [left[group == k] for k in range(count)]
    return [
        Group(tuple(names[k] for k in part), max(1, round(float(projector[part, part].sum()))))
        for part in parts
    ]
