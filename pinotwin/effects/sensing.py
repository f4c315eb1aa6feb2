"""Errors of sensors: late or wrongly scaled effort, periodic error of an encoder; they change what is logged.

The effort in their columns is the model's: measured effort holds the very thing that is to be explained.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Coefficient, Columns, Effect, OneAxis, Shape, usual
from pinotwin.effects.family import SENSING
from pinotwin.effects.scene import Shaking, inertia
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import TURN
from pinotwin.motion import Motion

SPANS = (3e-4, 1e-3, 3e-3, 1e-2, 2e-2, 4e-2, -3e-4, -1e-3, -3e-3, -1e-2, -2e-2)
"""Delays (leads where negative) that are tried [s]."""
FIRST_ORDER = 1.5e-3
"""Span up to which a delay is its first order: the change of the effort times the delay [s]."""
WHOLE = 0.75  # Share of a longer span that a delay must come to: play, which looks like one, reaches less
TURNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 36)  # Errors a turn that are tried
WAVES = np.geomspace(2.0, 40.0, 31)  # Errors a travel that are tried on a linear axis


@dataclass(frozen=True)
class Delay(OneAxis):
    """Effort that is logged late against position: tau = seconds [m(t - span) - m(t)] / span, m the model's.

    Exact where ``span`` is the delay itself; with a span of zero tau = -seconds dm/dt, its first order.
    A lead is a negative delay. Beside it, ``lead`` under ``data`` in machine.yaml moves the channel.
    """

    name = "delay"
    family = SENSING
    words = "one signal was recorded late against the others"
    remedy = "compare the clocks of the channels; state the lead of the effort in machine.yaml"
    colour = "#7f7f7f"
    linear = (Coefficient("seconds", "s"),)
    imitates = ("viscous", "drive_flexibility", "joint_flexibility", "encoder_error")
    needs = ("model",)
    searched = 1
    logged_effort = True
    span: float = 1e-3  # time over which the change of effort is taken [s]; searched

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("span", "s", -0.06, 0.06, log=False),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return delays of a tenth of a sample at least."""
        return self.over([x for x in SPANS if abs(x) > 0.1 * sight.step] or [sight.step, -sight.step])

    def possible(self, theta: Floats) -> bool:
        """Whether all of the effort is late by a span [s] that rows resolve; of play and springs a part of it is."""
        if abs(self.span) <= FIRST_ORDER:
            return True
        return bool(WHOLE < float(theta[0]) / self.span < 1.0 / WHOLE)

    def columns(self, motion: Motion) -> Columns:
        joint = motion.index(self.axis)
        effort, span = self.channel(motion, "model")[:, joint], self.span
        out = np.zeros(len(effort))
        for part in motion.segments:
            x, t = effort[part], motion.t[part]
            if len(x) > 1 and abs(span) < 1e-3 * motion.step:
                out[part] = -np.gradient(x, motion.step)
            elif len(x) > 1:
                out[part] = (np.interp(t - span, t, x) - x) / span
        return Columns((joint,), out[:, None, None])


@dataclass(frozen=True)
class EffortScale(OneAxis):
    """Effort that is logged too large or too small: tau = share m, m the effort of the model.

    On one axis alone masses and frictions take its place; it shows by what the axis shares with others,
    or as a change of a twin.
    """

    name = "effort_scale"
    family = SENSING
    title = "Scale of the effort"
    words = "the effort is off by a factor: torque constant, gear ratio, unit"
    remedy = "hang a known weight on the axis: it is the ruler for the effort; check the torque constant"
    colour = "#5f7f3f"
    linear = (Coefficient("share", "-", lower=-1.0),)
    imitates = ("rigid_body", "payload", "load_friction")
    needs = ("model",)
    logged_effort = True

    def columns(self, motion: Motion) -> Columns:
        joint = motion.index(self.axis)
        return Columns((joint,), self.channel(motion, "model")[:, joint, None, None])


@dataclass(frozen=True)
class EncoderError(Shaking):
    """Periodic error of the position: q_logged = q + a cos x + b sin x, x = 2 pi q / period.

    The controller follows the error, so the axis accelerates otherwise than the log says:
    tau = -M d²/dt² (a cos x + b sin x), here and through the inertia matrix on the other axes.
    """

    name = "encoder_error"
    family = SENSING
    words = "the position sensor repeats a small error with its own period"
    remedy = "check how the encoder is mounted: eccentric disc, tilted head; adjust its signals"
    colour = "#17869e"
    linear = (Coefficient("a", "x"), Coefficient("b", "x"))
    imitates = ("ripple", "ripple_modulated", "geometric_error", "delay")
    needs = ("mass",)
    sharp = True
    searched = 1
    several = True
    period: float = usual(1e-2, TURN)  # of the error [m or rad]; a turn or 10 mm when not given; searched

    def shapes(self) -> tuple[Shape, ...]:
        low, high = (TURN / 200.0, TURN) if self.rotary else (1e-4, 1.0)
        return (Shape("period", self.unit("x"), low, high),)

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        if self.rotary:
            return (TURN / np.array(sorted(TURNS, reverse=True), dtype=float),)
        (shape,) = self.shapes()
        return (np.clip(float(np.ptp(motion.axis(self.axis).q)) / WAVES[::-1], shape.lower, shape.upper),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return parts of a turn or of the travel L that the rows resolve: steps of 1/(4 L) in frequency miss none."""
        (shape,) = self.shapes()
        low = max(3.0 * sight.pace, 10.0 * sight.noise, shape.lower)
        if self.rotary:
            return self.over([p for p in self.grid(motion)[0] if p >= low])
        each = sight.travel / np.arange(float(WAVES[0]), float(WAVES[-1]), 0.25)
        return self.over([p for p in each if low <= p <= shape.upper])

    def swing(self, motion: Motion) -> Floats:
        own, k = motion.axis(self.axis), TURN / self.period
        c, s = np.cos(k * own.q), np.sin(k * own.q)
        bend = np.stack(
            [-k * k * c * own.v**2 - k * s * own.a, -k * k * s * own.v**2 + k * c * own.a], axis=-1
        )
        return -inertia(self, motion, own.index)[:, None] * motion.passed(bend)
