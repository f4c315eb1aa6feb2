"""Several runs of one command: the mean weighted by information.

The plain mean of n runs lowers white noise by sqrt(n) (thesis Eq. 6.11 and Table 6-5) but not what
each run has of its own, such as a scale error. With a standard deviation s_r per run and a scatter
between the runs the weights are 1 / (s_r² + scatter²); the scatter follows by the method of moments
(DerSimonian and Laird 1986, DOI 10.1016/0197-2456(86)90046-2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError


@dataclass(frozen=True)
class Combined:
    """A mean over runs.

    Attributes:
        mean: (n, ...).
        sd: standard deviation of the mean, same shape.
        spread: standard deviation between runs (one number per channel): the noise ceiling.
    """

    mean: Floats
    sd: Floats
    spread: Floats


def combine(runs: Sequence[Floats], sd: Sequence[Floats]) -> Combined:
    """Return the mean weighted by information.

    Args:
        runs: estimates of each run on one clock, (n, ...).
        sd: their standard deviations, (n, ...) or anything that broadcasts to it.

    Raises:
        DataError: fewer than two runs, shapes that differ, or a standard deviation of zero.
    """
    x = _stacked(runs)
    s2 = np.stack([np.mean(np.broadcast_to(s, x.shape[1:]) ** 2, axis=0) for s in sd])
    if len(s2) != len(x) or not np.all(s2 > 0.0):
        raise DataError("every run needs a positive standard deviation")
    w = 1.0 / s2
    share = w / w.sum(axis=0)
    mean = np.sum(share[:, None] * x, axis=0)
    cochran = np.mean(np.sum(w[:, None] * (x - mean) ** 2, axis=0), axis=0)
    scatter = (cochran - (len(x) - 1)) / (w.sum(axis=0) - (w**2).sum(axis=0) / w.sum(axis=0))
    w = 1.0 / (s2 + np.maximum(scatter, 0.0))
    share = w / w.sum(axis=0)
    mean = np.sum(share[:, None] * x, axis=0)
    spread = np.sqrt(np.mean((x - mean) ** 2, axis=(0, 1)) * len(x) / (len(x) - 1))
    sd_mean = np.broadcast_to(1.0 / np.sqrt(w.sum(axis=0)), mean.shape)
    return Combined(mean, np.array(sd_mean), np.asarray(spread))


def _stacked(runs: Sequence[Floats]) -> Floats:
    if len(runs) < 2 or len({np.shape(r) for r in runs}) != 1:
        raise DataError("averaging needs at least two runs of one length, on one clock")
    return np.stack([np.asarray(r, dtype=float) for r in runs])
