"""The smallest change of each cause that these logs would have shown: what `none` could have seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Limit:
    """A change that is found in nine of ten logs like these.

    Attributes:
        effect: of the contract. axis: whose. name: of the number. change: its least change. unit: of that.
        before: what the twin holds; 0 for nothing.
    """

    effect: str
    axis: str
    name: str
    change: float
    unit: str
    before: float


def detectable(asked: Asked, bars: Mapping[str, float]) -> list[Limit]:
    """Return the least change of the plain causes of every axis, from their standard errors.

    A score rises by half the square of a number over its standard error. Nine of ten are found where that number is
    1.28 standard errors beyond the one that reaches the bar of its group.

    Args:
        asked: a question.
        bars: group -> score that it takes to be named [nats].
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
            out.append(Limit(effect_of(cause), axis, name, float(abs(least * one)), unit, float(before)))
    return out
