"""Dry friction that gives way before it slips: slip elements in parallel (Iwan 1966, Masing).

    tau = z [c + s exp(-|v / v_s|)],      z = mean of z_i,   dz_i = clip(dq / x_i) within [-1, 1]

Six elastic elements slip one after the other, at displacements ``x_i`` spread so that the first slide
from rest follows ``1 - exp(-x / x_s)``. ``z`` remembers where the axis came from, over micrometres or
millidegrees, so friction at standstill is what the last reversal left. (A single bristle after Dahl has
the same curve but creeps under encoder noise; slip elements do not: Al-Bender 2005,
10.1109/TAC.2005.858676.) On an axis it stands in place of ``coulomb`` and ``stribeck``, and rows at
standstill are then used to identify it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numba
import numpy as np
from scipy.special import gammaincinv

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient, Depends, Shape
from pinotwin.effects.symbols import effort, length
from pinotwin.motion import AxisMotion

# Medians of six equal parts of the gamma(2) distribution, whose slip elements add up to 1 - exp(-x).
YIELDS = gammaincinv(2.0, (np.arange(6) + 0.5) / 6.0)
PAST = 20.0
"""Samples before a stretch in which the axis is taken to have moved as at its start."""


@numba.njit(cache=True)
def _slip(q: Floats, yields: Floats, past: float, out: Floats) -> None:
    bend = np.clip(past / yields, -1.0, 1.0)
    for k in range(len(q)):
        step = q[k] - q[k - 1] if k > 0 else 0.0
        total = 0.0
        for i in range(len(yields)):
            bend[i] = min(1.0, max(-1.0, bend[i] + step / yields[i]))
            total += bend[i]
        out[k] = total / len(yields)


def bristle(motion: AxisMotion, x_s: float) -> Floats:
    """Return the common bend z of the elements, from -1 to 1, shape (n,).

    A stretch that starts in motion starts bent by the last few samples of it; one that starts at rest
    starts unbent, for friction at standstill depends on a past that the log does not hold.
    """
    z = np.zeros_like(motion.q)
    for s in motion.segments:
        past = PAST * motion.step * float(motion.v[s.start])
        _slip(np.ascontiguousarray(motion.q[s]), x_s * YIELDS, past, z[s])
    return z


@dataclass(frozen=True)
class Presliding(AxisEffect):
    """Coulomb friction with presliding: tau = z(q; x_s) [c + s exp(-|v / v_s|)].

    Attributes:
        x_s: displacement over which friction turns round [m or rad]; searched.
        v_s: speed at which the Stribeck part has fallen to 1/e [m/s or rad/s]; searched.
        stribeck: number of Stribeck terms, 1 or 0.
        exponent: of the Stribeck term, as in :class:`Stribeck`.
    """

    name: ClassVar[str] = "presliding"
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "displacement"
    uses_standstill: ClassVar[bool] = True
    axis: str
    rotary: bool = False
    x_s: float | None = None
    v_s: float = 0.01
    stribeck: int = 1
    exponent: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "stribeck", int(self.stribeck))
        if self.x_s is None:
            object.__setattr__(self, "x_s", 5e-5 if self.rotary else 1e-5)

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        unit = effort(self.rotary)
        slow = (Coefficient("s", unit, lower=0.0),) if self.stribeck else ()
        return (Coefficient("c", unit, lower=0.0), *slow)

    def shapes(self) -> tuple[Shape, ...]:
        """See :meth:`Effect.shapes`."""
        x = length(self.rotary)
        bend = Shape("x_s", x, *((1e-6, 1e-2) if self.rotary else (1e-7, 1e-3)))
        fade = Shape("v_s", f"{x}/s", *((1e-3, 3.0) if self.rotary else (5e-4, 0.3)))
        return (bend, fade) if self.stribeck else (bend,)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        assert self.x_s is not None
        z = bristle(motion, self.x_s)
        if not self.stribeck:
            return z[:, None]
        fade = np.exp(-(np.abs(motion.v / self.v_s) ** self.exponent))
        return np.stack([z, z * fade], axis=-1)
