"""A spring with a damper on a joint: what holds a passive joint (thesis Eq. 5.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient
from pinotwin.effects.family import POSITION, Family
from pinotwin.effects.symbols import effort, length
from pinotwin.motion import AxisMotion


@dataclass(frozen=True)
class Spring(AxisEffect):
    """Linear spring and damper: tau = k q + c v."""

    name: ClassVar[str] = "spring"
    family: ClassVar[Family] = POSITION
    title: ClassVar[str] = "Spring"
    words: ClassVar[str] = "a spring between two parts: cable, hose, flexure"
    remedy: ClassVar[str] = "check cables, hoses and covers that are stretched along the travel"
    colour: ClassVar[str] = "#6b8e23"
    contains: ClassVar[tuple[str, ...]] = ("viscous",)
    imitates: ClassVar[tuple[str, ...]] = ("position_table", "rigid_body", "hysteresis")
    causes: ClassVar[tuple[Cause, ...]] = ("stiffness", "viscous")
    axis: str
    rotary: bool = True

    def coefficients(self) -> tuple[Coefficient, ...]:
        f, x = effort(self.rotary), length(self.rotary)
        return (Coefficient("k", f"{f}/{x}", lower=0.0), Coefficient("c", f"{f}·s/{x}", lower=0.0))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return np.stack([motion.q, motion.v], axis=-1)
