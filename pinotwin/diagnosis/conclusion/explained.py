"""What the named causes close of the gap of every axis, on rows that they were not fitted to.

Each is measured beside those named before it, as a share of the whole residual of its axis: shares of causes add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Shrink, shrunk


@dataclass(frozen=True, eq=False)
class Closed:
    """What is closed of the squared residual of one axis, in units of its floor."""

    before: Floats  # the whole of it by block, shape (K,)
    gained: Floats  # what goes of that, shape (K,)
    promised: float  # share that goes of the logs in question
    on: str  # which rows these are

    @property
    def share(self) -> float:
        """Share of the whole that goes; below zero where it grows."""
        return float(self.gained.sum() / max(float(self.before.sum()), 1e-300))

    def shrink(self, level: float, axis: str) -> Shrink:
        """Return how far the gap of an axis shrinks, from its RMS [N or N·m]."""
        interval = share_interval(self.before, self.before - self.gained)
        return shrunk(level, self.share, interval, self.promised, self.on, axis)

    def beside(self, other: Closed) -> Closed:
        """Return what two causes close together."""
        both = self.promised + other.promised
        return Closed(self.before, self.gained + other.gained, both, self.on)


def rival(effect: str, axis: str, probability: float, share: float, score: float) -> dict[str, Any]:
    """Return what else a cause may be, in the form of the contract: share that it closes [1], score [nats]."""
    why = f"its score is {score:.0f}, in natural logarithms of likelihood"
    share = min(max(share, 0.0), 1.0)
    return {"effect": effect, "axis": axis, "probability": probability, "share": share, "why": why}


RESAMPLES = 1000


def drawn(*powers: Floats, seed: int = 0) -> Floats:
    """Return sums of squared residuals by block, shape (K,) each, over blocks drawn with replacement, one row each."""
    count = len(powers[0])
    at = np.random.default_rng(seed).integers(count, size=(RESAMPLES, count))
    return np.array([x[at].sum(axis=1) for x in powers])


def share_interval(before: Floats, after: Floats, seed: int = 0) -> tuple[float, float]:
    """Return the 90 % interval of 1 - after/before over blocks drawn with replacement."""
    before, after = drawn(before, after, seed=seed)
    low, high = np.quantile(1.0 - after / np.maximum(before, 1e-300), [0.05, 0.95])
    return float(low), float(high)


def stated_of(level: float, x: Shrink) -> Shrink:
    """Return a shrink as one of the whole gap of a signal, from its RMS; a vibration's is above its noise."""
    share = (x.before**2 - x.after**2) / max(level**2, 1e-300)
    part = share / x.share if x.share > 0.0 else 0.0
    interval = (part * x.interval[0], part * x.interval[1])
    return shrunk(level, share, interval, part * x.promised, x.on, x.axis)
