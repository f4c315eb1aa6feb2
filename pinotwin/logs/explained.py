"""An effort and what may cause it: the base parameters of the machine, whatever their values, and friction.

Both are linear, so that the share of an effort that no values of them account for is a projection. It says
whether a motion can be that of an effort at all, on which axis, at which instant and with which sign.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.dynamics.parameters import parameters
from pinotwin.machine import Machine
from pinotwin.motion import Motion

REACH = 0.06  # longest lag that is looked for [s]
BLOCKS = 8
_ROWS = 4000


@dataclass(frozen=True)
class Course:
    """Rows of a motion: where they lie in it, which of them may be used, and the motion there.

    Attributes:
        rows: their numbers, shape (n,).
        use: which of them each axis may use, shape (n, nv). q, v, a: of every axis, shape (n, nv).
    """

    rows: Ints
    use: Mask
    q: Floats
    v: Floats
    a: Floats

    def exchanged(self, i: int, j: int) -> Course:
        """Return the same with the positions of two axes exchanged."""
        order = np.arange(self.q.shape[1])
        order[[i, j]] = j, i
        return Course(self.rows, self.use[:, order], self.q[:, order], self.v[:, order], self.a[:, order])

    def turned(self, i: int) -> Course:
        """Return the same with the position of an axis reversed."""
        sign = np.ones(self.q.shape[1])
        sign[i] = -1.0
        return Course(self.rows, self.use, sign * self.q, sign * self.v, sign * self.a)


@dataclass(frozen=True)
class Explained:
    """One axis: its effort, its rows, and there what may cause it; the last three columns are friction and 1."""

    name: str
    rotary: bool
    u: Floats
    rows: Ints
    v: Floats
    a: Floats
    rigid: Floats
    columns: Floats

    @property
    def friction(self) -> slice:
        """The columns of friction."""
        return slice(self.columns.shape[1] - 3, self.columns.shape[1] - 1)


def course(motion: Motion, reach: int) -> Course | None:
    """Return rows of a motion, ``reach`` samples away from every gap; None where there are too few."""
    inside = np.concatenate([np.arange(s.start + reach, s.stop - reach) for s in motion.segments])
    inside = inside[:: max(1, len(inside) // _ROWS)]
    if len(inside) < 20 * BLOCKS:
        return None
    return Course(inside, motion.use[inside], motion.q[inside], motion.v[inside], motion.a[inside])


def explained(machine: Machine, u: Floats, at: Course) -> Iterator[Explained]:
    """Yield the axes that move both ways and whose effort changes.

    Args:
        machine: the machine.
        u: efforts of a whole motion, shape (n, nv).
        at: rows of it.
    """
    whole = machine.base.regressor(machine.model, at.q, at.v, at.a)
    beta = machine.base.from_standard(parameters(machine.model))
    for name, axis in machine.axes.items():
        j = axis.index
        usable = at.use[:, j]
        rows, effort = at.rows[usable], u[:, j]
        if len(rows) < 20 * BLOCKS or not np.isfinite(effort).all() or not np.ptp(effort[rows]) > 0:
            continue
        w, q, v, a = whole[usable, j], at.q[usable, j], at.v[usable, j], at.a[usable, j]
        if min(np.mean(v > 0), np.mean(v < 0)) < 0.02:
            continue  # one direction only: friction is a constant there
        own = [a, np.sin(q), np.cos(q)] if axis.rotary else [a]
        columns = [w[:, np.abs(w).max(axis=0) > 0], *own, v, np.sign(v), np.ones(len(rows))]
        yield Explained(name, axis.rotary, effort, rows, v, a, w @ beta, np.column_stack(columns))


def basis_of(columns: Floats) -> Floats:
    """Return an orthonormal basis of columns, without what rounding makes of dependent ones."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(basis[:, sizes > 1e-6 * sizes[0]])


def left_of(u: Floats, basis: Floats) -> float:
    """Return the share of the power of ``u`` (about its mean) that a basis leaves."""
    power = float(np.sum((u - u.mean()) ** 2))
    rest = u - basis @ (basis.T @ u)
    return float(rest @ rest) / power if power > 0 else 1.0
