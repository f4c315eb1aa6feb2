"""What a table is before its knots are told: size and length of its waves, and the pitches of what repeats in it.

    2 log L = log|P| - log|H + P| + b'(H + P)^-1 b,   H = S'WS, b = S'Wy

S are a table's columns and y the effort, less what all other columns can tell of them; W counts a row as the share of
an independent one that the residual's correlation leaves: over a second for what repeats, as a knot is passed for the
knots. P = K(length) / amplitude^2, see :func:`pinotwin.effects.position.stiffness` (Rasmussen & Williams 2006, section
5.4). A wave is added where it makes the log likelier than all pitches that could have been tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_slices
from pinotwin.effects.position import PositionTable, stiffness
from pinotwin.effects.ripple import Ripple
from pinotwin.effects.sight import Sight
from pinotwin.identification.assemble import Rows, assemble
from pinotwin.motion import Motion
from pinotwin.solve.linear import Options, Reduced, Solution, reduce, solve
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import analyse
from pinotwin.solve.sandwich import bartlett

OptionsOf = Callable[[Sequence[Effect]], Options]


def with_beliefs(
    effects: Sequence[Effect], motion: Motion, rows: Rows, options: OptionsOf, searches: int = 3
) -> list[Effect]:
    """Return the effects, tables with priors and pitches as the rows tell them at the present shapes.

    Pitches are looked for again beside those found, so many times at most: a large wave hides small ones.
    """
    out = list(effects)
    tables = {k: e for k, e in enumerate(out) if isinstance(e, PositionTable) and e.belief() is None}
    tables = {k: e for k, e in tables.items() if motion.index(e.axis) in rows.joints}
    if not tables:
        return out
    while True:
        told = _Told(motion, rows, assemble(motion, out, rows))
        fit = told.tuned(out, tables, options)
        found = {k: told.pitches(table, fit) if searches else [] for k, table in tables.items()}
        if not any(found.values()):
            told.tuned(out, tables, options, passing=True)
            return out
        del told  # of a long log a gigabyte
        searches -= 1
        for k, table in tables.items():
            table = replace(table, pitches=(*table.pitches, *found[k]), amplitude=None, length=None)
            out[k] = tables[k] = table


def memory(motion: Motion, seconds: float = 1.0) -> int:
    """Return the number of fitted rows over which a residual is taken to be correlated, for so many seconds [s]."""
    return max(round(seconds / (motion.step * motion.decimation)), 1)


def independent(problem: Problem, theta: Floats, sigma: Floats, lags: int) -> Floats:
    """Return how many rows of one sigma tell as much as an independent one, correlated over so many, (axes,) [1].

    That is the variance of the residual's sum over that of as many independent rows of sigma.
    """
    axes = problem.axis_place[:, None] == np.arange(len(sigma))
    own = axes * (problem.y - problem.W @ theta)[:, None] / sigma
    lagged = np.diag(bartlett(problem.grid.spread(own, lags), lags))
    return np.maximum(lagged / axes.sum(axis=0), 1.0)


@dataclass(frozen=True)
class _Told:
    """The rows that tell of some effects."""

    motion: Motion
    rows: Rows
    problem: Problem  # of the effects

    @cached_property
    def reduced(self) -> Reduced:
        """The same, a factor an axis."""
        return reduce(self.problem)

    def tuned(
        self, out: list[Effect], tables: dict[int, PositionTable], options: OptionsOf, passing: bool = False
    ) -> Solution:
        """Give tables, by their place among the effects, their likeliest priors; return the solution with them.

        The first of two fits, of tables without a prior, has fitted away some of what is alike. What is told nowhere is
        no larger than 0.3 of the standard deviation of the effort.
        """
        slices, problem = effect_slices(out), self.problem
        for _ in range(2):
            fit = solve(self.reduced, options(out))
            e = problem.y - problem.W @ fit.theta
            alike = independent(problem, fit.theta, fit.sigma, memory(self.motion))
            for k, table in tables.items():
                joint = self.motion.index(table.axis)
                part, count = problem.slices[joint], float(alike[list(problem.slices).index(joint)])
                most = 0.3 * float(np.std(problem.y[part]))
                if most > 0.0:
                    count = min(count, self.passing(table, e[part])) if passing else count
                    left = _left(fit.factor, fit.right, slices[k], len(table.knots))
                    out[k] = tables[k] = _likely(table, *left, most, count)
        return solve(self.reduced, options(out))

    def passing(self, table: PositionTable, e: Floats) -> float:
        """Return how many rows in motion, of residual e (n,), tell as much as an independent one at a knot [1]."""
        joint = self.motion.index(table.axis)
        kept = self.rows.kept[self.rows.joints.index(joint)]
        at = self.rows.sample[kept]
        place = np.floor(self.motion.q[at, joint] / table.spacing) + 1j * self.rows.block[kept]
        e = np.where(self.motion.moving(joint)[at], e, 0.0)
        passes = np.add.reduceat(e, np.flatnonzero(np.append(True, np.diff(place) != 0.0)))
        return max(float(np.sum(passes**2) / max(np.sum(e**2), 1e-300)), 1.0)

    def pitches(self, table: PositionTable, fit: Solution, most: int = 8192) -> list[float]:
        """Return the pitches [m or rad] of waves that a solution with a table lacks, the clearest first.

        Of ``most`` rows and more some are left out, evenly: neighbours tell the same.
        """
        sight = Sight.of(self.motion, table.axis)
        trials = Ripple(table.axis, table.rotary, endless=table.endless).trials(self.motion, sight)
        tried = [e.period for e in trials if isinstance(e, Ripple)]
        if table.amplitude is None or not tried:
            return []
        joint, problem, rates = self.motion.index(table.axis), self.problem, 1.0 / np.array(tried)
        part, place = problem.slices[joint], list(problem.slices).index(joint)
        step = -(-(part.stop - part.start) // most)
        own, rows = problem.dense(np.arange(part.start, part.stop, step))
        belief, weight = fit.options.belief, np.sqrt(step) / fit.sigma[place]
        assert belief is not None
        A, y = np.concatenate([rows[:, :-1] * weight, belief[:, own]]), rows[:, -1] * weight
        U = (A @ analyse(A, fit.options.tolerance).root)[: len(y)]
        q = self.motion.q[self.rows.sample[self.rows.kept[self.rows.joints.index(joint)]], joint][::step]
        waves, found = _Waves(q, weight, table.amplitude**-2.0, table.alike), list[float]()
        e = y - U @ (U.T @ y)
        while len(found) < 8:
            best = int(np.argmax(waves.likelier(rates, U, e)[0]))
            near = rates[max(best - 1, 0) : best + 2]
            near = rates[[best]] if table.closed else np.linspace(near[0], near[-1], 33)
            gain, H, g = waves.likelier(near, U, e)
            best = int(np.argmax(gain))
            if gain[best] < np.log(len(rates)):
                break
            found.append(float(1.0 / near[best]))
            Z, L = waves.of(near[[best]])[:, 0].T, np.linalg.cholesky(H[best])
            new = np.linalg.solve(L, (Z - U @ (U.T @ Z)).T).T
            e, U = e - new @ np.linalg.solve(L, g[best]), np.hstack([U, new])
        return found


@dataclass(frozen=True)
class _Waves:
    """Waves along places, whose two coefficients have a prior."""

    q: Floats  # places [m or rad], shape (n,)
    weight: float  # of each row
    prior: float  # precision of the coefficients
    alike: float  # rows that tell as much as an independent one

    def of(self, rates: Floats) -> Floats:
        """Return cos and sin of waves of even rates (k,) [1/m or 1/rad], shape (2, k, n): products of a few of them."""
        few, step = math.isqrt(len(rates)), rates[-1] - rates[0]
        fine = np.arange(few) * (step / max(len(rates) - 1, 1))
        coarse, fine = (np.exp(2j * np.pi * np.outer(x, self.q)) for x in (rates[::few], fine))
        waves = (coarse[:, None] * fine).reshape(-1, len(self.q))[: len(rates)] * self.weight
        return np.array([waves.real, waves.imag])

    def likelier(self, rates: Floats, U: Floats, e: Floats, most: int = 64) -> tuple[Floats, Floats, Floats]:
        """Return what each wave adds to the log likelihood (k,), and H (k, 2, 2) and b (k, 2) that tell it.

        U are the rows (n, p) of orthonormal columns of the model, e (n,) what it leaves; at most so many are formed.
        """
        H, b, own = np.empty((len(rates), 2, 2)), np.empty((len(rates), 2)), np.eye(2) * self.prior
        for start in range(0, len(rates), most):
            some = slice(start, start + most)
            Z = self.of(rates[some])
            whole, inside = (np.einsum("ikn,jkn->kij", X, X) for X in (Z, Z @ U))
            H[some], b[some] = whole - inside, (Z @ e).T
        gain = np.einsum("ki,ki->k", b, np.linalg.solve(H / self.alike + own, b[:, :, None])[:, :, 0])
        size = np.linalg.slogdet(np.eye(2) + H / (self.alike * self.prior))[1]
        return 0.5 * (gain / self.alike**2 - size), H, b


def _left(R: Floats, z: Floats, where: slice, count: int, seen: float = 1e-9) -> tuple[Floats, Floats]:
    """Return rows of a factor R (k, p), z in what others than the first ``count`` columns of a table leave of them."""
    length, knots = np.linalg.norm(R, axis=0), np.arange(where.start, where.start + count)
    other = np.setdiff1d(np.flatnonzero(length > seen * length.max()), knots)
    U, size, _ = np.linalg.svd(R[:, other] / length[other], full_matrices=False)
    U = U[:, size > seen * size[0]] if len(size) else U
    own = np.column_stack([R[:, knots], z])
    own -= U @ (U.T @ own)
    return own[:, :-1], own[:, -1]


def _likely(
    table: PositionTable, R: Floats, z: Floats, most: float, alike: float, tried: int = 24
) -> PositionTable:
    """Return a table with its likeliest amplitude, at most ``most``, and length, of rows R (k, p) and z (k,).

    Lengths are tried from half a spacing of the knots to the whole travel, amplitudes on as fine a grid.
    """
    count, spacing = len(table.knots), table.spacing
    H, b, best = R.T @ R / alike, R.T @ z / alike, (-np.inf, most, spacing)
    amplitudes = np.geomspace(1e-3 * most, most, 2 * tried)
    for length in np.geomspace(0.5 * spacing, max(count, 4) * spacing, tried):
        C = np.linalg.cholesky(stiffness(count, spacing, length, closed=table.closed))
        half = scipy.linalg.solve_triangular(C, H, lower=True)
        told, V = np.linalg.eigh(scipy.linalg.solve_triangular(C, half.T, lower=True))
        c2 = (V.T @ scipy.linalg.solve_triangular(C, b, lower=True)) ** 2
        s2, told = amplitudes[:, None] ** 2, np.maximum(told, 0.0)
        evidence = np.sum(s2 * c2 / (1.0 + s2 * told) - np.log1p(s2 * told), axis=1)
        at = int(np.argmax(evidence))
        best = max(best, (float(evidence[at]), float(amplitudes[at]), float(length)))
    return replace(table, amplitude=best[1], length=best[2], alike=alike)
