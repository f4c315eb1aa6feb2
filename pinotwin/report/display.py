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


SI = Scale(1.0, "")
"""As the number stands in the file."""
SIGNALS = {"e": "tracking error", "u": "effort"}
"""Signal of a simulation -> its name."""


def position(rotary: bool, largest: float) -> Scale:
    """Return the scale of a position whose largest magnitude is given [m or rad]."""
    if rotary:
        fine = 0.0 < largest * _DEGREE < 0.01
        return Scale(3600.0 * _DEGREE, "″") if fine else Scale(_DEGREE, "°")
    return Scale(1e3, "mm") if largest >= 2e-3 else Scale(1e6, "µm")


def velocity(rotary: bool, largest: float) -> Scale:
    """Return the scale of a velocity whose largest magnitude is given [m/s or rad/s]."""
    if rotary:
        return Scale(_DEGREE, "°/s")
    return Scale(1.0, "m/s") if largest >= 1.0 else Scale(1e3, "mm/s")


def effort(rotary: bool, largest: float) -> Scale:
    """Return the scale of an effort whose largest magnitude is given [N or N·m]."""
    unit = "N·m" if rotary else "N"
    if largest >= 2e4:
        return Scale(1e-3, f"k{unit}")
    if 0.0 < largest < 0.1:
        return Scale(1e3, f"m{unit}")
    return Scale(1.0, unit)


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


def decimals(error: float) -> int:
    """Return how many decimals show two digits of an error; below zero: before the point."""
    return 1 - math.floor(math.log10(error))


def rounded(value: float, error: float) -> tuple[str, str]:
    """Return value and error with two digits of the error, e.g. ``("95.11", "0.11")``.

    Very large and very small numbers share a power of ten: ``("1.234e-05", "0.012e-05")``.
    """
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g}", ""
    size = max(abs(value), error)
    exponent = math.floor(math.log10(size))
    if -4 <= exponent < 6:
        places = max(decimals(error), 0)
        return f"{value:.{min(places, 12)}f}", f"{error:.{min(places, 12)}f}"
    scaled, small = value / 10.0**exponent, error / 10.0**exponent
    places = min(max(decimals(small), 0), 12)
    return f"{scaled:.{places}f}e{exponent:+03d}", f"{small:.{places}f}e{exponent:+03d}"


def number(x: float, unit: str = "") -> str:
    """Return a number with three significant digits and its unit."""
    if not math.isfinite(x):
        return "not known"
    text = f"{x:.3g}"
    return f"{text} {unit}".strip()


def seconds(x: float) -> str:
    """Return a length of time."""
    return f"{x / 60.0:.1f} min" if x >= 120.0 else f"{x:.3g} s"


def elided(path: str, longest: int = 60) -> str:
    """Return the end of a long path."""
    return path if len(path) <= longest else "…" + path[-(longest - 1) :]
