"""Conversion of the units that controllers log into SI; used only where data enter or leave.

Inside pinotwin every number is SI: m, rad, s, kg, N, N·m.
"""

from __future__ import annotations

import math
import re

from pinotwin.errors import LogError, nearest

_DEG = math.pi / 180.0
_REV = 2.0 * math.pi
_G = 9.80665

# Factor from the unit to SI. Electrical units pass as they are: the column's own `factor` turns them
# into N or N·m.
SI_FACTOR: dict[str, float] = {
    "1": 1.0,
    "-": 1.0,
    "s": 1.0,
    "sec": 1.0,
    "Sek": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "m": 1.0,
    "mm": 1e-3,
    "cm": 1e-2,
    "um": 1e-6,
    "µm": 1e-6,
    "nm": 1e-9,
    "inch": 0.0254,
    "in": 0.0254,
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "deg": _DEG,
    "°": _DEG,
    "Grad": _DEG,
    "degrees": _DEG,
    "mdeg": 1e-3 * _DEG,
    "m°": 1e-3 * _DEG,
    "arcmin": _DEG / 60.0,
    "arcsec": _DEG / 3600.0,
    "rev": _REV,
    "turn": _REV,
    "Umdr": _REV,
    "m/s": 1.0,
    "mm/s": 1e-3,
    "m/min": 1.0 / 60.0,
    "mm/min": 1e-3 / 60.0,
    "µm/s": 1e-6,
    "rad/s": 1.0,
    "mrad/s": 1e-3,
    "deg/s": _DEG,
    "°/s": _DEG,
    "Grad/s": _DEG,
    "deg/min": _DEG / 60.0,
    "°/min": _DEG / 60.0,
    "Grad/min": _DEG / 60.0,
    "rev/s": _REV,
    "rpm": _REV / 60.0,
    "rev/min": _REV / 60.0,
    "U/min": _REV / 60.0,
    "1/min": _REV / 60.0,
    "min-1": _REV / 60.0,
    "min^-1": _REV / 60.0,
    "U/s": _REV,
    "m/s^2": 1.0,
    "m/s²": 1.0,
    "mm/s^2": 1e-3,
    "mm/s²": 1e-3,
    "g": _G,
    "rad/s^2": 1.0,
    "rad/s²": 1.0,
    "mrad/s^2": 1e-3,
    "mrad/s²": 1e-3,
    "deg/s^2": _DEG,
    "deg/s²": _DEG,
    "°/s^2": _DEG,
    "°/s²": _DEG,
    "Grad/s²": _DEG,
    "N": 1.0,
    "kN": 1e3,
    "mN": 1e-3,
    "Nm": 1.0,
    "N·m": 1.0,
    "N.m": 1.0,
    "N*m": 1.0,
    "kNm": 1e3,
    "mNm": 1e-3,
    "Ncm": 1e-2,
    "A": 1.0,
    "Arms": 1.0,
    "Apk": 1.0,
    "mA": 1e-3,
    "kA": 1e3,
    "V": 1.0,
    "mV": 1e-3,
    "W": 1.0,
    "kW": 1e3,
    "%": 1e-2,
    "‰": 1e-3,
    "permille": 1e-3,
    "0.1%": 1e-3,
    "inc": 1.0,
    "Inc": 1.0,
    "Ink": 1.0,
    "incr": 1.0,
    "count": 1.0,
    "counts": 1.0,
    "cts": 1.0,
    "puls": 1.0,
    "pulse": 1.0,
    "pulses": 1.0,
    "degC": 1.0,
    "°C": 1.0,
    "K": 1.0,
    "Hz": 1.0,
    "kHz": 1e3,
}

ELECTRICAL = {
    **dict.fromkeys(("A", "Arms", "Apk", "mA", "kA"), "A"),
    **dict.fromkeys(("V", "mV"), "V"),
    **dict.fromkeys(("%", "‰", "permille", "0.1%"), "parts of the rated effort"),
}
"""Unit of an effort before its `factor` turns it into N or N·m -> what it is in here without one."""

COUNTS = ("inc", "Inc", "Ink", "incr", "count", "counts", "cts", "puls", "pulse", "pulses")
"""Encoder counts have no size of their own: a column's `factor` must say how large one is."""


_SPELLED = {
    spelled: unit
    for unit, words in {
        "A": "ampere amps",
        "V": "volt volts",
        "N": "newton",
        "s": "second seconds sekunde sekunden",
        "ms": "millisecond milliseconds",
        "us": "usec microseconds",
        "ns": "nsec nanoseconds",
        "%": "percent prozent",
    }.items()
    for spelled in words.split()
}


def find_unit(text: str) -> str | None:
    """Return the known unit that a file means, None for none: ``[mm]``, ``V (Voltage)``, ``MM``.

    Brackets and words behind the unit do not count; capitals only where two units differ by them.
    """
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
    """Return the factor that turns a number in ``unit`` into SI.

    Raises:
        LogError: the unit is unknown; the message names the nearest known one.
    """
    try:
        return SI_FACTOR[unit.strip()]
    except KeyError:
        raise LogError(f"unknown unit {unit!r}; {nearest(unit, SI_FACTOR)}") from None
