"""Efforts that depend on position alone: ripple of direct drives, cables, guideways (thesis Eq. 3.10, 3.11).

A sinusoid of unknown phase is written ``a cos + b sin``, so that only its pitch needs a search.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient, Depends, Shape
from pinotwin.effects.symbols import effort, length
from pinotwin.errors import MachineError
from pinotwin.motion import AxisMotion, Motion

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Offset(AxisEffect):
    """A constant effort: current offset, or the pull of a counterbalance: tau = f0."""

    name: ClassVar[str] = "offset"
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        return (Coefficient("f0", effort(self.rotary)),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        return np.ones((len(motion.q), 1))


def _waves(q: Floats, period: float, harmonics: tuple[int, ...]) -> Floats:
    """Return cos and sin of every harmonic, shape (n, 2 h)."""
    phase = np.outer(q, np.asarray(harmonics)) * (_TURN / period)
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1).reshape(len(q), -1)


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
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = False
    period: float | None = None
    harmonics: tuple[int, ...] = (1,)
    shortest: float | None = None
    longest: float | None = None
    searched: bool = dataclasses.field(default=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        object.__setattr__(self, "harmonics", tuple(int(h) for h in self.harmonics))
        if self.period is None:
            low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
            object.__setattr__(self, "period", float(np.sqrt(low * high)))
            object.__setattr__(self, "searched", True)
        if self.period is not None and self.period <= 0.0:
            raise MachineError(f"axes.{self.axis}: ripple period must be positive, not {self.period}")

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        unit = effort(self.rotary)
        return tuple(Coefficient(f"{w}{h}", unit) for h in self.harmonics for w in "ab")

    def shapes(self) -> tuple[Shape, ...]:
        """See :meth:`Effect.shapes`."""
        if not self.searched:
            return ()
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        return (Shape("period", length(self.rotary), low, high),)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """See :meth:`Effect.grid`."""
        if not self.searched:
            return ()
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        return (_pitch_grid(motion.axis(self.axis).q, low, high),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        assert self.period is not None
        return _waves(motion.q, self.period, self.harmonics)


@dataclass(frozen=True)
class RippleModulated(AxisEffect):
    """Torque ripple whose size varies over the turn by imperfect assembly (thesis Eq. 3.10).

        tau = [R + R_a |sin(q + eps)|] sin(2 pi q / period + phi)

    written with cos and sin for each of the two terms, which contains Eq. 3.10 (it lets the
    modulated part have a phase of its own).

    Attributes:
        period: pitch of the ripple [rad]; searched when it is not given.
        eps: angle of the modulation [rad]; searched.
        shortest: lower bound of the pitch [rad].
        longest: upper bound of the pitch [rad].
    """

    name: ClassVar[str] = "ripple_modulated"
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = True
    period: float | None = None
    eps: float = 0.0
    shortest: float | None = None
    longest: float | None = None
    searched: bool = dataclasses.field(default=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        if self.period is None:
            low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
            object.__setattr__(self, "period", float(np.sqrt(low * high)))
            object.__setattr__(self, "searched", True)

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        unit = effort(self.rotary)
        return tuple(Coefficient(name, unit) for name in ("a", "b", "a_mod", "b_mod"))

    def shapes(self) -> tuple[Shape, ...]:
        """See :meth:`Effect.shapes`."""
        eps = Shape("eps", "rad", -0.5 * np.pi, 0.5 * np.pi, log=False)
        if not self.searched:
            return (eps,)
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        return (Shape("period", length(self.rotary), low, high), eps)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """See :meth:`Effect.grid`."""
        eps = np.linspace(-0.5, 0.5, 13)[:-1] * np.pi
        if not self.searched:
            return (eps,)
        low, high = _pitch_bounds(self.rotary, self.shortest, self.longest)
        return (_pitch_grid(motion.axis(self.axis).q, low, high), eps)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        assert self.period is not None
        waves = _waves(motion.q, self.period, (1,))
        size = np.abs(np.sin(motion.q + self.eps))[:, None]
        return np.concatenate([waves, size * waves], axis=-1)


@dataclass(frozen=True)
class PositionTable(AxisEffect):
    """Any repeatable effort of position, as a table with linear interpolation (thesis Eq. 3.11).

        tau = sum_k m_k max(0, 1 - |p_k - q| / spacing)

    The knots cover the travel that the effect was fitted to; beyond it the last value holds.

    Attributes:
        spacing: distance of the knots [m or rad]; 1 mm or 1 degree when not given.
        start: position of the first knot; taken from the log when not given.
        stop: position of the last knot.
    """

    name: ClassVar[str] = "position_table"
    causes: ClassVar[tuple[Cause, ...]] = ("position",)
    depends: ClassVar[Depends] = "position"
    axis: str
    rotary: bool = False
    spacing: float | None = None
    start: float | None = None
    stop: float | None = None

    def __post_init__(self) -> None:
        if self.spacing is None:
            object.__setattr__(self, "spacing", float(np.deg2rad(1.0)) if self.rotary else 1e-3)
        if self.spacing is not None and self.spacing <= 0.0:
            raise MachineError(
                f"axes.{self.axis}: position_table spacing must be positive, not {self.spacing}"
            )

    def fitted_to(self, motion: Motion) -> Self:
        """See :meth:`Effect.fitted_to`: lay the knots over the travel of this motion."""
        if self.start is not None and self.stop is not None:
            return self
        assert self.spacing is not None
        q = motion.axis(self.axis).q
        start = float(np.floor(q.min() / self.spacing)) * self.spacing
        count = max(int(np.ceil((float(q.max()) - start) / self.spacing)), 1)
        if count > 5000:
            raise MachineError(
                f"axes.{self.axis}: position_table of {count} knots; make `spacing` larger than "
                f"{self.spacing:g} (travel {np.ptp(q):g})"
            )
        return dataclasses.replace(self, start=start, stop=start + count * self.spacing)

    @property
    def knots(self) -> Floats:
        """Positions p_k of the knots [m or rad], shape (p,)."""
        assert self.spacing is not None
        if self.start is None or self.stop is None:
            return np.zeros(0)
        count = round((self.stop - self.start) / self.spacing) + 1
        return np.linspace(self.start, self.stop, count)

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        return tuple(Coefficient(f"m{k}", effort(self.rotary)) for k in range(len(self.knots)))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`."""
        knots = self.knots
        assert self.spacing is not None
        place = np.clip((motion.q - knots[0]) / self.spacing, 0.0, len(knots) - 1)
        below = np.minimum(place.astype(int), len(knots) - 2)
        share = place - below
        out = np.zeros((len(motion.q), len(knots)))
        rows = np.arange(len(motion.q))
        out[rows, below] = 1.0 - share
        out[rows, below + 1] += share
        return out
