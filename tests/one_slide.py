"""A motion of one slide in closed form, and rows of it with a residual of one's own."""

from __future__ import annotations

import numpy as np

from pinotwin.diagnosis.data.samples import Sample, sample
from pinotwin.motion import Motion

RATE, SECONDS = 100.0, 30.0


def motion(seed: int = 0) -> Motion:
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    q = np.sin(0.7 * t) + 0.3 * np.sin(2.3 * t + seed)
    v, a = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    one = np.ones((len(t), 1), dtype=bool)
    columns = (x[:, None] for x in (q, v, a, v))
    q, v, a, u = columns
    return Motion(("X",), (False,), t, q, v, a, u, (slice(0, len(t)),), 1.0 / RATE, one)


def rows(residual: np.ndarray, seed: int = 0) -> Sample:
    return sample(motion(seed), residual[:, None])
