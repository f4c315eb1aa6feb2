r"""Least squares whose inertias stay near those of the URDF, and so are those of bodies that can exist.

    minimise  1/2 |R theta - z|^2 + g sum_i [ 1/2 tr((J0_i^-1 J_i)^2) - log det(J0_i^-1 J_i) ],   theta = (P pi, phi)

J is a body's pseudo-inertia, J0 the URDF's. The bracket is the log-det divergence (Lee, Wensing & Park 2020,
doi:10.1109/TRO.2019.2958219) plus its own second-order form, whose linear terms cancel: convex and its own barrier. A
damped Newton step is a least-squares problem by QR, for a log may weigh 1e10 times the URDF; rotor inertias stay
positive in it (Lawson and Hanson), and coefficients that would leave their bounds end there.

    F dx = -c,   F = [A; sqrt(g) J0^-1/2 E J0^-1/2; sqrt(g) J^-1/2 E J^-1/2],   E = dJ / dpi
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import Self

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.parameters import BASIS, pseudo_inertia
from pinotwin.solve.rank import r_factor

HOLD = 1e-6  # Share of the data's information that holds a coefficient where nothing else tells it
SETTLED, SHORT = 1e-8, 1e-10
"""Gain [squared standard deviations] and length of a Newton step from which the search has ended."""
SEEN = 1e-9  # Length of a column, over the longest of its kind, from which the data see it
TRIANGLE = np.triu_indices(4)
TWICE = np.where(TRIANGLE[0] == TRIANGLE[1], 1.0, np.sqrt(2.0))


@dataclass(frozen=True)
class Bodies:
    """The standard parameters before the data, pi0 (p_std,): ten of each body, which can exist, then rotor inertias.

    P of shape (b, p_std) makes base parameters of them, beta = P pi; ``count`` is the number of bodies.
    """

    P: Floats
    pi0: Floats
    count: int


@dataclass(frozen=True)
class Evidence:
    """What a fit without this prior found."""

    factor: Floats  # R of the weighted rows, shape (k, p)
    right: Floats  # z, shape (k,)
    theta: Floats  # its coefficients, shape (p,)
    beta: Ints  # indices of the base parameters within theta, in the order of P's rows
    lower: Floats  # smallest values of theta, shape (p,), -inf for free
    upper: Floats  # largest values, shape (p,); what ended there stays


@dataclass(frozen=True)
class Near:
    """Parameters near the data and the URDF."""

    pi: Floats  # standard parameters, shape (p_std,); P pi equals theta[beta]
    theta: Floats  # coefficients, shape (p,)
    count: int  # number of bodies
    at: Ints  # what the data see of pi: ten parameters of each body, then rotor inertias, shape (n,)
    root: Floats  # F with F'F the second derivative in these, shape (k, n)
    pull: Floats  # first derivative of each body's, towards the URDF's when that grows, shape (bodies, 10)

    @cached_property
    def share(self) -> Floats:
        """Per body d log m / d log m_URDF: 0 where the data tell the mass, 1 where the URDF does, or where unseen."""
        seen = self.pull.size
        T = r_factor(self.root[:, (np.arange(len(self.at)) < seen) | (self.pi[self.at] > 0.0)])
        force = np.zeros((len(T), len(self.pull)))
        force[:seen] = _diagonal(self.pull[:, :, None])
        pushed, (turned, bodies) = scipy.linalg.solve_triangular(T, force, trans="T"), self._masses(T)
        out = np.ones(self.count)
        out[bodies] = (turned * pushed).sum(axis=0) / self.pi[10 * bodies]
        return out

    @cached_property
    def error(self) -> Floats:
        """Per body the standard error of its mass if rows are independent, inf where unseen [kg]."""
        turned, bodies = self._masses(r_factor(self.root))
        out = np.full(self.count, np.inf)
        out[bodies] = np.linalg.norm(turned, axis=0)
        return out

    def _masses(self, T: Floats) -> tuple[Floats, Ints]:
        """Return T'^-1 of the masses, and whose these are."""
        unit = np.eye(len(T))[:, : self.pull.size : 10]
        return scipy.linalg.solve_triangular(T, unit, trans="T"), self.at[: self.pull.size : 10] // 10


def near(evidence: Evidence, bodies: Bodies, weight: float, start: Near | None = None) -> Near:
    """Return the parameters of least error and distance from the URDF, which weighs g; the search may have a start."""
    theta = np.clip(evidence.theta, evidence.lower, evidence.upper)
    stays = (theta <= evidence.lower) | (theta >= evidence.upper)
    stays[evidence.beta] = True
    while True:
        found = _Problem.of(evidence, bodies, weight, theta, np.flatnonzero(~stays)).solved(start)
        inside = np.clip(found.theta, evidence.lower, evidence.upper)
        left = inside != found.theta
        if not left.any():
            return found
        theta, stays, start = inside, stays | left, found


@dataclass(frozen=True)
class _Problem:
    """The problem in x: ten parameters of each body and the rotor inertias that the data see."""

    bodies: Bodies  # what the URDF tells
    weight: float  # g
    theta: Floats  # coefficients, those kept as they are to be, shape (p,)
    beta: Ints  # indices of the base parameters within theta
    free: Ints  # of the coefficients that follow x, m of them
    seen: Ints  # of the bodies in x
    at: Ints  # of x within pi, shape (n,)
    metric: Floats  # per body, J0^-1/2 E J0^-1/2 times sqrt(g), shape (bodies, 10, 10)
    R: Floats  # triangle of the quadratic part, its columns (free, x, right side)

    @classmethod
    def of(cls, evidence: Evidence, bodies: Bodies, weight: float, theta: Floats, free: Ints) -> Self:
        """Return the problem in which only the free ones of the coefficients other than beta move."""
        pi, last = bodies.pi0, 10 * bodies.count
        columns = evidence.factor[:, evidence.beta] @ bodies.P
        size = np.linalg.norm(columns, axis=0)
        told = size > SEEN * size.max(initial=0.0)
        told[:last] = told[:last].reshape(-1, 10).any(axis=1).repeat(10)
        at, seen = np.flatnonzero(told), np.flatnonzero(told[:last:10])
        kept = theta.copy()
        kept[free] = 0.0
        kept[evidence.beta] = bodies.P @ np.where(told, 0.0, pi)
        hold = np.sqrt(HOLD) * np.linalg.norm(evidence.factor[:, free], axis=0)
        hold = np.where(hold > 0.0, hold, 1.0)
        root = np.linalg.cholesky(np.linalg.inv(pseudo_inertia(pi[:last].reshape(-1, 10)[seen])))
        metric = np.sqrt(weight) * _congruent(root.swapaxes(1, 2))
        data = np.column_stack(
            [evidence.factor[:, free], columns[:, at], evidence.right - evidence.factor @ kept]
        )
        rows = np.zeros((len(free) + 10 * len(seen), data.shape[1]))
        rows[: len(free), : len(free)], rows[: len(free), -1] = np.diag(hold), hold * theta[free]
        rows[len(free) :, len(free) : len(free) + 10 * len(seen)] = _diagonal(metric)
        R = r_factor(np.concatenate([data, rows]))
        return cls(bodies, weight, theta, evidence.beta, free, seen, at, metric, R)

    def solved(self, start: Near | None, patience: int = 60) -> Near:
        """Return the minimiser by a damped Newton method, from another's parameters or the URDF's."""
        k, bodies, rotors = len(self.free), slice(10 * len(self.seen)), slice(10 * len(self.seen), None)
        R, z = self.R[k:-1, k:-1], self.R[k:-1, -1]
        x = (self.bodies.pi0 if start is None else start.pi)[self.at]
        lower = self._value(x)
        for turn in count():
            if turn == patience:  # the cone's edge shortens every step
                x = self._heavier().solved(start).pi[self.at]
                lower = self._value(x)
            barrier, level = self._barrier(x)
            F = np.concatenate([R, barrier])
            whole = r_factor(np.column_stack([F, np.append(z, level + barrier @ x)]))
            T, t, new = whole[:-1, :-1], whole[:-1, -1], np.zeros(len(x))
            if len(x) > bodies.stop:
                new[rotors] = scipy.optimize.nnls(T[rotors, rotors], t[rotors])[0]
            known = t[bodies] - T[bodies, rotors] @ new[rotors]
            new[bodies] = scipy.linalg.solve_triangular(T[bodies, bodies], known)
            gain, value, step = float((t - T @ x) @ T @ (new - x)), lower, 1.0
            while gain > SETTLED and step > SHORT:
                if (lower := self._value(x + step * (new - x))) < value - 1e-4 * step * gain:
                    break
                step /= 2.0
            x = x + step * (new - x)
            if gain <= SETTLED or step <= SHORT:
                break
        return self._near(x, F)

    def _heavier(self) -> Self:
        """Return the problem in which the URDF weighs ten times as much."""
        wide = ((0, 0), (len(self.free), len(self.at) - 10 * len(self.seen) + 1))
        R = r_factor(np.concatenate([self.R, np.pad(3.0 * _diagonal(self.metric), wide)]))
        return replace(self, weight=10.0 * self.weight, metric=np.sqrt(10.0) * self.metric, R=R)

    def _barrier(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the rows of the logarithms' second-order form, shape (10 bodies, n), and their right side."""
        count = len(self.seen)
        J = pseudo_inertia(x[: 10 * count].reshape(-1, 10))
        bodies = np.sqrt(self.weight) * _congruent(np.linalg.inv(np.linalg.cholesky(J)))
        level = np.sqrt(self.weight) * np.tile(TWICE * (TRIANGLE[0] == TRIANGLE[1]), count)
        return np.hstack([_diagonal(bodies), np.zeros((len(level), len(x) - 10 * count))]), level

    def _value(self, x: Floats) -> float:
        """Return the objective, infinite outside the cone."""
        k, last = len(self.free), 10 * len(self.seen)
        try:
            C = np.linalg.cholesky(pseudo_inertia(x[:last].reshape(-1, 10)))
        except np.linalg.LinAlgError:
            return np.inf
        left = self.R[k:-1, k:-1] @ x - self.R[k:-1, -1]
        logarithm = 2.0 * np.log(np.diagonal(C, axis1=1, axis2=2)).sum()
        return float(left @ left / 2.0 - self.weight * logarithm)

    def _near(self, x: Floats, F: Floats) -> Near:
        """Return what is at the minimiser, F'F the second derivative there."""
        k, pi, theta = len(self.free), self.bodies.pi0.copy(), self.theta.copy()
        pi[self.at] = x
        theta[self.beta] = self.bodies.P @ pi
        theta[self.free] = scipy.linalg.solve_triangular(
            self.R[:k, :k], self.R[:k, -1] - self.R[:k, k:-1] @ x
        )
        own = x[: 10 * len(self.seen)].reshape(-1, 10, 1)
        pull = 2.0 * (self.metric.swapaxes(1, 2) @ self.metric @ own)[:, :, 0]
        return Near(pi, theta, self.bodies.count, self.at, F, pull)


def _diagonal(blocks: Floats) -> Floats:
    """Return the block-diagonal matrix of blocks, (n, a, b) to (n a, n b)."""
    n, a, b = blocks.shape
    return (np.eye(n)[:, None, :, None] * blocks[:, :, None]).reshape(n * a, n * b)


def _congruent(C: Floats) -> Floats:
    """Return the map from ten parameters to the upper triangle of C J C', off-diagonals times sqrt(2), (n, 10, 10)."""
    J = C[:, None] @ BASIS @ C.swapaxes(1, 2)[:, None]
    return np.asarray(J[:, :, TRIANGLE[0], TRIANGLE[1]] * TWICE).swapaxes(1, 2)
