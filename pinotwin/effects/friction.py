"""Dry and viscous friction of an axis (thesis Eq. 3.8; Armstrong-Hélouvry 1994, 10.1016/0005-1098(94)90209-7).

    tau = b v + d(v) [c + s exp(-|v / v_s|^k)]                                      [N or N·m]

Each term is an effect of its own, so that it can be listed, left out, withheld or diagnosed alone.
``d`` is the direction with memory of :mod:`pinotwin.effects.direction`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.direction import default_width, direction
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient, Depends, Shape
from pinotwin.effects.symbols import effort, length
from pinotwin.motion import AxisMotion


def _d(motion: AxisMotion, width: float | None) -> Floats:
    return direction(motion, default_width(motion.rotary) if width is None else width)


@dataclass(frozen=True)
class Viscous(AxisEffect):
    """Friction in proportion to speed: tau = b v."""

    name: ClassVar[str] = "viscous"
    causes: ClassVar[tuple[Cause, ...]] = ("viscous",)
    depends: ClassVar[Depends] = "velocity"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        return (Coefficient("b", f"{effort(self.rotary)}·s/{length(self.rotary)}", lower=0.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        return motion.v[:, None]


@dataclass(frozen=True)
class ViscousAsymmetric(AxisEffect):
    """Viscous friction with its own coefficient per direction: tau = b+ max(v, 0) + b- min(v, 0)."""

    name: ClassVar[str] = "viscous_asymmetric"
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "velocity"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        unit = f"{effort(self.rotary)}·s/{length(self.rotary)}"
        return (Coefficient("b_plus", unit, lower=0.0), Coefficient("b_minus", unit, lower=0.0))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        return np.stack([np.maximum(motion.v, 0.0), np.minimum(motion.v, 0.0)], axis=-1)


@dataclass(frozen=True)
class Coulomb(AxisEffect):
    """Dry friction: tau = c d(v).

    Attributes:
        width: velocity over which the direction turns [m/s or rad/s]; 0 is the plain sign.
    """

    name: ClassVar[str] = "coulomb"
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "direction"
    axis: str
    rotary: bool = False
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        return (Coefficient("c", effort(self.rotary), lower=0.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        return _d(motion, self.width)[:, None]


@dataclass(frozen=True)
class CoulombAsymmetric(AxisEffect):
    """Dry friction with its own level per direction: tau = c+ max(d, 0) + c- min(d, 0).

    Identical to ``coulomb`` with an ``offset``: list one or the other.
    """

    name: ClassVar[str] = "coulomb_asymmetric"
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "direction"
    axis: str
    rotary: bool = False
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        unit = effort(self.rotary)
        return (Coefficient("c_plus", unit, lower=0.0), Coefficient("c_minus", unit, lower=0.0))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        d = _d(motion, self.width)
        return np.stack([np.maximum(d, 0.0), np.minimum(d, 0.0)], axis=-1)


@dataclass(frozen=True)
class Stribeck(AxisEffect):
    """The part of dry friction that fades with speed: tau = s d(v) exp(-|v / v_s|^k), beside coulomb.

    Attributes:
        v_s: speed at which it has fallen to 1/e [m/s or rad/s]; searched.
        exponent: k; 1 in the thesis (Eq. 3.8), 2 in much of the literature.
    """

    name: ClassVar[str] = "stribeck"
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "direction"
    axis: str
    rotary: bool = False
    v_s: float = 0.01
    exponent: float = 1.0
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        return (Coefficient("s", effort(self.rotary), lower=0.0),)

    def shapes(self) -> tuple[Shape, ...]:
        """See :meth:`Effect.shapes`."""
        low, high = (1e-3, 3.0) if self.rotary else (5e-4, 0.3)
        return (Shape("v_s", f"{length(self.rotary)}/s", low, high),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        fade = np.exp(-(np.abs(motion.v / self.v_s) ** self.exponent))
        return (_d(motion, self.width) * fade)[:, None]


@dataclass(frozen=True)
class QuadraticDrag(AxisEffect):
    """Drag that grows with the square of speed (fans, churning oil): tau = b2 v |v|."""

    name: ClassVar[str] = "quadratic_drag"
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "velocity"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        unit = f"{effort(self.rotary)}·s²/{length(self.rotary)}²"
        return (Coefficient("b2", unit, lower=0.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        return (motion.v * np.abs(motion.v))[:, None]
