"""The parameters of a twin by name: every number with its unit, its interval, and whether to believe it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, SupportsIndex, overload

import numpy as np
from scipy.special import stdtrit

from pinotwin.errors import InputError, TwinError, require
from pinotwin.log import require_pandas
from pinotwin.notebook import Card, Shown


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
        determined: False when this log cannot tell it; ``value`` is then the prior (CAD or zero), or near it.
        verdict: one word or sentence for the reader: ``good``, ``weak``, or why not to use it.
        prior: value before the log, if there was one [unit].
        meaning: the grouping of a base parameter written out.
        dof: degrees of freedom of its error, for Student's t: few where few seconds of the log tell it.
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
    dof: float = float("inf")

    @property
    def standard_error(self) -> float:
        """Standard error [unit]; NaN when the data do not determine it."""
        return self.error

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval by Student's t at a level of confidence, NaN where not determined.

        Raises:
            InputError: the level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level: {level} is not between 0 and 1, such as 0.95")
        half = float(stdtrit(self.dof, 0.5 + 0.5 * level)) * self.error
        return (self.value - half, self.value + half)

    def as_dict(self) -> dict[str, Any]:
        """Return the row as it is written to twin.json."""
        low, high = self.interval()
        return {name: x for name, x in vars(self).items() if name != "error"} | {
            "value": self.value if self.determined or self.prior is not None else None,
            "standard_error": self.error if self.determined else None,
            "interval95": [low, high] if self.determined else None,
            "dof": self.dof if np.isfinite(self.dof) else None,
        }


class Parameters(Card, tuple[Parameter, ...]):
    """The parameters of a twin, in order and by full name: ``twin.parameters["Y.viscous.b"].value``."""

    __slots__ = ()

    @overload  # type: ignore[override]
    def __getitem__(self, key: SupportsIndex | str) -> Parameter: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Parameter, ...]: ...
    def __getitem__(self, key: SupportsIndex | str | slice) -> Parameter | tuple[Parameter, ...]:
        """Return a parameter by name or place; TwinError: there is none of that name."""
        if not isinstance(key, str):
            return super().__getitem__(key)
        require(key, self.keys(), "no parameter", TwinError)
        return super().__getitem__(self.keys().index(key))

    def __contains__(self, key: object) -> bool:
        return key in self.keys() if isinstance(key, str) else super().__contains__(key)

    def keys(self) -> tuple[str, ...]:
        """Return the full names, in order."""
        return tuple(row.name for row in self)

    def values(self) -> tuple[Parameter, ...]:
        """Return the parameters, in order."""
        return tuple(self)

    def items(self) -> Iterator[tuple[str, Parameter]]:
        """Return pairs of name and parameter, in order."""
        return zip(self.keys(), self, strict=True)

    def to_frame(self) -> Any:
        """Return a pandas DataFrame, one row a parameter, its full name as index.

        Raises:
            InputError: pandas is not installed.
        """
        names = [f.name for f in fields(Parameter)]
        table = require_pandas().DataFrame([vars(row) for row in self], columns=names).set_index("name")
        ends = np.array([row.interval() for row in self]).reshape(-1, 2)
        table = table.rename(columns={"error": "standard_error"}).astype({"prior": float})
        return table.assign(low95=ends[:, 0], high95=ends[:, 1])

    def _shown(self) -> Shown:
        """Return one row a parameter, for a notebook and for ``repr``."""
        rows = [(p.name, f"{p.value:.5g}", f"{p.error:.2g}", p.unit, p.verdict) for p in self]
        return (f"{len(self)} parameters", ("name", "value", "standard error", "unit", "verdict"), rows, "")


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
