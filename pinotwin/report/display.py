"""How numbers are shown to people: sensible prefixes and digits; the only place that leaves SI."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats

_DEGREE = 180.0 / math.pi


@dataclass(frozen=True)
class Scale:
    """A factor from SI to the unit that is shown."""

    factor: float
    unit: str

    def __call__(self, x: Floats) -> Floats:
        """Return the numbers in the unit that is shown."""
        return np.asarray(x * self.factor, dtype=float)

    def text(self, x: float) -> str:
        """Return a number [SI] with three digits and the unit that is shown."""
        return number(x * self.factor, self.unit)


SI = Scale(1.0, "")
"""As the number stands in the file."""
DEGREES = Scale(_DEGREE, "deg")
SIGNALS = {"e": "tracking error", "u": "effort"}
"""Signal of a simulation -> its name."""


def scale_of(signal: str, rotary: bool, x: Floats | float) -> Scale:
    """Return the scale of effort u, position q, velocity v or tracking error e, by the largest of x [SI]."""
    most = largest(np.atleast_1d(x))
    if signal == "v" and not rotary:
        return Scale(1.0, "m/s") if most >= 1.0 else Scale(1e3, "mm/s")
    if signal == "v":
        return Scale(_DEGREE, "°/s")
    if signal not in ("q", "ql", "e"):
        unit = effort_unit(rotary)
        if most >= 2e4:
            return Scale(1e-3, f"k{unit}")
        return Scale(1e3, f"m{unit}") if 0.0 < most < 0.1 else Scale(1.0, unit)
    if not rotary:
        return Scale(1e3, "mm") if most >= 2e-3 else Scale(1e6, "µm")
    if signal == "e" and most * _DEGREE < 1.0:
        return Scale(1e3 * _DEGREE, "mdeg")
    return Scale(3600.0 * _DEGREE, "″") if 0.0 < most * _DEGREE < 0.01 else Scale(_DEGREE, "°")


def effort_unit(rotary: bool) -> str:
    """Return the SI unit of an effort."""
    return "N·m" if rotary else "N"


def largest(x: Floats) -> float:
    """Return the largest finite magnitude, 0 when there is none."""
    finite = np.abs(x[np.isfinite(x)])
    return float(finite.max(initial=0.0))


def percent(x: float) -> str:
    """Return a share in per cent with two significant digits or so."""
    if not math.isfinite(x):
        return "not known"
    p = 100.0 * x
    if p >= 999.5:
        return f"{x:.3g} times"
    if p >= 99.95:
        return f"{p:.0f} %"
    return f"{p:.1f} %" if p >= 0.95 else f"{p:.2g} %"


def rounded(value: float, error: float) -> tuple[str, str]:
    """Return value and error with two digits of the error: ``("95.11", "0.11")``, ``("1.234e-05", "0.012e-05")``."""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g}", ""
    exponent = math.floor(math.log10(max(abs(value), error)))
    power = 0 if -4 <= exponent < 6 else exponent
    places = min(max(1 + power - math.floor(math.log10(error)), 0), 12)
    end = f"e{power:+03d}" if power else ""
    first, second = (f"{x / 10.0**power:z.{places}f}{end}" for x in (value, error))
    return first, second


def number(x: float, unit: str = "") -> str:
    """Return a number with three significant digits and its unit."""
    if not math.isfinite(x):
        return "not known"
    return f"{x:z.3g} {unit}".strip()


def seconds(x: float) -> str:
    """Return a length of time."""
    return f"{x / 60.0:.1f} min" if x >= 120.0 else f"{x:.3g} s"


def elided(path: str, longest: int = 60) -> str:
    """Return the end of a long path."""
    return path if len(path) <= longest else "…" + path[-(longest - 1) :]
