"""What a healthy day does, as columns times their measured widths: equation -> (n, m)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.law import TERMS
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.stretch import Stretch

Shapes = Mapping[tuple[str, str], float]
"""Axis and equation -> how far the causes found there may be off in their direction, as a share of the effort."""


def healthy_day(r: Reference, s: Stretch, name: str, found: Shapes) -> dict[str, Floats]:
    """Return the columns of a healthy day of one axis, equation -> (n, m); what a cause leaves is no second one."""
    c, w = s.axes[name], r.widths[name]
    out = {
        "plant": np.column_stack(
            [
                (c["dry"] + c["viscous"]) * w["friction"],
                c["dry"] * w["dry"],
                c["viscous"] * w["viscous"],
                c["viscous"] * np.exp(-s.t / 10.0) * w["warm"],
                c["one"] * w["offset"] * w["effort"],
                c["du"] * w["late"] * 0.5 * s.cycle,
                c["a"] * w["inertia"],
                c["s"] * w["snap"],
                c["unsure"],
            ]
        )
    }
    if name in r.laws and "e" in c:
        numbers = r.laws[name].columns(c)
        own = [numbers[k] * x for k, x in r.law_widths[name].items()]
        drift = (s.t - s.t.mean()) * 1e-4
        out["law"] = np.column_stack([c["one"] * 1e3 * w["effort"], drift * w["effort"], *own])
    if name in r.twists and "gap" in c:
        place, give = c["q"] - c["q"].mean(), r.twist(name, c)
        zero = w["zero"] if name in r.zeros else 1.0  # one metre, or radian: nobody knows it
        held = 0.5 * r.twists[name][0] * c["left"]  # by the motor's friction
        out["encoders"] = np.column_stack([c["one"] * zero, place * w["scale"], give * w["give"], held])
    parts = {"plant": [c["dry"], c["viscous"], c["rest"]]}
    if "law" in out:
        parts["law"] = [c[k] * gain for k, gain in zip(TERMS, r.laws[name].gains, strict=True)]
    for equation, terms in parts.items():
        if unsure := found.get((name, equation)):
            out[equation] = np.column_stack([out[equation], *(x * unsure for x in terms)])
    return out
