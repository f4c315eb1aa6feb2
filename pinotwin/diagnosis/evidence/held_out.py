r"""What a candidate closes of the residual on rows that its coefficients were not fitted to.

For every block they come from all others, beside the model's own columns. On the twin's own logs the same fit gives
what the model always lacked; what is judged is the residual less ``C d`` by the *change*, d = theta(new) - theta(own).
Without own logs (a machine fitted to these very logs) nothing is taken off, and the model's columns stay free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.evidence.moments import Base, Products
from pinotwin.solve.jackknife import jackknife, solved, without_each

Span = tuple[Floats, Floats]  # Lower and upper bounds of coefficients, shape (p,) each
FREE, HELD = 1e-6, 1e6
"""Precision of a coefficient of the model over what the rows say of it: one that is free, one at its bound."""
RIDGE = 1e-9  # Of the mean diagonal: keeps a singular system solvable, moves nothing that is determined
SCALED_RIDGE = 1e-6  # The same for a candidate's own columns, scaled to one
COLLINEAR = 1e-5  # Share of a candidate's columns that the model's own must leave for it to be told apart


@dataclass(frozen=True, eq=False)
class Ground:
    """The model on all samples: new logs, the twin's own ones for a change, validation logs."""

    new: Base  # the logs in question
    own: Base | None  # the twin's own logs; None where the model is fitted to ``new``
    unseen: Base | None  # validation logs, or None
    precision: Floats  # what holds the model's own columns, shape (b,)
    bound: Mask  # columns that ``precision`` keeps at a lower bound, a mask (b,)
    belief: Floats | float = 0.0  # precision of what is believed of them together, shape (b, b)
    pull: Floats | float = 0.0  # of that at the model's coefficients, which the rows balance, shape (b,)

    @cached_property
    def folds(self) -> Floats:
        """Inverse of the model's normal matrix without each block, and last with all, (K + 1, b, b)."""
        return _inverses(self.new, np.diag(self.precision) + self.belief, leave_out=True)

    @cached_property
    def own_inverse(self) -> Floats:
        """The same for all own logs, shape (1, b, b)."""
        assert self.own is not None
        return _inverses(self.own, np.diag(self.precision) + self.belief, leave_out=False)

    def released(self, columns: Mask) -> Ground:
        """Return the same with some of the columns at a bound free, made once for each choice of them."""
        key = columns.tobytes()
        if key not in self._released:
            free = np.where(columns, self.precision * (FREE / HELD), self.precision)
            self._released[key] = replace(self, precision=free, bound=self.bound & ~columns)
        return self._released[key]

    @cached_property
    def _released(self) -> dict[bytes, Ground]:
        return {}

    @cached_property
    def alone(self) -> Judged:
        """What the model leaves without any candidate."""
        b = self.new.Xr.shape[2]
        nothing = _nothing(self.new, b)
        unseen = None if self.unseen is None else _nothing(self.unseen, b)
        own = None if self.own is None else _nothing(self.own, b)
        return judged(self, nothing, own, unseen)


@dataclass(frozen=True, eq=False)
class Judged:
    """What is left with a candidate, on rows that were not fitted."""

    theta: Floats  # change of the coefficients from all blocks, shape (p,)
    folds: Floats  # the same without each block, shape (K, p)
    own: Floats  # spread of the own logs' estimate by leaving out blocks, shape (p, p)
    left: Floats  # squared residual of every block, all joints, shape (K,)
    unseen: Floats  # the same on the validation logs, shape (L,); empty without
    determined: bool  # whether the model's own columns leave the candidate anything
    base: Floats  # change of the model's own coefficients, shape (b,)
    base_folds: Floats  # the same without each block, shape (K, b)

    @cached_property
    def covariance(self) -> Floats:
        """Block jackknife covariance of ``theta``, own logs included, shape (p, p)."""
        return jackknife(self.folds) + self.own

    @cached_property
    def strength(self) -> float:
        """Squared size of the change over its covariance, per number."""
        p = len(self.theta)
        if p == 0:
            return 0.0
        C = self.covariance
        if (
            p >= len(self.folds) - 1
        ):  # fewer blocks than numbers: in some directions nothing would seem to vary
            C = np.diag(np.diag(C))
        C = C + 1e-12 * max(float(np.trace(C)), 1e-300) * np.eye(p)
        return float(self.theta @ np.linalg.solve(C, self.theta)) / p


def judged(
    ground: Ground,
    new: Products,
    own: Products | None,
    unseen: Products | None,
    hold: float = 0.0,
    span: Span | None = None,
) -> Judged:
    """Return what a candidate leaves, from its sums on the new, own and validation (``unseen``) logs, or None of these.

    Its coefficients are held near zero by the precision ``hold`` [1 / unit²], their change within ``span``, (p,) each.
    One of the model at its lower bound may leave it beside the candidate, for it may have come to rest there for want
    of it: viscous friction takes what Coulomb's had (least squares with inequalities, by their active set).
    """
    found = _judged(ground, new, own, unseen, hold, span)
    if not ground.bound.any() or not new.Cr.shape[1]:
        return found
    base = ground.new
    said = new.CX.sum(axis=0).T @ found.theta + base.XX.sum(axis=(0, 1)) @ found.base
    rising = ground.bound & (base.Xr.sum(axis=(0, 1)) > said)  # the residual falls with these
    while rising.any():
        beside = _judged(ground.released(rising), new, own, unseen, hold, span)
        falling = rising & (beside.base < 0.0)
        if not falling.any():
            return beside
        rising &= ~falling
    return found


def _judged(
    ground: Ground,
    new: Products,
    own: Products | None,
    unseen: Products | None,
    hold: float,
    span: Span | None,
) -> Judged:
    base = ground.new
    p = new.Cr.shape[1]
    there, moved, spread = np.zeros(p), np.zeros(base.Xr.shape[2]), np.zeros((p, p))
    if ground.own is not None and own is not None:
        before, beside, _ = _solve(ground.own_inverse, ground.own, own, hold, leave_out=False)
        there, moved = before[-1], beside[-1]
        held = hold * np.eye(own.Cr.shape[1])
        each = solved(without_each(own.CC) + held, without_each(own.Cr), SCALED_RIDGE)[:-1]
        spread = jackknife(each) if len(held) else held
    within = None if span is None else (span[0] + there, span[1] + there)
    theta, delta, determined = _solve(ground.folds, base, new, hold, within, ground.pull, leave_out=True)
    theta, delta = theta - there, delta - moved
    left = _left(base, new, theta[:-1], delta[:-1])
    beyond = np.zeros(0)
    if ground.unseen is not None and unseen is not None:
        L = len(unseen.Cr)
        beyond = _left(
            ground.unseen, unseen, np.repeat(theta[-1:], L, axis=0), np.repeat(delta[-1:], L, axis=0)
        )
    return Judged(theta[-1], theta[:-1], spread, left, beyond, determined, delta[-1], delta[:-1])


def _inverses(base: Base, precision: Floats, *, leave_out: bool) -> Floats:
    XX = base.XX.sum(axis=1)
    systems = without_each(XX) if leave_out else XX.sum(axis=0)[None]
    total = systems[-1]
    b = total.shape[0]
    if b == 0:
        return np.zeros((len(systems), 0, 0))
    ridge = RIDGE * max(float(np.trace(total)) / b, 1e-300) * np.eye(b)
    return np.linalg.inv(systems + precision + ridge)


def _solve(
    inverse: Floats,
    base: Base,
    c: Products,
    hold: float,
    span: Span | None = None,
    pull: Floats | float = 0.0,
    *,
    leave_out: bool,
) -> tuple[Floats, Floats, bool]:
    """Return candidate's and model's coefficients, one row a fold and the last for all blocks."""

    def without(x: Floats) -> Floats:
        return without_each(x) if leave_out else x.sum(axis=0)[None]

    CC, CX, Cr, Xr = without(c.CC), without(c.CX), without(c.Cr), without(base.Xr.sum(axis=1)) - pull
    CXZ = CX @ inverse
    S = CC - CXZ @ CX.transpose(0, 2, 1)
    s = Cr - np.einsum("kpb,kb->kp", CXZ, Xr)
    p = S.shape[1]
    if p == 0:
        theta, determined = np.zeros((len(S), 0)), True
    else:
        whole = np.maximum(np.diagonal(CC[-1]), 1e-300)
        determined = bool(np.max(np.diagonal(S[-1]) / whole) > COLLINEAR)
        theta = solved(S + hold * np.eye(p), s, SCALED_RIDGE, np.sqrt(whole))
        theta = theta if span is None else np.clip(theta, *span)
    delta = np.einsum("kbc,kc->kb", inverse, Xr - np.einsum("kpb,kp->kb", CX, theta))
    return theta, delta, determined


def _left(base: Base, c: Products, theta: Floats, delta: Floats) -> Floats:
    """Return the squared residual of every block with coefficients of its own row."""
    XX, Xr = base.XX.sum(axis=1), base.Xr.sum(axis=1)
    return (
        base.rr.sum(axis=1)
        - 2.0 * np.einsum("kp,kp->k", theta, c.Cr)
        - 2.0 * np.einsum("kb,kb->k", delta, Xr)
        + np.einsum("kp,kpq,kq->k", theta, c.CC, theta)
        + 2.0 * np.einsum("kp,kpb,kb->k", theta, c.CX, delta)
        + np.einsum("kb,kbc,kc->k", delta, XX, delta)
    )


def _nothing(base: Base, b: int) -> Products:
    K = base.sample.blocks
    return Products(np.zeros((K, 0, 0)), np.zeros((K, 0, b)), np.zeros((K, 0)), base.rr.sum(axis=1))
