"""How a loop was found: intervals, bounds, errors; kept beside the model that it judges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import msgspec


@dataclass(frozen=True)
class ParameterFit:
    """One searched parameter.

    Attributes:
        name: ``"p1"``, ``"wn1"``, ``"zeta1"``, ``"pff"``.
        value: [Hz] or [-].
        unit: ``"Hz"`` or ``"-"``.
        bounds: of the search.
        error: standard error of the logarithm; None at a bound.
        interval: 95 % interval; None at a bound.
        at_bound: ``"lower"``, ``"upper"`` or None.
    """

    name: str
    value: float
    unit: str
    bounds: tuple[float, float]
    error: float | None
    interval: tuple[float, float] | None
    at_bound: str | None

    def row(self) -> dict[str, Any]:
        """Return the cells of a pole table beside name, value and unit."""
        return {
            "lower": self.bounds[0],
            "upper": self.bounds[1],
            "interval": self.interval,
            "at_bound": self.at_bound,
        }


@dataclass(frozen=True)
class LoopFit:
    """Result of a fit.

    Attributes:
        parameters: the searched poles.
        numerator_errors: standard errors of the numerators, by ``"e/d"``; same order as the
            coefficients.
        nrmse: rms error over rms of the signal, by output, on the data of the fit.
        rms: rms error [unit of the output].
        samples: number of samples.
        blocks: number of blocks of rows that the intervals rest on.
        evaluations: of the cost.
        ends: costs at which the short searches ended, over the lowest.
        notes: what deserves attention, one sentence each.
    """

    parameters: tuple[ParameterFit, ...]
    numerator_errors: Mapping[str, tuple[float, ...]]
    nrmse: Mapping[str, float]
    rms: Mapping[str, float]
    samples: int
    blocks: int
    evaluations: int
    ends: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the fit that :meth:`to_dict` wrote."""
        return msgspec.convert(values, cls)
