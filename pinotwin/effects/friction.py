"""Dry and viscous friction of an axis (thesis Eq. 3.8; Armstrong-Hélouvry 1994, 10.1016/0005-1098(94)90209-7).

    tau = b v + d(v) [c + s exp(-|v / v_s|^k)]                                      [N or N·m]

Each term is an effect of its own, so that it can be listed, left out, withheld or diagnosed alone.
``d`` is the direction with memory of :mod:`pinotwin.effects.direction`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.direction import default_width, direction
from pinotwin.effects.effect import (
    AxisEffect,
    Cause,
    Coefficient,
    Columns,
    Depends,
    Effect,
    Need,
    Shape,
    channel,
)
from pinotwin.effects.family import FRICTION, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.symbols import effort, length
from pinotwin.motion import AxisMotion, Motion
from pinotwin.signals import since_start

FADES = np.geomspace(0.006, 0.3, 6)
"""Speeds at which friction may have faded, as shares of the top speed."""
SLOW_ROWS = 30
"""Rows slower than a fading speed without which it cannot be seen."""
WARMING = (5.0, 15.0, 40.0)
"""Time constants of warming that are tried [s]."""


class Turning:
    """Friction that turns round with the motion over a width of speeds."""

    width: float | None

    def turned(self, rotary: bool) -> float:
        """See :meth:`Effect.turned`: from one direction to the other it is two widths."""
        return 2.0 * self._width(rotary)

    def _width(self, rotary: bool) -> float:
        return default_width(rotary) if self.width is None else self.width

    def _direction(self, motion: AxisMotion) -> Floats:
        return direction(motion, self._width(motion.rotary))


@dataclass(frozen=True)
class Viscous(AxisEffect):
    """Friction in proportion to speed: tau = b v."""

    name: ClassVar[str] = "viscous"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Viscous friction"
    words: ClassVar[str] = "friction that grows with speed"
    remedy: ClassVar[str] = (
        "check the lubricant and its temperature; a bearing or seal that was changed or over-greased"
    )
    colour: ClassVar[str] = "#f28e2b"
    imitates: ClassVar[tuple[str, ...]] = (
        "viscous_asymmetric",
        "viscous_thermal",
        "quadratic_drag",
        "stribeck",
        "delay",
    )
    causes: ClassVar[tuple[Cause, ...]] = ("viscous",)
    depends: ClassVar[Depends] = "velocity"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("b", f"{effort(self.rotary)}·s/{length(self.rotary)}", lower=0.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return motion.v[:, None]


@dataclass(frozen=True)
class ViscousAsymmetric(AxisEffect):
    """Viscous friction with its own coefficient per direction: tau = b+ max(v, 0) + b- min(v, 0)."""

    name: ClassVar[str] = "viscous_asymmetric"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Viscous friction by direction"
    words: ClassVar[str] = "friction that grows with speed, more in one direction than in the other"
    remedy: ClassVar[str] = (
        "check seals, wipers and brushes that lean one way, and a cable that is pulled one way and pushed back"
    )
    colour: ClassVar[str] = "#e0b040"
    contains: ClassVar[tuple[str, ...]] = ("viscous",)
    imitates: ClassVar[tuple[str, ...]] = ("coulomb_asymmetric", "offset", "quadratic_drag")
    sharp: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "velocity"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        unit = f"{effort(self.rotary)}·s/{length(self.rotary)}"
        return (Coefficient("b_plus", unit, lower=0.0), Coefficient("b_minus", unit, lower=0.0))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return np.stack([np.maximum(motion.v, 0.0), np.minimum(motion.v, 0.0)], axis=-1)


@dataclass(frozen=True)
class Coulomb(Turning, AxisEffect):
    """Dry friction: tau = c d(v).

    Attributes:
        width: velocity over which the direction turns [m/s or rad/s]; 0 is the plain sign.
    """

    name: ClassVar[str] = "coulomb"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Dry friction"
    words: ClassVar[str] = "dry friction: the same force at any speed, against the motion"
    remedy: ClassVar[str] = "check preload of bearings, guides and gears, wipers, a brake that drags"
    colour: ClassVar[str] = "#e15759"
    imitates: ClassVar[tuple[str, ...]] = ("presliding", "stribeck", "load_friction", "hysteresis")
    sharp: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "direction"
    axis: str
    rotary: bool = False
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("c", effort(self.rotary), lower=0.0),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: in one direction alone it is an offset."""
        del motion
        return (self,) if sight.both_ways else ()

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return self._direction(motion)[:, None]


@dataclass(frozen=True)
class CoulombAsymmetric(Turning, AxisEffect):
    """Dry friction with its own level per direction: tau = c+ max(d, 0) + c- min(d, 0).

    Identical to ``coulomb`` with an ``offset``: list one or the other.
    """

    name: ClassVar[str] = "coulomb_asymmetric"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Dry friction by direction"
    words: ClassVar[str] = "dry friction that is larger in one direction than in the other"
    remedy: ClassVar[str] = (
        "hold several postures with the brake off and read the effort: a weight or counterbalance pulls at rest too"
    )
    colour: ClassVar[str] = "#c2405a"
    contains: ClassVar[tuple[str, ...]] = ("coulomb", "offset")
    inseparable: ClassVar[tuple[str, ...]] = ("offset",)
    imitates: ClassVar[tuple[str, ...]] = ("viscous_asymmetric", "rigid_body")
    sharp: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "direction"
    axis: str
    rotary: bool = False
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        unit = effort(self.rotary)
        return (Coefficient("c_plus", unit, lower=0.0), Coefficient("c_minus", unit, lower=0.0))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        del motion
        return (self,) if sight.both_ways else ()

    def axis_columns(self, motion: AxisMotion) -> Floats:
        d = self._direction(motion)
        return np.stack([np.maximum(d, 0.0), np.minimum(d, 0.0)], axis=-1)


@dataclass(frozen=True)
class Stribeck(Turning, AxisEffect):
    """The part of dry friction that fades with speed: tau = s d(v) exp(-|v / v_s|^k), beside coulomb.

    Attributes:
        v_s: speed at which it has fallen to 1/e [m/s or rad/s]; searched.
        exponent: k; 1 in the thesis (Eq. 3.8), 2 in much of the literature.
    """

    name: ClassVar[str] = "stribeck"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Low-speed friction (Stribeck)"
    words: ClassVar[str] = "extra friction at very low speed, as where a lubricating film has not yet formed"
    remedy: ClassVar[str] = "check the lubricant: amount, kind, age; run the axis in over its whole travel"
    colour: ClassVar[str] = "#b6992d"
    searched: ClassVar[int] = 1
    fades: ClassVar[bool] = True
    held: ClassVar[bool] = True  # slow rows are few: without them s would run away
    imitates: ClassVar[tuple[str, ...]] = ("coulomb", "presliding", "viscous", "load_friction", "backlash")
    sharp: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "direction"
    axis: str
    rotary: bool = False
    v_s: float = 0.01
    exponent: float = 1.0
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("s", effort(self.rotary), lower=0.0),)

    def shapes(self) -> tuple[Shape, ...]:
        """See :meth:`Effect.shapes`.

        Below twice the width over which the direction turns, s and v_s cannot be told apart: s would grow
        without limit, and hold the simulated axis with a force that no row has shown.
        """
        least, high = (1e-3, 3.0) if self.rotary else (5e-4, 0.3)
        low = max(least, self.turned(self.rotary))
        return (Shape("v_s", f"{length(self.rotary)}/s", low, high),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: fading speeds below which there are rows, and above which too."""
        (shape,) = self.shapes()
        speeds = [x for x in FADES * sight.top if shape.lower <= x <= shape.upper]
        speeds = [x for x in speeds if sight.rows_slower(x) >= SLOW_ROWS]
        if not sight.both_ways:
            return ()
        return tuple(replace(self, v_s=float(x), exponent=k) for x in speeds for k in (1.0, 2.0))

    def other_forms(self) -> tuple[Self, ...]:
        """See :meth:`Effect.other_forms`: the other usual exponent."""
        return (replace(self, exponent=1.0 if self.exponent > 1.5 else 2.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        fade = np.exp(-(np.abs(motion.v / self.v_s) ** self.exponent))
        return (self._direction(motion) * fade)[:, None]


@dataclass(frozen=True)
class QuadraticDrag(AxisEffect):
    """Drag that grows with the square of speed (fans, churning oil): tau = b2 v |v|."""

    name: ClassVar[str] = "quadratic_drag"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Quadratic drag"
    words: ClassVar[str] = "resistance that grows with the square of speed: air, fan, splashing oil"
    remedy: ClassVar[str] = "check oil level, covers and fans on the moving part"
    colour: ClassVar[str] = "#ff7f8a"
    imitates: ClassVar[tuple[str, ...]] = ("viscous", "viscous_thermal", "viscous_asymmetric")
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    depends: ClassVar[Depends] = "velocity"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        unit = f"{effort(self.rotary)}·s²/{length(self.rotary)}²"
        return (Coefficient("b2", unit, lower=0.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return (motion.v * np.abs(motion.v))[:, None]


@dataclass(frozen=True)
class LoadFriction(Turning, Effect):
    """Dry friction that grows with the load on bearing, guide or gear: tau = mu |load| d(v).

    The load is the rigid-body effort of the axis (gravity, inertia, coupling), and with ``total`` the
    friction of the axis as well.

    Attributes:
        total: 1 for the whole effort of the model as load, 0 for its rigid-body part.
        width: velocity over which the direction turns [m/s or rad/s].
    """

    name: ClassVar[str] = "load_friction"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Friction of the load"
    words: ClassVar[str] = "friction that grows with the load on bearing or gear"
    remedy: ClassVar[str] = (
        "check gear and bearings under load; move the same path with and without a known payload"
    )
    colour: ClassVar[str] = "#8a4f5e"
    imitates: ClassVar[tuple[str, ...]] = ("coulomb", "effort_scale", "stribeck", "viscous_asymmetric")
    needs: ClassVar[tuple[Need, ...]] = ("model", "rigid", "mass")
    sharp: ClassVar[bool] = True
    searched: ClassVar[int] = 1
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    axis: str
    rotary: bool = False
    total: int = 0
    width: float | None = None

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("mu", "-", lower=0.0),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: a load that never changes is dry friction."""
        load = np.abs(channel(self, motion, "rigid")[:, motion.index(self.axis)])
        if not sight.both_ways or load.std() < 0.05 * max(load.mean(), 1e-300):
            return ()
        return self, replace(self, total=1), replace(self, total=2)

    def columns(self, motion: Motion) -> Columns:
        own = motion.axis(self.axis)
        load = channel(self, motion, "model" if self.total == 1 else "rigid")[:, own.index]
        if self.total == 2:  # without what accelerates: weight and the forces of speed
            mass = channel(self, motion, "mass")
            load = load - np.einsum("nj,nj->n", mass[:, own.index], motion.a)
        slides = motion.passed(np.abs(load) * self._direction(own))
        return Columns((own.index,), slides[:, None, None])


@dataclass(frozen=True)
class ViscousThermal(AxisEffect):
    """Viscous friction that changes as the machine warms up: tau = b_warm v [1 - exp(-t / warming)].

    Beside ``viscous``, which is the cold value; t counts from the start of the log.

    Attributes:
        warming: time constant [s]; searched.
    """

    name: ClassVar[str] = "viscous_thermal"
    family: ClassVar[Family] = FRICTION
    title: ClassVar[str] = "Warming"
    words: ClassVar[str] = "friction that falls or rises as the machine warms up"
    remedy: ClassVar[str] = "warm the machine up before recording, or record the same motion cold and warm"
    colour: ClassVar[str] = "#d9722e"
    imitates: ClassVar[tuple[str, ...]] = ("viscous", "quadratic_drag")
    searched: ClassVar[int] = 1
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)
    axis: str
    rotary: bool = False
    warming: float = 15.0

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("b_warm", f"{effort(self.rotary)}·s/{length(self.rotary)}"),)

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("warming", "s", 0.5, 3600.0),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: time constants of which the log is long enough."""
        del sight
        length_of = float(motion.t[-1] - motion.t[0]) if len(motion) else 0.0
        return self.over([tau for tau in WARMING if tau < 2.0 * length_of])

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return (motion.v * -np.expm1(-since_start(motion.t) / self.warming))[:, None]
