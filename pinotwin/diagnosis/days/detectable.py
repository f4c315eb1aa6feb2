"""The smallest change of each cause that these logs would have shown: what `none` could have seen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pinotwin.diagnosis.days.causes import Place, effect_of, unit_of
from pinotwin.diagnosis.days.mechanisms import GROUP
from pinotwin.diagnosis.days.rows import Asked

PLAIN = (
    "friction_scale",
    "coulomb",
    "viscous",
    "offset",
    "effort_scale",
    "position_gain",
    "velocity_feedforward",
    "acceleration_feedforward",
    "lost_motion",
    "compliance",
    "zero",
)


def detectable(asked: Asked, bars: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the least change of the plain causes of every axis, from their standard errors.

    A score rises by half the square of a number over its standard error. Nine of ten are found where that number is
    1.28 standard errors beyond the one that reaches the bar of its group [nats]. ``before``: what the twin holds of it.
    """
    out = []
    for axis in asked.r.axes:
        at = Place(asked.r, axis, asked.q.logs)
        for cause in PLAIN:
            found = asked.error(f"{cause}:{axis}" if cause == "zero" else cause, axis)
            if found is None:
                continue
            error, told = found
            bar = bars.get(GROUP[cause], max(bars.values()))
            least = max(error * np.sqrt(2.0 * bar), told) + 1.28 * error
            name, before, one, unit = unit_of(cause, at)
            what = {"effect": effect_of(cause), "axis": axis, "name": name}
            out.append({**what, "size": float(abs(least * one)), "unit": unit, "before": float(before)})
    return out
