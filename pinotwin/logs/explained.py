"""An effort and what may cause it: base parameters of the machine, whatever their values, and friction.

Both are linear: the share of an effort that no values of them account for is a projection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.dynamics.parameters import parameters
from pinotwin.logs.settings import Settings
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.solve.jackknife import jackknife
from pinotwin.solve.lead import Lag, lag

BLOCKS = 8  # of the log, left out in turn


@dataclass(frozen=True)
class Course:
    """Rows of a motion: where they lie in it, which of them may be used, and the motion there."""

    rows: Ints  # their numbers, shape (n,)
    use: Mask  # which of them each axis may use, shape (n, nv)
    moved: Floats  # q, v and a of every axis, shape (3, n, nv)
    reach: int  # samples in which a lag is looked for
    settings: Settings  # what is decided by

    def exchanged(self, i: int, j: int) -> Course:
        """Return the same with the positions of two axes exchanged."""
        order = np.arange(self.use.shape[1])
        order[[i, j]] = j, i
        return replace(self, use=self.use[:, order], moved=self.moved[..., order])

    def turned(self, i: int) -> Course:
        """Return the same with the position of an axis reversed."""
        sign = np.ones(self.use.shape[1])
        sign[i] = -1.0
        return replace(self, moved=sign * self.moved)

    def thinned(self, most: int) -> Course:
        """Return the same with about so many of its rows."""
        few = slice(None, None, max(1, len(self.rows) // most))
        return replace(self, rows=self.rows[few], use=self.use[few], moved=self.moved[:, few])


@dataclass(frozen=True)
class Explained:
    """One axis: its effort, its rows, and there what may cause it."""

    name: str
    index: int  # column of the axis in the machine's arrays
    rotary: bool
    u: Floats  # effort of the whole motion, shape (n,)
    rows: Ints  # those that are looked at, shape (m,)
    v: Floats  # of the axis there, shape (m,); a likewise
    a: Floats
    rigid: Floats  # effort of the URDF's masses there, shape (m,)
    weight: Floats  # the part of it that gravity asks for, shape (m,)
    columns: Floats  # of all causes, shape (m, k); the last three are friction and 1
    basis: Floats  # orthonormal, of these
    reach: int  # samples in which a lag is looked for
    settings: Settings  # what is decided by

    @property
    def friction(self) -> slice:
        """The columns of friction."""
        return slice(self.columns.shape[1] - 3, self.columns.shape[1] - 1)

    @property
    def left(self) -> float:
        """Share of the power of its effort that nothing accounts for."""
        return self.left_of(self.u)

    def left_of(self, u: Floats) -> float:
        """Return the share of the power of another effort, shape (n,), that the motion of this axis leaves."""
        return left_of(u[self.rows], self.basis)

    def lag(self) -> Lag:
        """Return its effort at its best lag."""
        return lag(self.u, self.rows, self.basis, self.reach, blocks=BLOCKS)

    def scale(self, y: Floats, *, rotor: bool = False) -> tuple[float, float, float]:
        """Return an effort over the URDF's, its error, and its share beside friction; ``rotor`` is explained apart."""
        if not np.ptp(self.rigid) > 0:
            return 1.0, np.inf, 0.0
        columns = np.column_stack([self.rigid, self.columns[:, -3:], *([self.a] if rotor else [])])
        own = basis_of(columns[:, 1:])
        without = y - own @ (own.T @ y)
        scale, error, theta = fitted(columns, y, np.eye(columns.shape[1])[0])
        rest = y - columns @ theta
        return scale, error, 1.0 - float(rest @ rest) / max(float(without @ without), 1e-300)

    def rubbed(self, y: Floats) -> tuple[float, float, Floats]:
        """Return the power that friction takes out of an effort [W], its standard error, and all coefficients."""
        measure = np.zeros(self.columns.shape[1])
        measure[self.friction] = np.mean(self.v**2), np.mean(np.abs(self.v))  # power of each coefficient
        return fitted(self.columns, y, measure)

    def weighed(self, y: Floats) -> tuple[float, float]:
        """Return the weights that an effort holds over those of the URDF [-], and the standard error."""
        level = float(self.weight.mean())
        constant = np.ptp(self.weight) < 0.1 * abs(level)
        own = self.columns[:, -3:-1] if constant else self.columns[:, -3:]
        columns = np.column_stack([self.weight, self.rigid - self.weight, own])
        return fitted(columns, y, np.eye(columns.shape[1])[0])[:2]


def course(motion: Motion, settings: Settings, most: int = 4000) -> Course | None:
    """Return about so many rows of a motion, away from every gap; None where there are too few."""
    reach = int(np.ceil(settings.lag_reach / motion.step))
    inside = np.concatenate([np.arange(s.start + reach, s.stop - reach) for s in motion.segments])
    inside = inside[:: max(1, len(inside) // most)]
    if len(inside) < 20 * BLOCKS:
        return None
    moved = np.stack([motion.q[inside], motion.v[inside], motion.a[inside]])
    return Course(inside, motion.use[inside], moved, reach, settings)


def explained(machine: Machine, u: Floats, at: Course) -> Iterator[Explained]:
    """Yield the axes that move both ways and whose effort changes; ``u`` of a whole motion, shape (n, nv)."""
    whole = machine.base.regressor(machine.model, *at.moved)
    beta = machine.base.from_standard(parameters(machine.model))
    q, none = at.moved[0], np.zeros_like(at.moved[0])
    weights = machine.base.regressor(machine.model, q, none, none) @ beta
    for name, axis in machine.axes.items():
        j = axis.index
        usable = at.use[:, j]
        rows, effort = at.rows[usable], u[:, j]
        if len(rows) < 20 * BLOCKS or not np.isfinite(effort).all() or not np.ptp(effort[rows]) > 0:
            continue
        w, (q, v, a) = whole[usable, j], at.moved[:, usable, j]
        if min(np.mean(v > 0), np.mean(v < 0)) < 0.02:
            continue  # one direction only: friction is a constant there
        own = [a, np.sin(q), np.cos(q)] if axis.rotary else [a]
        parts: Sequence[Floats] = [w[:, np.abs(w).max(axis=0) > 0], *own, v, np.sign(v), np.ones(len(rows))]
        columns = np.column_stack(parts)
        causes = w @ beta, weights[usable, j], columns, basis_of(columns)
        yield Explained(name, j, axis.rotary, effort, rows, v, a, *causes, at.reach, at.settings)


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


def fitted(columns: Floats, y: Floats, measure: Floats) -> tuple[float, float, Floats]:
    """Return ``measure @ theta`` of a least-squares fit, its standard error by the jackknife, and theta."""
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    scaled = columns / size
    whole = np.linalg.lstsq(scaled, y, rcond=1e-6)[0] / size
    values = []
    for low, high in pairwise(np.linspace(0, len(y), BLOCKS + 1).astype(int)):
        keep = np.r_[0:low, high : len(y)]
        values.append(measure @ (np.linalg.lstsq(scaled[keep], y[keep], rcond=1e-6)[0] / size))
    error = float(np.sqrt(jackknife(np.array(values)[:, None])[0, 0]))
    return float(measure @ whole), error, whole
