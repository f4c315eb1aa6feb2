"""Dry and viscous friction of an axis (thesis Eq. 3.8; Armstrong-Hélouvry 1994, 10.1016/0005-1098(94)90209-7).

    tau = b v + d(v) [c + s exp(-|v / v_s|^k)]                                      [N or N·m]

Each term is an effect of its own, so that it can be listed, left out, withheld or diagnosed alone.
``d`` is the direction with memory of :func:`direction`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient, Columns, Effect, OneAxis, Shape
from pinotwin.effects.family import FRICTION
from pinotwin.effects.sight import Sight
from pinotwin.motion import AxisMotion, Motion
from pinotwin.signals import since_start
from pinotwin.system.kernels import compiled


@compiled
def _scan(v: Floats, a: Floats, width: float, d0: float) -> Floats:
    d = np.empty_like(v)
    state = d0
    previous = 0.0 if len(v) == 0 else v[0]
    for k in range(len(v)):
        if v[k] * a[k] > 0.0 or (a[k] == 0.0 and v[k] != 0.0):
            state = min(1.0, max(-1.0, state + (v[k] - previous) / width))
        previous = v[k]
        d[k] = state
    return d


def direction(motion: AxisMotion, width: float) -> Floats:
    """Return the direction of motion with memory, shape (n,), within [-1, 1]; it turns over ``width`` [m/s or rad/s].

    ``sign(v)`` chatters at a zero crossing with noise. This changes with slope ``1/width`` while the axis speeds up,
    and holds while it slows down or stands: it goes on the same way without releasing its friction. (Eq. 3.9 of the
    thesis read to the letter would release it at the sample where v is exactly zero.) Each segment starts from
    ``clip(v / width)``: what came before it is not known. A width of 0 gives ``sign(v)``.
    """
    if width <= 0.0:
        return np.sign(motion.v)
    d: Floats = np.clip(motion.v / width, -1.0, 1.0)  # rows between the segments
    for s in motion.segments:
        v, a = motion.v[s], motion.a[s]
        start = float(np.clip(v[0] / width, -1.0, 1.0)) if len(v) else 0.0
        d[s] = _scan(np.ascontiguousarray(v), np.ascontiguousarray(a), width, start)
    return d


def default_width(rotary: bool) -> float:
    """Return the usual width of the turn-over [m/s or rad/s]: 1 mm/s, or 10 mrad/s for a rotary axis."""
    return 1e-2 if rotary else 1e-3


FADES = np.geomspace(0.006, 0.3, 6)  # Speeds at which friction may have faded, as shares of the top speed


@dataclass(frozen=True)
class Friction(OneAxis):
    """What takes power out of the motion of one axis."""

    family = FRICTION
    causes: ClassVar[tuple[Cause, ...]] = ("friction",)


@dataclass(frozen=True)
class Turning(Friction):
    """Friction that turns round over ``width``, a velocity [m/s or rad/s]; 0 is the plain sign."""

    sharp = True
    width: float | None = field(default=None, kw_only=True)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return the effect; in one direction alone it is an offset."""
        return (self,) if sight.both_ways else ()

    def _width(self, rotary: bool) -> float:
        return default_width(rotary) if self.width is None else self.width

    def _direction(self, motion: AxisMotion) -> Floats:
        return direction(motion, self._width(motion.rotary))


@dataclass(frozen=True)
class Viscous(Friction, AxisEffect):
    """Friction in proportion to speed: tau = b v."""

    name = "viscous"
    title = "Viscous friction"
    words = "friction that grows with speed"
    remedy = "check the lubricant and its temperature; a bearing or seal that was changed or over-greased"
    colour = "#f28e2b"
    linear = (Coefficient("b", "F·s/x", lower=0.0),)
    imitates = ("viscous_asymmetric", "viscous_thermal", "quadratic_drag", "stribeck", "delay")
    causes = ("viscous",)
    depends = "velocity"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return motion.v[:, None]


@dataclass(frozen=True)
class ViscousAsymmetric(Friction, AxisEffect):
    """Viscous friction with its own coefficient per direction: tau = b+ max(v, 0) + b- min(v, 0)."""

    name = "viscous_asymmetric"
    title = "Viscous friction by direction"
    words = "friction that grows with speed, more in one direction than in the other"
    remedy = "check seals, wipers and brushes that lean one way, and a cable that is pulled one way and pushed back"
    colour = "#e0b040"
    linear = tuple(Coefficient(name, "F·s/x", lower=0.0) for name in ("b_plus", "b_minus"))
    contains = ("viscous",)
    imitates = ("coulomb_asymmetric", "offset", "quadratic_drag")
    sharp = True
    depends = "velocity"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return np.stack([np.maximum(motion.v, 0.0), np.minimum(motion.v, 0.0)], axis=-1)


@dataclass(frozen=True)
class Coulomb(Turning, AxisEffect):
    """Dry friction: tau = c d(v)."""

    name = "coulomb"
    title = "Dry friction"
    words = "dry friction: the same force at any speed, against the motion"
    remedy = "check preload of bearings, guides and gears, wipers, a brake that drags"
    colour = "#e15759"
    linear = (Coefficient("c", "F", lower=0.0),)
    imitates = ("presliding", "stribeck", "load_friction", "hysteresis")
    depends = "direction"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return self._direction(motion)[:, None]


@dataclass(frozen=True)
class CoulombAsymmetric(Turning, AxisEffect):
    """Dry friction with its own level per direction: tau = c+ max(d, 0) + c- min(d, 0).

    Identical to ``coulomb`` with an ``offset``: list one or the other.
    """

    name = "coulomb_asymmetric"
    title = "Dry friction by direction"
    words = "dry friction that is larger in one direction than in the other"
    remedy = "hold several postures with the brake off and read the effort: weight or counterbalance pulls at rest too"
    colour = "#c2405a"
    linear = tuple(Coefficient(name, "F", lower=0.0) for name in ("c_plus", "c_minus"))
    contains = ("coulomb", "offset")
    inseparable = ("offset",)
    imitates = ("viscous_asymmetric", "rigid_body")
    depends = "direction"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        d = self._direction(motion)
        return np.stack([np.maximum(d, 0.0), np.minimum(d, 0.0)], axis=-1)


@dataclass(frozen=True)
class Stribeck(Turning, AxisEffect):
    """The part of dry friction that fades with speed: tau = s d(v) exp(-|v / v_s|^k), beside coulomb."""

    name = "stribeck"
    title = "Low-speed friction (Stribeck)"
    words = "extra friction at very low speed, as where a lubricating film has not yet formed"
    remedy = "check the lubricant: amount, kind, age; run the axis in over its whole travel"
    colour = "#b6992d"
    linear = (Coefficient("s", "F", lower=0.0),)
    searched = 1
    fades = True
    held = True  # slow rows are few: without them s would run away
    imitates = ("coulomb", "presliding", "viscous", "load_friction", "backlash")
    depends = "direction"
    v_s: float = 0.01  # speed at which it has fallen to 1/e [m/s or rad/s]; searched
    exponent: float = 1.0  # k; 1 in the thesis (Eq. 3.8), 2 in much of the literature.

    def shapes(self) -> tuple[Shape, ...]:
        """Return v_s, from twice the width over which the direction turns: below it s would grow without limit."""
        least, high = (1e-3, 3.0) if self.rotary else (5e-4, 0.3)
        low = max(least, 2.0 * self._width(self.rotary))
        return (Shape("v_s", self.unit("x/s"), low, high),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return fading speeds below which there are rows, and above which too."""
        (shape,) = self.shapes()
        speeds = [x for x in FADES * sight.top if shape.lower <= x <= shape.upper]
        speeds = [x for x in speeds if sight.both_ways and sight.rows_slower(x) >= 30]
        return tuple(replace(self, v_s=float(x), exponent=k) for x in speeds for k in (1.0, 2.0))

    def other_forms(self) -> tuple[Self, ...]:
        """Return the other usual exponent."""
        return (replace(self, exponent=1.0 if self.exponent > 1.5 else 2.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        fade = np.exp(-(np.abs(motion.v / self.v_s) ** self.exponent))
        return (self._direction(motion) * fade)[:, None]


@dataclass(frozen=True)
class QuadraticDrag(Friction, AxisEffect):
    """Drag that grows with the square of speed (fans, churning oil): tau = b2 v |v|."""

    name = "quadratic_drag"
    words = "resistance that grows with the square of speed: air, fan, splashing oil"
    remedy = "check oil level, covers and fans on the moving part"
    colour = "#ff7f8a"
    linear = (Coefficient("b2", "F·s²/x²", lower=0.0),)
    imitates = ("viscous", "viscous_thermal", "viscous_asymmetric")
    depends = "velocity"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return (motion.v * np.abs(motion.v))[:, None]


@dataclass(frozen=True)
class LoadFriction(Turning):
    """Dry friction that grows with the load on bearing, guide or gear: tau = mu |load| d(v).

    The load is the rigid-body effort of the axis (gravity, inertia, coupling), and with ``total`` the
    friction of the axis as well.
    """

    name = "load_friction"
    title = "Friction of the load"
    words = "friction that grows with the load on bearing or gear"
    remedy = "check gear and bearings under load; move the same path with and without a known payload"
    colour = "#8a4f5e"
    linear = (Coefficient("mu", "-", lower=0.0),)
    imitates = ("coulomb", "effort_scale", "stribeck", "viscous_asymmetric")
    needs = ("model", "rigid", "mass")
    searched = 1
    total: int = 0  # 1 for the whole effort of the model as load, 0 for its rigid-body part

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return each kind of load; one that never changes is dry friction."""
        load = np.abs(self.channel(motion, "rigid")[:, motion.index(self.axis)])
        if not sight.both_ways or load.std() < 0.05 * max(load.mean(), 1e-300):
            return ()
        return self, replace(self, total=1), replace(self, total=2)

    def columns(self, motion: Motion) -> Columns:
        own = motion.axis(self.axis)
        load = self.channel(motion, "model" if self.total == 1 else "rigid")[:, own.index]
        if self.total == 2:  # without what accelerates: weight and the forces of speed
            mass = self.channel(motion, "mass")
            load = load - np.einsum("nj,nj->n", mass[:, own.index], motion.a)
        slides = motion.passed(np.abs(load) * self._direction(own))
        return Columns((own.index,), slides[:, None, None])


@dataclass(frozen=True)
class ViscousThermal(Friction, AxisEffect):
    """Viscous friction that changes as the machine warms up: tau = b_warm v [1 - exp(-t / warming)].

    Beside ``viscous``, which is the cold value; t counts from the start of the log.
    """

    name = "viscous_thermal"
    title = "Warming"
    words = "friction that falls or rises as the machine warms up"
    remedy = "warm the machine up before recording, or record the same motion cold and warm"
    colour = "#d9722e"
    linear = (Coefficient("b_warm", "F·s/x"),)
    imitates = ("viscous", "quadratic_drag")
    searched = 1
    warming: float = 15.0  # time constant [s]; searched

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("warming", "s", 0.5, 3600.0),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return time constants [s] of which the log is long enough."""
        length_of = float(motion.t[-1] - motion.t[0]) if len(motion) else 0.0
        return self.over([tau for tau in (5.0, 15.0, 40.0) if tau < 2.0 * length_of])

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return (motion.v * -np.expm1(-since_start(motion.t) / self.warming))[:, None]
