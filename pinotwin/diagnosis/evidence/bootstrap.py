"""The block bootstrap: by how much a share or a gain would differ with other stretches of motion."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.evidence.held_out import Ground, Judged

RESAMPLES = 1000


def lower_bound(judged: Judged, ground: Ground) -> float:
    """Return the lower end of the 90 % interval of a candidate's gain on rows that were not fitted.

    Blocks of validation logs count alike: play at a reversal may lie in one or two blocks of a short log.
    """
    alone = ground.alone
    gains = np.concatenate([alone.left - judged.left, alone.unseen - judged.unseen])
    at = np.random.default_rng(0).integers(len(gains), size=(RESAMPLES, len(gains)))
    return float(np.quantile(gains[at].sum(axis=1), 0.05))


def share_interval(before: Floats, after: Floats, seed: int = 0) -> tuple[float, float]:
    """Return the 90 % interval of 1 - after/before over blocks drawn with replacement."""
    rng = np.random.default_rng(seed)
    at = rng.integers(len(before), size=(RESAMPLES, len(before)))
    shares = 1.0 - after[at].sum(axis=1) / np.maximum(before[at].sum(axis=1), 1e-300)
    low, high = np.quantile(shares, [0.05, 0.95])
    return float(low), float(high)
