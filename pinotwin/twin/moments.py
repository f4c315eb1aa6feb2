"""What a twin keeps of all rows that it was fitted to: enough to add more logs without the rows themselves.

The factor R of ``[W y]`` of a log and a joint (:mod:`pinotwin.solve.rank`), and the covariance of the summed scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array

from pinotwin.arrays import Floats
from pinotwin.solve.linear import Reduced, merged, reduce
from pinotwin.solve.problem import Problem
from pinotwin.solve.sandwich import bartlett


@dataclass(frozen=True, eq=False)
class Moments:
    """Logs reduced joint by joint, at the twin's shapes."""

    logs: tuple[Reduced, ...]  # each with a factor of every joint, empty where it has no rows
    sums: Floats  # sum of the efforts of every joint in each log, shape (logs, nv) [N or N·m]
    memory: Floats  # rows that tell as much as an independent one of what is left, shape (logs, nv)
    scores: Floats  # covariance of the summed scores of the rows over their noise, shape (p, p)
    dof: Floats  # degrees of freedom of each coefficient's standard error, shape (p,)
    pi: Floats  # standard parameters that were believed before any log, shape (p_std,)

    @classmethod
    def of(cls, parts: Sequence[Problem], nv: int, theta: Floats, lags: int, *rest: Floats) -> Self:
        """Return those of a problem a log, of nv joints; what theta of shape (p,) leaves is correlated over lags."""
        sums = np.array([np.bincount(part.axis, part.y, nv) for part in parts])
        memory = np.array([_memory(part, theta, nv, lags) for part in parts])
        return cls(tuple(reduce(part, range(nv)) for part in parts), sums, memory, *rest)

    def __add__(self, other: Moments) -> Moments:
        """Return those of both, the logs of the other one last."""
        sums, memory = np.concatenate([self.sums, other.sums]), np.concatenate([self.memory, other.memory])
        scores = self.scores + other.scores
        return Moments((*self.logs, *other.logs), sums, memory, scores, self.dof + other.dof, self.pi)

    def shorter(self, most: int) -> Moments:
        """Return the same with at most so many logs, the oldest as one."""
        if (many := len(self.logs) - most) <= 0:
            return self
        first, last = slice(many + 1), slice(many + 1, None)
        sums = np.concatenate([self.sums[first].sum(axis=0, keepdims=True), self.sums[last]])
        memory = np.concatenate([self.memory[first].mean(axis=0, keepdims=True), self.memory[last]])
        return replace(self, logs=(merged(self.logs[first]), *self.logs[last]), sums=sums, memory=memory)

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that have rows."""
        return tuple(np.flatnonzero(np.sum([log.rows for log in self.logs], axis=0)).tolist())

    @property
    def whole(self) -> Reduced:
        """All logs as one, of the joints that have rows."""
        every = merged(self.logs)
        return Reduced(
            tuple(every.factors[j] for j in self.joints), tuple(every.rows[j] for j in self.joints)
        )

    def correlated(self, theta: Floats, sigma: Floats) -> float:
        """Return how many rows of noise sigma, shape (joints,), tell as much as one independent row of the residual."""
        power = [[float(np.sum((F @ np.append(theta, -1.0)) ** 2)) for F in log.factors] for log in self.logs]
        level = (self.memory * power).sum(axis=0)[[*self.joints]] / (sigma**2 * self.whole.rows)
        return float(np.mean(np.maximum(level, 1.0)))

    def problem(self, names: Sequence[str]) -> Problem:
        """Return a problem of as few rows that has the same solutions: the factors, a block each log."""
        pairs = [(j, k, log.factors[j]) for j in self.joints for k, log in enumerate(self.logs)]
        lengths = [len(x) for *_, x in pairs]
        F = np.concatenate([x for *_, x in pairs])
        axis, block = (np.repeat([pair[at] for pair in pairs], lengths) for at in (0, 1))
        W, time = csr_array(F[:, :-1]), np.concatenate(list(map(np.arange, lengths)))
        return Problem(W, F[:, -1], axis, time, tuple(names), block)

    def arrays(self) -> dict[str, Any]:
        """Return what a file holds."""
        out = {name: getattr(self, name) for name in ("sums", "memory", "scores", "dof", "pi")}
        out["rows"] = np.array([log.rows for log in self.logs])
        for k, log in enumerate(self.logs):
            out |= {f"factor_{k}_{j}": F for j, F in enumerate(log.factors)}
        return out

    @classmethod
    def read(cls, held: Any) -> Moments | None:
        """Return what :meth:`arrays` wrote; None of an older file."""
        if "rows" not in held:
            return None
        logs = tuple(
            Reduced(tuple(held[f"factor_{k}_{j}"] for j in range(len(rows))), tuple(rows.tolist()))
            for k, rows in enumerate(held["rows"])
        )
        dof = held["dof"] if "dof" in held else np.full(len(held["scores"]), np.inf)
        return cls(logs, held["sums"], held["memory"], held["scores"], dof, held["pi"])


def _memory(problem: Problem, theta: Floats, nv: int, lags: int) -> Floats:
    """Return the variance of the residual's sum over that of as many independent rows, of every joint, shape (nv,)."""
    own = (problem.axis[:, None] == np.arange(nv)) * (problem.y - problem.W @ theta)[:, None]
    power = np.maximum((own**2).sum(axis=0), 1e-300)
    return np.diag(bartlett(problem.grid.spread(own, lags), lags)) / power
