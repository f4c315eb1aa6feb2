"""A cause that was found, put into what the model leaves anyway: the logs as they would be if it were the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.evidence.held_out import SCALED_RIDGE
from pinotwin.diagnosis.search.scan import Scored
from pinotwin.solve.jackknife import solved

TRIALS = 10  # With each cause that is put in
STRETCH = 1.0  # Length of the stretches that are laid in another order [s]


def trial(c: Comparison, left: Mapping[int, Floats], cause: Scored, rng: np.random.Generator) -> Comparison:
    """Return the comparison with what the model leaves anyway laid in another order, and the cause put in.

    ``left``: joint -> what a machine's model leaves of these logs, floor units; of a twin its own logs are taken. What
    the twin always lacked of this very cause comes with the motion: it is taken off every change and stays.
    """
    residual: Mapping[int, Floats] = {j: left[j] * c.floor[j] for j in left}
    theta = cause.judged.theta
    if c.own is not None:
        always = lacked(c, cause)
        columns = cause.table[1]
        residual = {j: x - columns[j] @ always if j in columns else x for j, x in c.own.residual.items()}
        theta = theta + always
    new = _with(c.new, residual, cause.table[0], theta, rng)
    unseen = None if c.unseen is None else _with(c.unseen, residual, cause.table[-1], theta, rng)
    return replace(c, new=new, unseen=unseen)


def lacked(c: Comparison, cause: Scored) -> Floats:
    """Return the coefficients of a cause that the twin's own logs ask for already, shape (p,)."""
    columns, residual = cause.table[1], {} if c.own is None else c.own.residual
    joints = [j for j in columns if j in residual]
    if not joints:
        return np.zeros(len(cause.judged.theta))
    X = np.concatenate([columns[j] / c.floor[j] for j in joints])
    r = np.concatenate([residual[j] / c.floor[j] for j in joints])
    return solved((X.T @ X)[None], (X.T @ r)[None], SCALED_RIDGE)[0]


def _with(
    target: Sample,
    residual: Mapping[int, Floats],
    columns: Mapping[int, Floats],
    theta: Floats,
    rng: np.random.Generator,
) -> Sample:
    out = {}
    for j in target.joints:
        n = len(target.residual[j])
        out[j] = laid(target, residual[j], n, rng) if j in residual else np.zeros(n)
        if j in columns:
            out[j] = out[j] + columns[j] @ theta
    return replace(target, residual=out)


def laid(target: Sample, residual: Floats, n: int, rng: np.random.Generator) -> Floats:
    """Return n rows of a residual, stretches of :data:`STRETCH` drawn with replacement; zeros where it is shorter."""
    return shuffled(
        residual, n, max(4, round(STRETCH / (target.motion.step * target.motion.decimation))), rng
    )


def shuffled(residual: Floats, n: int, size: int, rng: np.random.Generator) -> Floats:
    """Return n rows of a residual, stretches of so many rows drawn with replacement; zeros where it is shorter."""
    if len(residual) <= size:
        return np.zeros(n)
    starts = rng.integers(0, len(residual) - size, size=-(-n // size))
    return np.concatenate([residual[s : s + size] for s in starts])[:n]
