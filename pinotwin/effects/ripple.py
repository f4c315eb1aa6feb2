"""Efforts that repeat along the travel or the turn: ripple of direct drives, screws and gears (thesis Eq. 3.10).

A sinusoid of unknown phase is written ``a cos + b sin``, so that only its pitch needs a search.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Coefficient, Effect, Shape
from pinotwin.effects.family import POSITION
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import TURN, Tree
from pinotwin.errors import MachineError
from pinotwin.motion import AxisMotion, Motion

ANGLES = np.linspace(-0.5, 0.5, 7)[:-1] * np.pi
"""Angles of a modulation that are tried [rad]."""


def waves(q: Floats, period: float, harmonics: tuple[int, ...]) -> Floats:
    """Return cos and sin of every harmonic, shape (n, 2 h), by one tangent of half the phase: searches ask for many."""
    out = np.empty((len(q), 2 * len(harmonics)))
    for k, harmonic in enumerate(harmonics):
        t = np.tan(q * (0.5 * TURN * harmonic / period))
        square = t * t
        share = 1.0 / (1.0 + square)
        out[:, 2 * k] = (1.0 - square) * share
        out[:, 2 * k + 1] = 2.0 * t * share
    return out


def _even(lower: float, upper: float, count: int) -> Floats:
    """Return pitches between bounds, even in spatial frequency: steps of 1/(4 L) on a travel L reach every minimum."""
    return 1.0 / np.linspace(1.0 / upper, 1.0 / lower, count)


@dataclass(frozen=True)
class Pitched(AxisEffect):
    """An effort that repeats with a pitch."""

    repeats: ClassVar[float]
    """Times that it must repeat on the travel."""

    family = POSITION
    several = True
    sharp = True
    causes = ("position",)
    depends = "position"
    # pitch of the fundamental [m or rad]; searched when it is not given
    period: float = field(default=None)  # type: ignore[assignment]
    shortest: float | None = field(default=None, kw_only=True)  # lower bound of the search [m or rad]
    longest: float | None = field(default=None, kw_only=True)  # upper bound of the search [m or rad]
    free_pitch: bool = field(default=False, kw_only=True, metadata={"internal": True})

    def __post_init__(self) -> None:
        if self.period is None:
            object.__setattr__(self, "period", float(np.sqrt(np.prod(self._bounds()))))
            object.__setattr__(self, "free_pitch", True)
        if self.period <= 0.0:
            raise MachineError(f"axes.{self.axis}: ripple period must be positive, not {self.period}")

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("period", self.unit("x"), *self._bounds()),) if self.free_pitch else ()

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return pitches [m or rad] up to the longest that repeats: a single wave takes up whatever a model lacks."""
        if not self.free_pitch:
            return ()
        low, high = self._bounds()
        travel = float(np.ptp(motion.axis(self.axis).q))
        if not self.longest and low < travel / Ripple.repeats:
            high = min(high, travel / Ripple.repeats)
        if travel <= 0.0:
            return (np.array([np.sqrt(low * high)]),)
        return (_even(low, high, int(np.clip(np.ceil(4.0 * travel * (1.0 / low - 1.0 / high)), 8, 4000))),)

    def settled(self) -> Self:
        """Return the effect with its pitch written, and searched no more."""
        return replace(self, free_pitch=False)

    def _bounds(self) -> tuple[float, float]:
        usual = (TURN / 200.0, TURN / 1.5) if self.rotary else (2e-3, 0.15)
        return self.shortest or usual[0], self.longest or usual[1]

    def _least(self, sight: Sight) -> float:
        """Return the shortest pitch that rate and resolution can show."""
        return max(self._bounds()[0], 3.0 * sight.pace, 10.0 * sight.noise)


@dataclass(frozen=True)
class Ripple(Pitched):
    """Force ripple, sinusoidal in position: tau = sum_h a_h cos(2 pi h q / period) + b_h sin(...)."""

    name = "ripple"
    words = "a force that repeats with every pole pitch, screw turn or ball passage"
    remedy = "compare the pitch with pole pitch, screw lead, ball passage and gear teeth"
    colour = "#b07aa1"
    imitates = ("position_table", "encoder_error", "geometric_error")
    searched = 1
    repeats = 2.5  # a single wave is any smooth course, and a table of it
    harmonics: tuple[int, ...] = (1,)  # multiples of the fundamental
    endless: bool = field(default=False, compare=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "harmonics", tuple(int(h) for h in self.harmonics))

    def bound(self, tree: Tree) -> Self:
        return replace(self, endless=tree.endless(self.axis))

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"{w}{h}", self.unit("F")) for h in self.harmonics for w in "ab")

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return pitches that travel, rate and resolution can show: parts of a turn on an axis without stops."""
        low, high = self._least(sight), sight.travel / self.repeats
        if self.endless and sight.travel > TURN:
            return self.over([x for x in TURN / np.arange(1, 201) if x >= low])
        if high <= low:
            return ()
        return self.over(
            _even(low, high, int(np.clip(4.0 * sight.travel * (1.0 / low - 1.0 / high), 8, 900)))
        )

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return waves(motion.q, self.period, self.harmonics)


@dataclass(frozen=True)
class RippleModulated(Pitched):
    """Torque ripple whose size varies over the turn by imperfect assembly (thesis Eq. 3.10).

        tau = a cos x + b sin x + |sin(q + eps)| (a_mod cos x + b_mod sin x),      x = 2 pi q / period

    which contains Eq. 3.10, [R + R_a |sin(q + eps)|] sin(x + phi): the modulated part has a phase of
    its own.
    """

    name = "ripple_modulated"
    title = "Modulated ripple"
    words = "a repeating force whose size changes with the place along the turn"
    remedy = "check the concentricity of rotor and stator, or of the gear wheel that runs out"
    colour = "#8e5fa8"
    linear = tuple(Coefficient(name, "F") for name in ("a", "b", "a_mod", "b_mod"))
    contains = ("ripple",)
    imitates = ("position_table", "encoder_error")
    searched = 2
    repeats = 4.0  # what says how its size changes fits any three waves
    rotary: bool = True
    eps: float = 0.0  # angle of the modulation [rad]; searched

    def shapes(self) -> tuple[Shape, ...]:
        return (*super().shapes(), Shape("eps", "rad", -0.5 * np.pi, 0.5 * np.pi, log=False))

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        return (*super().grid(motion), np.linspace(-0.5, 0.5, 13)[:-1] * np.pi)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return whole parts of a turn that the travel and the rows can show."""
        if not self.rotary or sight.travel < 0.25 * TURN:
            return ()
        low, longest = self._least(sight), sight.travel / self.repeats
        return self.over([x for x in TURN / np.arange(1, 101) if low <= x <= longest], ANGLES)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        plain = waves(motion.q, self.period, (1,))
        size = np.abs(waves(motion.q + self.eps, TURN, (1,))[:, 1:])
        return np.concatenate([plain, size * plain], axis=-1)
