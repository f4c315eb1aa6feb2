"""How a loop was found: intervals, bounds, errors; kept beside the model that it judges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import msgspec


@dataclass(frozen=True)
class ParameterFit:
    """One searched parameter."""

    name: str  # ``"p1"``, ``"wn1"``, ``"zeta1"``, ``"pff"``
    value: float  # [Hz] or [-]
    unit: str  # ``"Hz"`` or ``"-"``
    bounds: tuple[float, float]  # of the search
    error: float | None  # standard error of the logarithm; None at a bound
    interval: tuple[float, float] | None  # 95 % interval; None at a bound
    at_bound: str | None  # ``"lower"``, ``"upper"`` or None

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
    """Result of a fit."""

    parameters: tuple[ParameterFit, ...]  # the searched poles
    # standard errors of the numerators, by ``"e/d"``; same order as the coefficients
    numerator_errors: Mapping[str, tuple[float, ...]]
    nrmse: Mapping[str, float]  # rms error over rms of the signal, by output, on the data of the fit
    rms: Mapping[str, float]  # rms error [unit of the output]
    samples: int  # number of samples
    blocks: int  # number of blocks of rows that the intervals rest on
    evaluations: int  # of the cost
    ends: tuple[float, ...] = ()  # costs at which the short searches ended, over the lowest
    notes: tuple[str, ...] = ()  # what deserves attention, one sentence each

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the fit that :meth:`to_dict` wrote."""
        return msgspec.convert(values, cls)
