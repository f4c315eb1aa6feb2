"""Words for combinations of parameters, such as ``Iyy_B + Ixx_C + 0.0064 m_C + Ja_B``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats

_KIND_ORDER = {"I": 0, "m": 2, "J": 3}  # inertias, first moments (1), masses; rotors last of all


def _rank(name: str, position: int) -> tuple[int, int, int]:
    """Return a sort key: from the base outwards inertias, moments, mass; then rotors."""
    kind = 1 if re.match(r"m[xyz]_", name) else _KIND_ORDER[name[0]]
    body = 0 if kind == 3 else position // 10
    return (kind == 3, body, kind * 100 + position % 10)


def combination(coefficients: Floats, names: Sequence[str]) -> str:
    """Return a sum of parameters in words; zero coefficients are left out.

    Args:
        coefficients: one per parameter, shape (p,).
        names: the parameters' names, as from ``parameter_names``.
    """
    terms = sorted(np.flatnonzero(coefficients).tolist(), key=lambda k: _rank(names[k], k))
    text = ""
    for k in terms:
        value = float(coefficients[k])
        size = f"{abs(value):.4g}"
        factor = "" if size == "1" else f"{size} "
        sign = (" - " if value < 0 else " + ") if text else ("-" if value < 0 else "")
        text += f"{sign}{factor}{names[k]}"
    return text


def labels(P: Floats, independent: Sequence[int], names: Sequence[str]) -> tuple[str, ...]:
    """Return one short, unique name for every row of ``P``; a star says that it is a grouping.

    A row is called after the innermost parameter of its own kind that enters it with factor one (a
    rotor inertia gives way to what a link adds to it), unless an earlier row has that name.
    """
    out: list[str] = []
    for row, own in zip(P, independent, strict=True):
        ones = sorted(np.flatnonzero(row == 1.0).tolist(), key=lambda k: _rank(names[k], k))
        star = "*" if np.count_nonzero(row) > 1 else ""
        kinds = ("I", "m_", "J") if names[own].startswith("J") else (names[own][:2],)
        choices = [names[k] for kind in kinds for k in ones if names[k].startswith(kind)]
        label = next((c for c in choices if f"{c}{star}" not in out), names[own])
        out.append(f"{label}{star}")
    return tuple(out)
