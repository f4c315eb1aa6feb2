"""What the name and unit of a column say: which axis, and which of its signals."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pinotwin.units import SI_FACTOR

_LENGTHS = ("m", "mm", "cm", "um", "µm", "nm", "inch", "in")
_ANGLES = ("rad", "mrad", "urad", "deg", "°", "Grad", "degrees", "mdeg", "m°", "arcmin", "arcsec")
_TURNS = ("rev", "turn", "Umdr")
_FORCES = ("N", "kN", "mN", "Nm", "N·m", "N.m", "N*m", "kNm", "mNm", "Ncm")
_CURRENTS = ("A", "Arms", "Apk", "mA", "kA", "%", "‰", "permille", "0.1%")
_POSITION_UNITS = frozenset((*_LENGTHS, *_ANGLES, *_TURNS))
_EFFORT_UNITS = frozenset((*_FORCES, *_CURRENTS))
_WORDS = {
    kind: frozenset(words.split())
    for kind, words in {
        "error": "err error lag schlepp schleppfehler deviation abweichung diff follow following",
        "command": "cmd command commanded set setpoint setpos setvalue soll sollwert lagesollwert target desired "
        "ref reference nominal posc action demand goal qr tcmd",
        "effort": "current curr cur torque effort force iq strom moment drehmoment kraft trq amp amps tau torq "
        "motorcurrent tcmd i u load acttorque utilization",
        "velocity": "vel velo velocity speed geschw geschwindigkeit drehzahl rpm qd dq",
        "acceleration": "acc accel acceleration beschleunigung jerk ruck",
        "position": "pos position actpos ist istwert lageistwert act actual posf feedback fb enc encoder meas "
        "measured state q lage angle winkel actualposition",
        "temperature": "temp temperature temperatur",
    }.items()
}


def tokens(name: str) -> list[str]:
    """Return the words of a name: ``X1_ActualPosition`` -> x1, actual, position."""
    spaced = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    return [part.casefold() for part in re.split(r"[\W_]+", spaced) if part]


def read_label(
    name: str, unit: str | None, axes: Sequence[str] = (), joints: Sequence[str] = ()
) -> tuple[str | None, str | None, str]:
    """Return axis and signal (``qr q v u e``) that a column's name, and its unit in the file, say, and why.

    None where they do not say it; ``joints`` are in the order of ``axes``.
    """
    words = tokens(name)
    return _axis(name, words, axes, joints), *_signal(words, unit)


def _named(words: Sequence[str]) -> dict[str, list[str]]:
    """Return kind of signal -> the words that say so."""
    named = {kind: [w for w in words if w in known] for kind, known in _WORDS.items()}
    if "d" in words[1:] and (named["position"] or named["velocity"]):  # q_d: the desired one
        named["command"].append("d")
    if words[-1:] == ["output"]:  # of a controller: the effort that it asks for
        named["effort"].append("output")
    return named


def _signal(words: Sequence[str], unit: str | None) -> tuple[str | None, str]:
    named = _named(words)
    stated = unit if unit in SI_FACTOR else None
    if named["temperature"] or named["acceleration"]:
        return None, ""
    if stated in _EFFORT_UNITS:
        return "u", f"its unit is {stated}"
    if stated and ("/" in stated or stated in ("rpm", "min-1", "min^-1")):
        return ("v", f"its unit is {stated}") if not named["command"] else (None, "")
    if named["error"]:
        return "e", f"named {named['error'][0]!r}"
    position = stated in _POSITION_UNITS
    if named["effort"] and not position and not (named["effort"] == ["i"] and named["position"] == ["q"]):
        return "u", f"named {named['effort'][0]!r}"
    if named["velocity"] and not position:
        return ("v", f"named {named['velocity'][0]!r}") if not named["command"] else (None, "")
    if named["command"]:
        return "qr", f"named {named['command'][0]!r}"
    if named["position"] or position:
        return "q", f"named {named['position'][0]!r}" if named["position"] else f"its unit is {stated}"
    return None, ""


def _axis(name: str, words: Sequence[str], axes: Sequence[str], joints: Sequence[str]) -> str | None:
    folded = name.casefold()
    for axis, joint in zip(axes, joints, strict=True):
        for own in (axis.casefold(), joint.casefold()):
            if own in words or f"{own}1" in words or (len(own) > 3 and own in folded):
                return axis
    glued = [w for w in words if len(w) > 1 and w[0] in {a.casefold() for a in axes} and w[1:] in _ALL_WORDS]
    return next((a for a in axes if glued and a.casefold() == glued[0][0]), None)  # xpos, yact


_ALL_WORDS = {word for words in _WORDS.values() for word in words if len(word) > 2}


def is_set_value(name: str) -> bool:
    """Whether a column's name says that it is asked for, or computed by the controller, not measured."""
    words = tokens(name)
    return "output" in words or any(word in _WORDS["command"] - {"qr", "action"} for word in words)


def family(name: str) -> tuple[str, int] | None:
    """Return the stem and the number of a numbered column: ``position[3]``, ``J3_cur``, ``joint_3``."""
    match = re.search(r"\[(\d+)\]$", name) or re.search(
        r"(?<![A-Za-z\d])[A-Za-z]{0,8}_?(\d{1,2})(?!\d)", name
    )
    if match is None:
        return None
    return name[: match.start(1)] + "#" + name[match.end(1) :], int(match[1])
