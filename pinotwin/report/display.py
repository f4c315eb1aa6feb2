"""How numbers are shown to people: sensible prefixes and digits; the only place that leaves SI."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.units import shown


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


SI = Scale(1.0, "")  # As the number stands in the file
DEGREES = Scale(180.0 / math.pi, "°")
SIGNALS = {"e": "tracking error", "u": "effort"}  # Signal of a simulation -> its name


def scale_of(signal: str, rotary: bool, x: Floats | float) -> Scale:
    """Return the scale of effort u, position q, velocity v or tracking error e, by the largest of x [SI]."""
    unit = {"q": "m", "ql": "m", "e": "m", "v": "m/s"}.get(signal, "N")
    turned = {"m": "rad", "m/s": "rad/s", "N": "N·m"}[unit] if rotary else unit
    return Scale(*shown(turned, largest(np.atleast_1d(x))))


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


def number(x: float, unit: str = "") -> str:
    """Return a number with three significant digits and its unit."""
    if not math.isfinite(x):
        return "not known"
    return f"{x:z{'.3g' if abs(x) < 999.5 else '.0f'}} {unit}".strip()


def seconds(x: float) -> str:
    """Return a length of time."""
    return f"{x / 60.0:.1f} min" if x >= 120.0 else f"{x:.3g} s"


def elided(path: str, longest: int = 60) -> str:
    """Return the end of a long path."""
    return path if len(path) <= longest else "…" + path[-(longest - 1) :]
