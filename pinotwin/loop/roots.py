r"""kp and 1/ti of a cascade: two roots of one equation, often nearly equal.

    (1 + T A) r² - (A + T B) r + B = 0     for r = 1/ti,     kp = A - (1 + T A) r

with A = k_e / k_v, B = k_i / k_v and the lag T of the velocity; kp is, but for the lag, the other root. They lie
sqrt(apart) from one another, apart = (A - T B)² - 4 B; where they meet, a linear estimate of their error grows without
bound. Intervals are therefore made from ``apart`` and its error, not from the slopes of the roots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Self


class Roots(NamedTuple):
    """What the feedback says of kp and 1/ti."""

    kp: float  # middle of the kp that there may be [1/s]
    rate: float  # the same of 1/ti [1/s]
    square: float  # 1 + T A, by which a change of 1/ti moves kp the other way [-]
    apart: float  # square of the difference of the roots [1/s²]; below zero where noise left no real ones
    product: float  # kp / ti [1/s²]

    @classmethod
    def of(cls, gains: Sequence[float], lag: float) -> Self:
        """Return the roots of six gains and a lag of the velocity [s]."""
        A, B = gains[0] / gains[2], gains[1] / gains[2]
        square = 1.0 + lag * A
        rate = 0.5 * (A + lag * B) / square
        return cls(0.5 * (A - lag * B), rate, square, (A - lag * B) ** 2 - 4.0 * B, B * (1.0 - lag * rate))

    def half(self, more: float = 0.0) -> float:
        """Return half the difference of the two 1/ti [1/s], ``more`` added to what they are apart [1/s²]."""
        return 0.5 * math.sqrt(max(self.apart + more, 0.0)) / self.square

    def rates(self, named: float, error: float, *, tied: bool) -> tuple[float, float]:
        """Return the lowest and the highest 1/ti [1/s] at 90 %, on both sides of the middle where ``tied``."""
        far, near = self.half(error), self.half(-error)
        if tied:
            return self.rate - far, self.rate + far
        side = 1.0 if named >= self.rate else -1.0
        ends = self.rate + side * near, self.rate + side * far
        return min(ends), max(ends)
