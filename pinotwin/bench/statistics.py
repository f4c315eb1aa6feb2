"""Shares with exact bounds, calibration of stated probabilities, rank correlation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Share:
    """So many of so many."""

    hits: int  # how many
    of: int  # out of how many

    @classmethod
    def over(cls, flags: Sequence[bool]) -> Share:
        """Return the share of flags that are set."""
        return cls(int(sum(bool(f) for f in flags)), len(flags))

    @property
    def value(self) -> float | None:
        """The share, or None of nothing."""
        return self.hits / self.of if self.of else None

    def upper(self, confidence: float = 0.95) -> float:
        """Return the exact one-sided upper bound of Clopper and Pearson 1934 (10.1093/biomet/26.4.404)."""
        from scipy.stats import binomtest

        if not self.of:
            return 1.0
        return float(binomtest(self.hits, self.of, alternative="less").proportion_ci(confidence).high)


@dataclass(frozen=True)
class Calibration:
    """Stated probabilities against how often they were right."""

    error: float  # expected calibration error over bins of equal mass
    brier: float  # mean squared difference of the probability and the outcome (Brier 1950)
    bins: tuple[tuple[float, float, int], ...]  # (mean stated, share right, answers) of every bin, rising


def calibration(stated: Sequence[float], right: Sequence[bool], bins: int = 10) -> Calibration | None:
    """Return how well stated probabilities are calibrated; None for fewer answers than bins."""
    if len(stated) < bins:
        return None
    order = np.argsort(np.asarray(stated), kind="stable")
    p = np.asarray(stated, dtype=float)[order]
    hit = np.asarray(right, dtype=float)[order]
    parts = np.array_split(np.arange(len(p)), bins)
    rows = tuple((float(p[k].mean()), float(hit[k].mean()), len(k)) for k in parts)
    error = sum(abs(c - r) * n for c, r, n in rows) / len(p)
    return Calibration(float(error), float(np.mean((p - hit) ** 2)), rows)
