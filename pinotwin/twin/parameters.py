"""The parameter table of a twin: every number with its unit, its interval, and whether to believe it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """One identified number.

    Attributes:
        name: full name, e.g. ``Y.coulomb.c`` or ``rigid_body.M_Z``.
        effect: key of the effect it belongs to, e.g. ``Y.coulomb``.
        kind: ``"linear"`` (solved) or ``"shape"`` (searched).
        value: estimate [unit].
        unit: SI unit.
        error: standard error [unit]; nan when the data do not determine it.
        determined: False when this log cannot tell it; ``value`` is then the prior (CAD or zero).
        verdict: one word or sentence for the reader: ``good``, ``weak``, or why not to use it.
        prior: value before the log, if there was one [unit].
        meaning: the grouping of a base parameter written out.
    """

    name: str
    effect: str
    kind: str
    value: float
    unit: str
    error: float
    determined: bool
    verdict: str
    prior: float | None = None
    meaning: str = ""

    def interval(self, z: float = 1.959964) -> tuple[float, float]:
        """Return the interval ``value ± z error``; 95 % by default."""
        return (self.value - z * self.error, self.value + z * self.error)

    def as_dict(self) -> dict[str, Any]:
        """Return the row as it is written to twin.json."""
        low, high = self.interval()
        return {
            "name": self.name,
            "effect": self.effect,
            "kind": self.kind,
            "value": self.value if self.determined or self.prior is not None else None,
            "unit": self.unit,
            "standard_error": self.error if self.determined else None,
            "interval95": [low, high] if self.determined else None,
            "determined": self.determined,
            "verdict": self.verdict,
            "prior": self.prior,
            "meaning": self.meaning,
        }


def verdict(value: float, error: float, *, at_bound: bool) -> str:
    """Return a verdict on an estimate from its relative standard error."""
    if at_bound:
        return "at its bound"
    if not np.isfinite(error):
        return "not determined"
    ratio = error / max(abs(value), 1e-300)
    if ratio < 0.1:
        return "good"
    if ratio < 0.5:
        return "fair"
    return "weak: its interval is wide against its size"
