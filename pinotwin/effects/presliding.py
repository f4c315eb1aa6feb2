"""Dry friction that gives way before it slips: slip elements and a bristle, from a reversal on.

    tau = z [c + s exp(-|v / v_s|^k)] + m (y - z) + d y'

``z`` is the mean of six slip elements in parallel (Iwan 1966, Masing), ``dz_i = clip(dq / x_i)`` within [-1, 1], at
displacements ``x_i`` of mean 2 x_s, spread like a gamma distribution of standard deviation ``spread`` times its mean:
0.71 makes the first slide from rest follow ``1 - exp(-x / x_s)``, as a rough contact does; a small one lets go at
once, as rolling contacts and seals do. They remember every reversal. ``y`` is one bristle (Dahl 1968),
``dy = (1 - y sign(dq)) dq / x_s``, which forgets as it creeps. Contacts lie between the two (Al-Bender 2005,
10.1109/TAC.2005.858676), and m, zero or the size of c + s at the ends, says where. ``d`` damps the contact before it
slips. Once the axis slides, c and s keep their meaning. A bristle creeps under the noise of an encoder; a play as wide
as that noise keeps it still. The effect stands in place of ``coulomb`` and ``stribeck``, and rows at standstill are
then used to identify it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Coefficient, Effect, Shape, usual
from pinotwin.effects.friction import Friction
from pinotwin.effects.sight import Sight
from pinotwin.motion import AxisMotion, Motion
from pinotwin.signals import roughness
from pinotwin.system.kernels import compiled

ELEMENTS = 6
EXPONENTIAL = float(np.sqrt(0.5))
"""Spread of the distances at which slip elements add up to 1 - exp(-x / x_s): a gamma(2) distribution."""
SPREADS, OTHER_SPREADS, NEARER = (0.1, 1.2), (0.1, 0.25, 0.45, 1.1), (0.3, 0.45, 0.7, 1.0, 1.4)
"""Least and largest spread, those that are tried, and at which shares of the distance found for the usual one.

Below the least the elements slip as one, within what an encoder tells."""
DISTANCES = (2.0, 4.0, 8.0, 16.0, 40.0, 100.0)
"""Presliding distances that are tried, times that of an ordinary guide or bearing (5 um, 20 urad)."""


@functools.lru_cache(maxsize=256)
def yields(spread: float) -> Floats:
    """Return the distances at which the elements slip, over x_s, (6,): medians of parts of a gamma distribution."""
    k = min(max(spread, SPREADS[0]), SPREADS[1]) ** -2
    out = np.asarray(
        2.0 / k * scipy.special.gammaincinv(k, (np.arange(ELEMENTS) + 0.5) / ELEMENTS), dtype=float
    )
    out.flags.writeable = False
    return out


@compiled
def _slip(q: Floats, v: Floats, yields: Floats, width: tuple[float, float], past: float, out: Floats) -> None:
    """Fill ``out`` (n, 3) with z, y and y'; ``width`` is x_s and the play."""
    x_s, play = width
    bend = np.clip(past / yields, -1.0, 1.0)
    y = np.sign(past) * (1.0 - np.exp(-abs(past) / x_s))
    held = q[0]
    for k in range(len(q)):
        step = q[k] - held
        step = step - play if step > play else (step + play if step < -play else 0.0)
        held += step
        total = 0.0
        for i in range(len(yields)):
            bend[i] = min(1.0, max(-1.0, bend[i] + step / yields[i]))
            total += bend[i]
        if step != 0.0:
            side = 1.0 if step > 0.0 else -1.0
            y = side + (y - side) * np.exp(-abs(step) / x_s)
        out[k, 0], out[k, 1] = total / len(yields), y
        out[k, 2] = v[k] * (1.0 - y * np.sign(v[k])) / x_s if step != 0.0 else 0.0


def contact(
    motion: AxisMotion, x_s: float, play: float = 0.0, spread: float = EXPONENTIAL, past: float = 20.0
) -> Floats:
    """Return bend z of the elements, y of the bristle (from -1 to 1) and y' [1/s], shape (n, 3), of every stretch.

    One that starts in motion starts bent by ``past`` samples of it; one at rest unbent: the log does not hold its past.
    """
    out = np.zeros((len(motion.q), 3))
    for s in motion.segments:
        before = past * motion.step * float(motion.v[s.start])
        q, v = (np.ascontiguousarray(x[s]) for x in (motion.q, motion.v))
        _slip(q, v, x_s * yields(spread), (x_s, play), before, out[s])
    return out


@dataclass(frozen=True)
class Presliding(Friction, AxisEffect):
    """Friction with presliding: tau = z [c + s exp(-|v / v_s|^k)] + m (y - z) + d y'."""

    name = "presliding"
    words = "the contact gives a little, like a spring, before it slides: seen at reversals"
    remedy = "record slow reversals of growing stroke, from a micrometre or millidegree upwards"
    colour = "#c7568f"
    contains = ("coulomb", "stribeck")
    imitates = ("hysteresis", "backlash", "stribeck", "coulomb", "encoder_error")
    searched = 1
    sharp = True
    depends = "displacement"
    uses_standstill = True
    x_s: float = usual(1e-5, 5e-5)  # displacement over which friction turns round [m or rad]; searched
    v_s: float = 0.01  # speed at which the Stribeck part has fallen to 1/e [m/s or rad/s]; searched
    stribeck: int = 1  # number of Stribeck terms, 1 or 0
    exponent: float = 1.0  # of the Stribeck term, as in :class:`Stribeck`
    bristle: int = 1  # 1 for the terms m and d, 0 for slip elements alone
    play: float | None = None  # of bristle and elements [m or rad]; the encoder's noise where absent
    spread: float = EXPONENTIAL  # of distances at which elements slip over their mean; searched where it pays
    free_spread: bool = field(default=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "stribeck", int(self.stribeck))
        object.__setattr__(self, "bristle", int(self.bristle))

    def includes(self, name: str) -> bool:
        """Whether the effect includes another; its Stribeck term may be left out."""
        return super().includes(name) and (self.stribeck > 0 or name != "stribeck")

    def fitted_to(self, motion: Motion) -> Self:
        """Return the effect with the encoder's noise in this log as play."""
        if self.play is not None:
            return self
        own = motion.axis(self.axis)
        return replace(self, play=roughness(own.q[s] for s in own.segments))

    def coefficients(self) -> tuple[Coefficient, ...]:
        names = "c" + "s" * bool(self.stribeck) + "m" * bool(self.bristle)
        found = tuple(Coefficient(name, self.unit("F"), lower=0.0) for name in names)
        return (*found, Coefficient("d", self.unit("F·s"), lower=0.0)) if self.bristle else found

    def memory(self, theta: Floats) -> tuple[float, float]:
        """Return m [N or N·m] and d of coefficients in the order of :meth:`coefficients`, for a simulation."""
        return (float(theta[-2]), float(theta[-1])) if self.bristle else (0.0, 0.0)

    def shapes(self) -> tuple[Shape, ...]:
        bend = Shape("x_s", self.unit("x"), *((1e-6, 1e-2) if self.rotary else (1e-7, 1e-3)))
        fade = Shape("v_s", self.unit("x/s"), *((1e-3, 3.0) if self.rotary else (5e-4, 0.3)))
        found = (bend, fade) if self.stribeck else (bend,)
        return (*found, Shape("spread", "-", *SPREADS)) if self.free_spread else found

    def wider(self) -> tuple[Self, ...]:
        """Return other spreads, at distances near the one found."""
        if not self.bristle or self.free_spread:
            return ()
        near = [(k * self.x_s, spread) for spread in OTHER_SPREADS for k in NEARER]
        return tuple(replace(self, x_s=x_s, spread=spread, free_spread=True) for x_s, spread in near)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return few values, one of the spread: the curves are smooth in all shapes."""
        return tuple(
            np.array([self.spread]) if s.name == "spread" else np.geomspace(s.lower, s.upper, 9)
            for s in self.shapes()
        )

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return slip elements alone, over distances that encoder and rate resolve: after a reversal x = a t² / 2."""
        if not sight.both_ways or sight.reversals < 2:
            return ()
        usual = 2e-5 if self.rotary else 5e-6
        rises, slow = np.abs(np.diff(sight.speed)) / sight.step, sight.speed[:-1] < 0.1 * sight.top
        rise = float(np.median(rises[slow] if slow.any() else rises))  # acceleration as it turns round
        least = max(4.0 * sight.noise, 0.5 * rise * (2.0 * sight.step) ** 2)
        found = [usual * k for k in DISTANCES if least <= usual * k <= 0.05 * sight.travel]
        return tuple(replace(self, x_s=float(x), stribeck=0, bristle=0) for x in found)

    def settled(self) -> Self:
        """Return the effect with the terms that a search leaves out, at the distance it found."""
        return replace(self, stribeck=1, bristle=1, play=None)

    def other_forms(self) -> tuple[Self, ...]:
        """Return the other usual exponent of its Stribeck term."""
        return (replace(self, exponent=1.0 if self.exponent > 1.5 else 2.0),) if self.stribeck else ()

    def axis_columns(self, motion: AxisMotion) -> Floats:
        z, y, rate = contact(motion, self.x_s, self.play or 0.0, self.spread).T
        columns = [z]
        if self.stribeck:
            columns.append(z * np.exp(-(np.abs(motion.v / self.v_s) ** self.exponent)))
        if self.bristle:
            columns += [y - z, rate]
        return np.stack(columns, axis=-1)
