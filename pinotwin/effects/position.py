"""Efforts that depend on position alone: ripple of direct drives, cables, guideways (thesis Eq. 3.10, 3.11).

A sinusoid of unknown phase is written ``a cos + b sin``, so that only its pitch needs a search.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient, Depends, Effect, Shape
from pinotwin.effects.family import POSITION, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.symbols import effort, length
from pinotwin.effects.tree import Tree
from pinotwin.errors import MachineError
from pinotwin.motion import AxisMotion, Motion

_TURN = 2.0 * np.pi
ANGLES = np.linspace(-0.5, 0.5, 7)[:-1] * np.pi
"""Angles of a modulation that are tried [rad]."""
TURNS = 200
"""Most ripples a turn that are tried on an axis without stops."""
PITCHES = 900
"""Most pitches that are tried on one travel."""
REPEATS = 2.5
"""Times that a ripple must repeat on the travel: a single wave is any smooth course, and a table of it."""
REPEATS_MODULATED = 4.0
"""The same of a ripple whose size changes, along the travel or with speed: what says how fits any three waves."""
KNOTS = (6, 10, 16, 24)
"""Knots of the tables that are tried on a travel: a short log passes each of many too seldom to tell its height."""


@dataclass(frozen=True)
class Offset(AxisEffect):
    """A constant effort: current offset, or the pull of a counterbalance: tau = f0."""

    name: ClassVar[str] = "offset"
    family: ClassVar[Family] = POSITION
    title: ClassVar[str] = "Constant effort"
    words: ClassVar[str] = "a constant force: weight, counterbalance, current offset"
    remedy: ClassVar[str] = "check counterbalance and brake, and the drive's current offset"
    colour: ClassVar[str] = "#a05195"
    inseparable: ClassVar[tuple[str, ...]] = ("coulomb_asymmetric",)
    imitates: ClassVar[tuple[str, ...]] = ("viscous_asymmetric", "rigid_body", "position_table")
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("f0", effort(self.rotary)),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return np.ones((len(motion.q), 1))


def _waves(q: Floats, period: float, harmonics: tuple[int, ...]) -> Floats:
    """Return cos and sin of every harmonic, shape (n, 2 h).

    Both from one tangent of half the phase, to the last digits: a search of pitches asks for millions.
    """
    out = np.empty((len(q), 2 * len(harmonics)))
    for k, harmonic in enumerate(harmonics):
        t = np.tan(q * (0.5 * _TURN * harmonic / period))
        square = t * t
        share = 1.0 / (1.0 + square)
        out[:, 2 * k] = (1.0 - square) * share
        out[:, 2 * k + 1] = 2.0 * t * share
    return out


def _pitch_grid(q: Floats, lower: float, upper: float) -> Floats:
    """Return pitches between the bounds, uniform in spatial frequency, none missed.

    A sinusoid seen over a travel L is told from its neighbour when their frequencies differ by 1/L;
    a quarter of that leaves every basin of the search with a start of its own.
    """
    travel = float(np.ptp(q))
    if travel <= 0.0:
        return np.array([np.sqrt(lower * upper)])
    count = int(np.clip(np.ceil(4.0 * travel * (1.0 / lower - 1.0 / upper)), 8, 4000))
    return 1.0 / np.linspace(1.0 / upper, 1.0 / lower, count)


def _repeating(q: Floats, lower: float, upper: float) -> float:
    """Return the longest pitch that a log shows to repeat, if it can show any.

    A single wave along the travel takes up whatever a model lacks there: a weight, a constant force.
    """
    longest = float(np.ptp(q)) / REPEATS
    return min(upper, longest) if lower < longest else upper


def _pitch_bounds(rotary: bool, shortest: float | None, longest: float | None) -> tuple[float, ...]:
    usual = (_TURN / 200.0, _TURN / 1.5) if rotary else (2e-3, 0.15)
    return (shortest or usual[0], longest or usual[1])


@dataclass(frozen=True)
class Ripple(AxisEffect):
    """Force ripple, sinusoidal in position: tau = sum_h a_h cos(2 pi h q / period) + b_h sin(...).

    Attributes:
        period: pitch of the fundamental [m or rad]; searched when it is not given.
        harmonics: multiples of the fundamental.
        shortest: lower bound of the search [m or rad].
        longest: upper bound of the search [m or rad].
    """

    name: ClassVar[str] = "ripple"
    family: ClassVar[Family] = POSITION
    title: ClassVar[str] = "Ripple"
    words: ClassVar[str] = "a force that repeats with every pole pitch, screw turn or ball passage"
    remedy: ClassVar[str] = "compare the pitch with pole pitch, screw lead, ball passage and gear teeth"
    colour: ClassVar[str] = "#b07aa1"
    imitates: ClassVar[tuple[str, ...]] = ("position_table", "encoder_error", "geometric_error")
    searched: ClassVar[int] = 1
    several: ClassVar[bool] = True
    sharp: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = False
    period: float | None = None
    harmonics: tuple[int, ...] = (1,)
    shortest: float | None = None
    longest: float | None = None
    free_pitch: bool = dataclasses.field(default=False, metadata={"internal": True})
    endless: bool = dataclasses.field(default=False, compare=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        object.__setattr__(self, "harmonics", tuple(int(h) for h in self.harmonics))
        if self.period is None:
            low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
            object.__setattr__(self, "period", float(np.sqrt(low * high)))
            object.__setattr__(self, "free_pitch", True)
        if self.period is not None and self.period <= 0.0:
            raise MachineError(f"axes.{self.axis}: ripple period must be positive, not {self.period}")

    def bound(self, tree: Tree) -> Self:
        return dataclasses.replace(self, endless=tree.endless(self.axis))

    def coefficients(self) -> tuple[Coefficient, ...]:
        unit = effort(self.rotary)
        return tuple(Coefficient(f"{w}{h}", unit) for h in self.harmonics for w in "ab")

    def shapes(self) -> tuple[Shape, ...]:
        if not self.free_pitch:
            return ()
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        return (Shape("period", length(self.rotary), low, high),)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        if not self.free_pitch:
            return ()
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        q = motion.axis(self.axis).q
        return (_pitch_grid(q, low, high if self.longest else _repeating(q, low, high)),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: pitches that travel, rate and resolution can show.

        On an axis without stops that makes whole turns a ripple repeats with the turn.
        """
        del motion
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        low = max(low, 3.0 * sight.pace, 10.0 * sight.noise)
        if self.endless and sight.travel > _TURN:
            return self.over([x for x in _TURN / np.arange(1, TURNS + 1) if x >= low])
        high = sight.travel / REPEATS
        if high <= low:
            return ()
        count = int(np.clip(4.0 * sight.travel * (1.0 / low - 1.0 / high), 8, PITCHES))
        return self.over(1.0 / np.linspace(1.0 / high, 1.0 / low, count))

    def settled(self) -> Self:
        """See :meth:`Effect.settled`: the pitch is written and searched no more."""
        return dataclasses.replace(self, free_pitch=False)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        assert self.period is not None
        return _waves(motion.q, self.period, self.harmonics)


@dataclass(frozen=True)
class RippleModulated(AxisEffect):
    """Torque ripple whose size varies over the turn by imperfect assembly (thesis Eq. 3.10).

        tau = a cos x + b sin x + |sin(q + eps)| (a_mod cos x + b_mod sin x),      x = 2 pi q / period

    which contains Eq. 3.10, [R + R_a |sin(q + eps)|] sin(x + phi): the modulated part has a phase of
    its own.

    Attributes:
        period: pitch of the ripple [rad]; searched when it is not given.
        eps: angle of the modulation [rad]; searched.
        shortest: lower bound of the pitch [rad].
        longest: upper bound of the pitch [rad].
    """

    name: ClassVar[str] = "ripple_modulated"
    family: ClassVar[Family] = POSITION
    title: ClassVar[str] = "Modulated ripple"
    words: ClassVar[str] = "a repeating force whose size changes with the place along the turn"
    remedy: ClassVar[str] = "check the concentricity of rotor and stator, or of the gear wheel that runs out"
    colour: ClassVar[str] = "#8e5fa8"
    contains: ClassVar[tuple[str, ...]] = ("ripple",)
    imitates: ClassVar[tuple[str, ...]] = ("position_table", "encoder_error")
    searched: ClassVar[int] = 2
    several: ClassVar[bool] = True
    sharp: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = True
    period: float | None = None
    eps: float = 0.0
    shortest: float | None = None
    longest: float | None = None
    free_pitch: bool = dataclasses.field(default=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        if self.period is None:
            low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
            object.__setattr__(self, "period", float(np.sqrt(low * high)))
            object.__setattr__(self, "free_pitch", True)

    def coefficients(self) -> tuple[Coefficient, ...]:
        unit = effort(self.rotary)
        return tuple(Coefficient(name, unit) for name in ("a", "b", "a_mod", "b_mod"))

    def shapes(self) -> tuple[Shape, ...]:
        eps = Shape("eps", "rad", -0.5 * np.pi, 0.5 * np.pi, log=False)
        if not self.free_pitch:
            return (eps,)
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        return (Shape("period", length(self.rotary), low, high), eps)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        eps = np.linspace(-0.5, 0.5, 13)[:-1] * np.pi
        if not self.free_pitch:
            return (eps,)
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        q = motion.axis(self.axis).q
        return (_pitch_grid(q, low, high if self.longest else _repeating(q, low, high)), eps)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: whole parts of a turn."""
        if not self.rotary or sight.travel < 0.25 * _TURN:
            return ()
        low = max(_pitch_bounds(True, self.shortest, self.longest)[0], 3.0 * sight.pace, 10.0 * sight.noise)
        del motion
        longest = sight.travel / REPEATS_MODULATED
        return self.over([x for x in _TURN / np.arange(1, 101) if low <= x <= longest], ANGLES)

    def settled(self) -> Self:
        """See :meth:`Effect.settled`: the pitch is written and searched no more."""
        return dataclasses.replace(self, free_pitch=False)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        assert self.period is not None
        waves = _waves(motion.q, self.period, (1,))
        size = np.abs(_waves(motion.q + self.eps, _TURN, (1,))[:, 1:])
        return np.concatenate([waves, size * waves], axis=-1)


@dataclass(frozen=True)
class PositionTable(AxisEffect):
    """Any repeatable effort of position, as a table with linear interpolation (thesis Eq. 3.11).

        tau = sum_k m_k max(0, 1 - |p_k - q| / spacing)

    The knots cover the travel that the effect was fitted to; beyond it the last value holds. On an axis
    without stops the effort repeats with every turn, and so do the knots once the log makes a whole one.

    Attributes:
        spacing: distance of the knots [m or rad]; 1 mm or 1 degree when not given.
        start: position of the first knot; taken from the log when not given.
        stop: position of the last knot.
    """

    name: ClassVar[str] = "position_table"
    family: ClassVar[Family] = POSITION
    title: ClassVar[str] = "Effort along the travel"
    words: ClassVar[str] = "a force that depends on the place along the travel: guideway, cable, cover"
    remedy: ClassVar[str] = "look at guideway, cable carrier and cover where the curve peaks"
    colour: ClassVar[str] = "#9c755f"
    contains: ClassVar[tuple[str, ...]] = ("offset",)
    imitates: ClassVar[tuple[str, ...]] = ("ripple", "ripple_modulated", "spring", "geometric_error")
    searched: ClassVar[int] = 1  # how many knots
    held: ClassVar[bool] = True
    local: ClassVar[bool] = True
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = False
    spacing: float | None = None
    start: float | None = None
    stop: float | None = None
    endless: bool = dataclasses.field(default=False, compare=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        if self.spacing is None:
            object.__setattr__(self, "spacing", float(np.deg2rad(1.0)) if self.rotary else 1e-3)
        if self.spacing is not None and self.spacing <= 0.0:
            raise MachineError(
                f"axes.{self.axis}: position_table spacing must be positive, not {self.spacing}"
            )

    def bound(self, tree: Tree) -> Self:
        return dataclasses.replace(self, endless=tree.endless(self.axis))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: tables over the travel, coarse ones and a fine one."""
        del motion
        travel = min(sight.travel, _TURN)
        return tuple(dataclasses.replace(self, spacing=travel / (count - 1)) for count in KNOTS)

    def fitted_to(self, motion: Motion) -> Self:
        """See :meth:`Effect.fitted_to`: lay the knots over the travel of this motion."""
        if self.start is not None and self.stop is not None:
            return self
        assert self.spacing is not None
        q = motion.axis(self.axis).q
        if self.endless and np.ptp(q) > _TURN - self.spacing:
            spacing = _TURN / max(round(_TURN / self.spacing), 3)
            return dataclasses.replace(self, spacing=spacing, start=0.0, stop=_TURN - spacing)
        start = float(np.floor(q.min() / self.spacing)) * self.spacing
        count = max(int(np.ceil((float(q.max()) - start) / self.spacing)), 1)
        if count > 5000:
            raise MachineError(
                f"axes.{self.axis}: position_table of {count} knots; make `spacing` larger than "
                f"{self.spacing:g} (travel {np.ptp(q):g})"
            )
        return dataclasses.replace(self, start=start, stop=start + count * self.spacing)

    def known(self, motion: Motion) -> Mask:
        """See :meth:`Effect.known`: between its first and its last knot, by one spacing."""
        if self.endless or self.start is None or self.stop is None:
            return super().known(motion)
        assert self.spacing is not None
        q = motion.axis(self.axis).q
        return np.asarray((q >= self.start - self.spacing) & (q <= self.stop + self.spacing))

    @property
    def knots(self) -> Floats:
        """Positions p_k of the knots [m or rad], shape (p,)."""
        assert self.spacing is not None
        if self.start is None or self.stop is None:
            return np.zeros(0)
        count = round((self.stop - self.start) / self.spacing) + 1
        return np.linspace(self.start, self.stop, count)

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"m{k}", effort(self.rotary)) for k in range(len(self.knots)))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        knots, q = self.knots, motion.q
        assert self.spacing is not None
        if self.endless:
            if len(knots) * self.spacing > _TURN - 1e-6 * self.spacing:
                return self._round(q, len(knots))
            centre = 0.5 * (knots[0] + knots[-1])
            q = q - _TURN * np.round((q - centre) / _TURN)
        place = np.clip((q - knots[0]) / self.spacing, 0.0, len(knots) - 1)
        below = np.minimum(place.astype(int), len(knots) - 2)
        share = place - below
        out = np.zeros((len(motion.q), len(knots)))
        rows = np.arange(len(motion.q))
        out[rows, below] = 1.0 - share
        out[rows, below + 1] += share
        return out

    def _round(self, q: Floats, count: int) -> Floats:
        """Return the weights of knots that close a circle, shape (n, count)."""
        assert self.start is not None
        assert self.spacing is not None
        place = np.mod(q - self.start, _TURN) / self.spacing
        below = np.minimum(place.astype(int), count - 1)
        out = np.zeros((len(q), count))
        rows = np.arange(len(q))
        out[rows, below] = 1.0 - (place - below)
        out[rows, (below + 1) % count] += place - below
        return out
