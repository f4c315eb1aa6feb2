"""Conversion of the units that controllers log into SI (m, rad, s, kg, N, N·m); only where data enter or leave."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from pinotwin.errors import LogError, nearest

_DEG = math.pi / 180.0
_REV = 2.0 * math.pi
_G = 9.80665

_SIZES = (
    (1.0, "1 - s sec Sek m rad m/s rad/s m/s^2 m/s² rad/s^2 rad/s² N Nm N·m N.m N*m A Arms Apk V W degC law"),
    (1.0, "°C K Hz magnitude external"),
    (1e3, "kN kNm kA kW kHz"),
    (60.0, "min"),
    (_G, "g"),
    (_REV, "rev turn Umdr rev/s U/s"),
    (_REV / 60.0, "rpm rev/min U/min 1/min min-1 min^-1"),
    (0.0254, "inch in"),
    (_DEG, "deg ° Grad degrees deg/s °/s Grad/s deg/s^2 deg/s² °/s^2 °/s² Grad/s²"),
    (1.0 / 60.0, "m/min"),
    (1e-2, "cm Ncm %"),
    (1e-3, "ms msec mm mrad mm/s mrad/s mm/s^2 mm/s² mrad/s^2 mrad/s² mN mNm mA mV ‰ permille 0.1%"),
    (_DEG / 60.0, "arcmin deg/min °/min Grad/min"),
    (1e-3 * _DEG, "mdeg m°"),
    (1e-3 / 60.0, "mm/min"),
    (_DEG / 3600.0, "arcsec"),
    (1e-6, "us µs um µm urad µm/s"),
    (1e-9, "ns nm"),
)

_SHOWN = {
    "m": ((1e-3, 1e3, "mm"), (0.0, 1e6, "µm")),
    "rad": ((_DEG, 1.0 / _DEG, "°"), (1e-15, 1e3 / _DEG, "mdeg"), (0.0, 1.0 / _DEG, "°")),
    "m/s": ((1.0, 1.0, "m/s"), (0.0, 1e3, "mm/s")),
    "rad/s": ((0.0, 1.0 / _DEG, "°/s"),),
    "rad/s²": ((0.0, 1.0 / _DEG, "°/s²"),),
    "s": ((0.1, 1.0, "s"), (1e-15, 1e3, "ms"), (0.0, 1.0, "s")),
    "m/N": ((0.0, 1e6, "µm/N"),),
    "1": ((0.0, 1e6, "ppm"),),
    **{u: ((2e4, 1e-3, f"k{u}"), (0.1, 1.0, u), (1e-15, 1e3, f"m{u}"), (0.0, 1.0, u)) for u in ("N", "N·m")},
}  # unit [SI] -> from which size [SI] on, times what, in which unit people read it

UNUSED = {  # unit of an effort that is none of the motor's -> what to say of it
    "magnitude": "a magnitude has no sign and is not used; log the signed effort",
    "external": "an external effort holds nothing of the motor's and is not used; log the measured effort",
}
COUNTS = ("inc", "Inc", "Ink", "incr", "count", "counts", "cts", "puls", "pulse", "pulses")
"""Encoder counts have no size of their own: a column's `factor` must say how large one is."""

SI_FACTOR = {unit: size for size, units in (*_SIZES, (1.0, " ".join(COUNTS))) for unit in units.split()}
"""Factor from a unit to SI. Electrical units pass as they are: the column's own `factor` turns them into N or N·m."""

ELECTRICAL = {  # Unit of an effort before its `factor` turns it into N or N·m -> what it is in here without one
    **dict.fromkeys(("A", "Arms", "Apk", "mA", "kA"), "A"),
    **dict.fromkeys(("V", "mV"), "V"),
    **dict.fromkeys(("%", "‰", "permille", "0.1%"), "rated effort"),
    "law": "law unit",
}


def shown(unit: str, size: float) -> tuple[float, str]:
    """Return factor and unit in which people read numbers of an SI unit, the largest of ``size`` [unit]."""
    rows = _SHOWN.get(unit, ((0.0, 1.0, "" if unit == "-" else unit),))
    return next((row[1:] for row in rows if abs(size) >= row[0]), rows[0][1:])


def rounded(value: float, error: float) -> tuple[str, str]:
    """Return value and error [a unit] with two digits of the error: ``("95.11", "0.11")``, ``("1.2e-5", "0.1e-5")``."""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g}", ""
    exponent = math.floor(math.log10(max(abs(value), error)))
    power = 0 if -4 <= exponent < 6 else exponent
    places = min(max(1 + power - math.floor(math.log10(error)), 0), 12)
    end = f"e{power:+03d}" if power else ""
    first, second = (f"{x / 10.0**power:z.{places}f}{end}" for x in (value, error))
    return first, second


def of_axis(unit: str, rotary: bool) -> str:
    """Return a unit in which F, x and I stand for that of effort, position and inertia of a slide or a rotation."""
    own = ("N·m", "rad", "kg·m²") if rotary else ("N", "m", "kg")
    return unit.translate(dict(zip(map(ord, "FxI"), own, strict=True)))


def in_log_unit(unit: str, rotary: bool, size: Mapping[str, Any]) -> tuple[str, float]:
    """Return a unit with N or N·m by the log's own (``unit`` in ``size``, if any), and how many of the old it is."""
    force = of_axis("F", rotary)
    if not size or not unit.startswith(force):
        return unit, 1.0
    return ELECTRICAL[size["unit"]].split()[0] + unit.removeprefix(force), float(size["size"])


_SPELLED = {
    **dict.fromkeys(("ampere", "amps"), "A"),
    **dict.fromkeys(("volt", "volts"), "V"),
    "newton": "N",
    **dict.fromkeys(("second", "seconds", "sekunde", "sekunden"), "s"),
    **dict.fromkeys(("millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nanoseconds"), "ns"),
    **dict.fromkeys(("percent", "prozent"), "%"),
}


def find_unit(text: str) -> str | None:
    """Return the known unit that a file means, None for none: ``[mm]``, ``V (Voltage)``, ``MM``."""
    bare = text.strip().strip("[]<>").strip()
    bare = bare[1:-1].strip() if bare.startswith("(") and bare.endswith(")") else bare
    first = re.split(r"\s*\(", bare)[0].strip() if "(" in bare else bare
    for spelling in (bare, first, first.replace(" ", ""), first.replace("μ", "µ")):
        if spelling in SI_FACTOR:
            return spelling
    if first.casefold() in _SPELLED:
        return _SPELLED[first.casefold()]
    alike = [unit for unit in SI_FACTOR if unit.casefold() == first.replace(" ", "").casefold()]
    return alike[0] if alike and len({SI_FACTOR[unit] for unit in alike}) == 1 else None


def si_factor(unit: str) -> float:
    """Return the factor that turns a number in ``unit`` into SI; a LogError names the nearest known unit."""
    try:
        return SI_FACTOR[unit.strip()]
    except KeyError:
        raise LogError(f"unknown unit {unit!r}; {nearest(unit, SI_FACTOR)}") from None
