"""Errors of sensors: late or wrongly scaled effort, periodic error of an encoder.

They change what is logged, not what the machine does. The effort in their columns is the model's, never
the measured one: measured effort holds the very thing that is to be explained.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Coefficient, Columns, Effect, Need, Shape, channel
from pinotwin.effects.family import SENSING, Family
from pinotwin.effects.shaken import inertia, shaken
from pinotwin.effects.sight import Sight
from pinotwin.effects.symbols import length
from pinotwin.motion import Motion

SPANS = (3e-4, 1e-3, 3e-3, 1e-2, 2e-2, 4e-2, -3e-4, -1e-3, -3e-3, -1e-2, -2e-2)
"""Delays (leads where negative) that are tried [s]."""
FIRST_ORDER = 1.5e-3
"""Span up to which a delay is its first order: the change of the effort times the delay [s]."""
WHOLE = 0.75
"""Share of a longer span that a delay must come to: play, which looks like one, reaches less."""
TURNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 36)
"""Errors a turn that are tried."""
WAVES = np.geomspace(2.0, 40.0, 31)
"""Errors a travel that are tried on a linear axis."""
_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Delay(Effect):
    """Effort that is logged late against position: tau = seconds [m(t - span) - m(t)] / span, m the model's.

    Exact where ``span`` is the delay itself; with a span of zero tau = -seconds dm/dt, its first order.
    A lead is a negative delay. Beside it, ``lead`` under ``data`` in machine.yaml moves the channel.

    Attributes:
        span: time over which the change of effort is taken [s]; searched.
    """

    name: ClassVar[str] = "delay"
    family: ClassVar[Family] = SENSING
    title: ClassVar[str] = "Delay"
    words: ClassVar[str] = "one signal was recorded late against the others"
    remedy: ClassVar[str] = "compare the clocks of the channels; state the lead of the effort in machine.yaml"
    colour: ClassVar[str] = "#7f7f7f"
    imitates: ClassVar[tuple[str, ...]] = (
        "viscous",
        "drive_flexibility",
        "joint_flexibility",
        "encoder_error",
    )
    needs: ClassVar[tuple[Need, ...]] = ("model",)
    searched: ClassVar[int] = 1
    logged_effort: ClassVar[bool] = True
    axis: str
    rotary: bool = False
    span: float = 1e-3

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("seconds", "s"),)

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("span", "s", -0.06, 0.06, log=False),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: delays of a tenth of a sample at least."""
        del motion
        return self.over([x for x in SPANS if abs(x) > 0.1 * sight.step] or [sight.step, -sight.step])

    def possible(self, theta: Floats) -> bool:
        """See :meth:`Effect.possible`: over a span that rows resolve, all of the effort comes late, not a part.

        A part of it late by a longer span is what play and flexible drives look like.
        """
        if abs(self.span) <= FIRST_ORDER:
            return True
        return bool(WHOLE < float(theta[0]) / self.span < 1.0 / WHOLE)

    def columns(self, motion: Motion) -> Columns:
        joint = motion.index(self.axis)
        effort = channel(self, motion, "model")[:, joint]
        out = np.zeros(len(effort))
        span = self.span
        for part in motion.segments:
            x, t = effort[part], motion.t[part]
            if part.stop - part.start < 2:
                continue
            if abs(span) < 1e-3 * motion.step:
                out[part] = -np.gradient(x, motion.step)
            else:
                out[part] = (np.interp(t - span, t, x) - x) / span
        return Columns((joint,), out[:, None, None])


@dataclass(frozen=True)
class EffortScale(Effect):
    """Effort that is logged too large or too small: tau = share m, m the effort of the model.

    On one axis alone masses and frictions take its place; it shows by what the axis shares with others,
    or as a change of a twin.
    """

    name: ClassVar[str] = "effort_scale"
    family: ClassVar[Family] = SENSING
    title: ClassVar[str] = "Scale of the effort"
    words: ClassVar[str] = "the effort is off by a factor: torque constant, gear ratio, unit"
    remedy: ClassVar[str] = (
        "hang a known weight on the axis: it is the ruler for the effort; check the torque constant"
    )
    colour: ClassVar[str] = "#5f7f3f"
    imitates: ClassVar[tuple[str, ...]] = ("rigid_body", "payload", "load_friction")
    needs: ClassVar[tuple[Need, ...]] = ("model",)
    logged_effort: ClassVar[bool] = True
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("share", "-", lower=-1.0),)

    def columns(self, motion: Motion) -> Columns:
        joint = motion.index(self.axis)
        return Columns((joint,), channel(self, motion, "model")[:, joint, None, None])


@dataclass(frozen=True)
class EncoderError(Effect):
    """Periodic error of the position: q_logged = q + a cos x + b sin x, x = 2 pi q / period.

    The controller follows the error, so the axis accelerates otherwise than the log says:
    tau = -M d²/dt² (a cos x + b sin x), here and through the inertia matrix on the other axes.

    Attributes:
        period: of the error [m or rad]; a turn or 10 mm when not given; searched.
    """

    name: ClassVar[str] = "encoder_error"
    family: ClassVar[Family] = SENSING
    title: ClassVar[str] = "Encoder error"
    words: ClassVar[str] = "the position sensor repeats a small error with its own period"
    remedy: ClassVar[str] = (
        "check how the encoder is mounted: eccentric disc, tilted head; adjust its signals"
    )
    colour: ClassVar[str] = "#17869e"
    imitates: ClassVar[tuple[str, ...]] = ("ripple", "ripple_modulated", "geometric_error", "delay")
    needs: ClassVar[tuple[Need, ...]] = ("mass",)
    sharp: ClassVar[bool] = True
    searched: ClassVar[int] = 1
    several: ClassVar[bool] = True
    axis: str
    rotary: bool = False
    period: float | None = None

    def __post_init__(self) -> None:
        if self.period is None:
            object.__setattr__(self, "period", _TURN if self.rotary else 1e-2)

    def coefficients(self) -> tuple[Coefficient, ...]:
        unit = length(self.rotary)
        return (Coefficient("a", unit), Coefficient("b", unit))

    def shapes(self) -> tuple[Shape, ...]:
        low, high = (_TURN / 200.0, _TURN) if self.rotary else (1e-4, 1.0)
        return (Shape("period", length(self.rotary), low, high),)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        if self.rotary:
            return (_TURN / np.array(sorted(TURNS, reverse=True), dtype=float),)
        (shape,) = self.shapes()
        return (np.clip(float(np.ptp(motion.axis(self.axis).q)) / WAVES[::-1], shape.lower, shape.upper),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: parts of a turn or of the travel that the rows resolve.

        On a travel L, errors whose frequencies differ by 1/L are told apart: a quarter of that misses none.
        """
        (shape,) = self.shapes()
        low = max(3.0 * sight.pace, 10.0 * sight.noise, shape.lower)
        if self.rotary:
            return self.over([p for p in self.grid(motion)[0] if p >= low])
        each = sight.travel / np.arange(float(WAVES[0]), float(WAVES[-1]), 0.25)
        return self.over([p for p in each if low <= p <= shape.upper])

    def columns(self, motion: Motion) -> Columns:
        assert self.period is not None
        own = motion.axis(self.axis)
        k = _TURN / self.period
        c, s = np.cos(k * own.q), np.sin(k * own.q)
        bend = np.stack(
            [-k * k * c * own.v**2 - k * s * own.a, -k * k * s * own.v**2 + k * c * own.a], axis=-1
        )
        bend = motion.passed(bend)
        return shaken(self, motion, own.index, _pushed(self, motion, own.index, bend))


def _pushed(effect: Effect, motion: Motion, joint: int, bend: Floats) -> Floats:
    """Return -M times an acceleration, shape (n, p)."""
    return -inertia(effect, motion, joint)[:, None] * bend
