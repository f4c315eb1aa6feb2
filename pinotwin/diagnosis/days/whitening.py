"""The spectrum of a misfit, taken out: what is left counts row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.diagnosis.settings import SETTINGS

COUNTED = {"plant": "moving", "law": "clear", "encoders": "one"}
"""Equation -> channel that is 1 on rows that count."""


@dataclass(frozen=True, eq=False)
class Whitening:
    """Autoregression of a misfit that healthy logs left.

    Attributes:
        rho: coefficients, shape (order,). sigma: size of what it leaves [unit of the equation].
        spread: rows of which one is independent. turning: size where an axis turns round, over sigma [1].
    """

    rho: Floats
    sigma: float
    spread: float
    turning: float = np.inf

    @property
    def weight(self) -> float:
        """What a whitened row is divided by to count as one independent row [unit of the equation]."""
        return self.sigma * float(np.sqrt(self.spread))

    def __call__(self, x: Floats) -> Floats:
        """Return columns (n, k) without the spectrum; rows without a past are zero."""
        y = lfilter(np.r_[1.0, -self.rho], [1.0], x, axis=0)
        y[: len(self.rho)] = 0.0
        return np.asarray(y)

    def turns(self, left: Sequence[Floats], columns: Sequence[Mapping[str, Floats]]) -> Whitening:
        """Return the whitening that knows, too, what healthy logs left, (n,) each, where an axis turns round."""
        rows = np.concatenate([self(x)[turned(c) > 0.0] for x, c in zip(left, columns, strict=True)])
        few = 5.0 * self.spread  # so many rows tell nothing, as after the five numbers of a day
        power = (self.sigma**2 + rows @ rows) / max(len(rows) - few, 1e-9)
        return replace(self, turning=max(float(np.sqrt(power)) / self.sigma, 1.0))

    def counts(self, c: Mapping[str, Floats], equation: str) -> Floats:
        """Return what a whitened row of an equation counts, (n,): 1, and less where an axis turns round."""
        rows = settled(c[COUNTED[equation]])
        return rows + turned(c) / self.turning if equation == "plant" else rows

    @classmethod
    def measured(cls, left: Sequence[Floats], masks: Sequence[Floats]) -> Whitening:
        """Return the whitening of what healthy logs left; masks are 1 on rows that count, shape (n,) each."""
        order = SETTINGS.order
        pairs = list(zip(left, masks, strict=True))
        C = np.zeros(order + 1)
        for n in range(order + 1):
            power = sum(float((x[n:] * x[: len(x) - n] * m[n:] * m[: len(m) - n]).sum()) for x, m in pairs)
            C[n] = power / max(sum(float((m[n:] * m[: len(m) - n]).sum()) for _, m in pairs), 1.0)
        C[0] = 1.05 * C[0] + 1e-300  # a white floor: beyond the low-pass there is nothing to be learnt
        rough = cls(np.asarray(np.linalg.solve(toeplitz(C[:-1]), C[1:]), dtype=float), 1.0, 1.0)
        rest = [rough(x[:, None])[:, 0][settled(m) > 0.0] for x, m in pairs]
        square = np.concatenate(rest) ** 2
        if not len(square):
            return rough
        sigma = float(np.sqrt(np.mean(np.minimum(square, np.quantile(square, 0.99))))) + 1e-300
        return cls(rough.rho, sigma, _spread(np.concatenate([x - x.mean() for x in rest if len(x)])))


def _spread(x: Floats) -> float:
    """Return how many rows make one independent one: 1 + 2 times the sum of the autocorrelation."""
    most = min(60, len(x) // 4)
    if most < 2:
        return 1.0
    r = np.array([np.mean(x[:-i] * x[i:]) for i in range(1, most)]) / max(float(np.mean(x**2)), 1e-300)
    stop = int(np.argmax(r < 0.05)) if (r < 0.05).any() else most - 1
    return float(1.0 + 2.0 * r[:stop].sum())


def settled(mask: Floats) -> Floats:
    """Return 1 on rows whose past counts too, as far as the whitening reaches, shape (n,)."""
    reach = SETTINGS.order + 1
    total = np.cumsum(np.r_[np.zeros(reach), mask])
    return (total[reach:] - total[:-reach] > SETTINGS.order + 0.5).astype(float)


def turned(c: Mapping[str, Floats]) -> Floats:
    """Return 1 on rows whose past is of an axis that turns round, does not stand, and 0 else, shape (n,)."""
    return settled(c["going"]) - settled(c["moving"])
