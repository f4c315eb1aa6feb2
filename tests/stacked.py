"""Linear problems of several axes from their rows, and intervals of what a fit found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.solve.problem import Problem
from pinotwin.solve.result import LinearFit


@dataclass(frozen=True)
class AxisRows:
    """The rows of one axis: regressor (n, p), effort, sample index and unbroken stretch (n,)."""

    W: Floats
    y: Floats
    time: Ints
    block: Ints | None = None


def stack(parts: Sequence[AxisRows], names: Sequence[str]) -> Problem:
    """Return the problem of several axes, numbered in the order given."""
    blocks = [np.zeros(len(x.y), int) if x.block is None else x.block for x in parts]
    return Problem(
        W=scipy.sparse.csr_array(np.concatenate([x.W for x in parts])),
        y=np.concatenate([x.y for x in parts]),
        axis=np.repeat(np.arange(len(parts)), [len(x.y) for x in parts]),
        time=np.concatenate([x.time for x in parts]).astype(np.intp),
        names=tuple(names),
        block=np.concatenate(blocks).astype(np.intp),
    )


def interval(fit: LinearFit, level: float = 0.95) -> Floats:
    """Return the confidence interval of every parameter, cut at its bounds, shape (p, 2)."""
    reach = scipy.special.stdtrit(fit.dof, 0.5 + level / 2) * fit.standard_errors
    return np.stack([np.maximum(fit.theta - reach, fit.lower), np.minimum(fit.theta + reach, fit.upper)], 1)
