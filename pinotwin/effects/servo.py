"""The controller: what it adds to the effort or does not deliver. The plant stays what it is.

A closed loop answers these efforts with a tracking error, e = G_ed d. In the effort balance of an open
loop they do not appear: the logged effort is what the motor gave.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Coefficient, Columns, Effect, Need, channel
from pinotwin.effects.family import SERVO, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.symbols import effort, inertia, length
from pinotwin.errors import DataError
from pinotwin.motion import Motion

CONTROLLER = "belongs to the controller, which identify finds from the logged command"
AT_LIMIT = 2e-3
"""Share of rows that a drive must spend at its limit, and how near to it they are."""


def _command(effect: Effect, motion: Motion) -> tuple[Floats, Floats, Floats]:
    """Return command, its velocity and its acceleration on the effect's axis, each (n,)."""
    if motion.qr is None or motion.vr is None or motion.ar is None:
        raise DataError(f"{effect.axis}.{effect.name}: the log has no command; log {effect.axis}.qr")
    joint = motion.index(str(effect.axis))
    return motion.qr[:, joint], motion.vr[:, joint], motion.ar[:, joint]


@dataclass(frozen=True)
class Feedforward(Effect):
    """Effort that the controller adds from the command: tau = K_v vr + K_a ar."""

    name: ClassVar[str] = "feedforward"
    family: ClassVar[Family] = SERVO
    title: ClassVar[str] = "Feed-forward"
    words: ClassVar[str] = (
        "the controller's feed-forward of speed or acceleration is not what the model holds"
    )
    remedy: ClassVar[str] = (
        "read the feed-forward gains of the drive, or switch them off, and record once more"
    )
    colour: ClassVar[str] = "#6f6fc9"
    imitates: ClassVar[tuple[str, ...]] = ("loop_gain", "rigid_body", "viscous")
    unlisted: ClassVar[str] = CONTROLLER
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        f, x = effort(self.rotary), length(self.rotary)
        return (Coefficient("K_v", f"{f}·s/{x}"), Coefficient("K_a", inertia(self.rotary)))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: only a log with a command shows it."""
        del sight
        return () if motion.vr is None else (self,)

    def columns(self, motion: Motion) -> Columns:
        _, vr, ar = _command(self, motion)
        return Columns((motion.index(self.axis),), np.stack([vr, ar], axis=-1)[:, None, :])


@dataclass(frozen=True)
class LoopGain(Effect):
    """Gains of the controller that have changed: tau = dK_p e + dK_d e' + dK_i int(e), e = qr - q."""

    name: ClassVar[str] = "loop_gain"
    family: ClassVar[Family] = SERVO
    title: ClassVar[str] = "Gain of the controller"
    words: ClassVar[str] = "a gain of the controller is not what it was"
    remedy: ClassVar[str] = (
        "compare the drive's parameters with the backup; look for a change of mode or gain set"
    )
    colour: ClassVar[str] = "#9467bd"
    imitates: ClassVar[tuple[str, ...]] = ("feedforward", "saturation")
    unlisted: ClassVar[str] = CONTROLLER
    axis: str
    rotary: bool = False

    def coefficients(self) -> tuple[Coefficient, ...]:
        f, x = effort(self.rotary), length(self.rotary)
        units = {"dK_p": f"{f}/{x}", "dK_d": f"{f}·s/{x}", "dK_i": f"{f}/({x}·s)"}
        return tuple(Coefficient(name, unit) for name, unit in units.items())

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: only a log with a command shows it."""
        del sight
        return () if motion.qr is None else (self,)

    def columns(self, motion: Motion) -> Columns:
        """See :meth:`Effect.columns`; the integral starts at zero in every stretch."""
        _, vr, _ = _command(self, motion)
        own = motion.axis(self.axis)
        e = motion.error[:, own.index]
        total = np.zeros_like(e)
        for part in motion.segments:
            total[part] = np.cumsum(e[part]) * motion.step
        values = np.stack([e, vr - own.v, total], axis=-1)
        return Columns((own.index,), values[:, None, :])


@dataclass(frozen=True)
class Saturation(Effect):
    """A drive at its limit: tau = share [clip(m, -limit, limit) - m], m the effort of the model.

    Attributes:
        limit: largest effort of the drive [N or N·m]; the largest of the log when not given.
    """

    name: ClassVar[str] = "saturation"
    family: ClassVar[Family] = SERVO
    title: ClassVar[str] = "Drive at its limit"
    words: ClassVar[str] = "the motor reached its limit"
    remedy: ClassVar[str] = "lower acceleration or payload, or raise the current limit if the motor allows it"
    colour: ClassVar[str] = "#b03a3a"
    imitates: ClassVar[tuple[str, ...]] = ("loop_gain", "external_force", "effort_scale")
    unlisted: ClassVar[str] = "is stated by `effort_limit` of the axis"
    needs: ClassVar[tuple[Need, ...]] = ("model",)
    searched: ClassVar[int] = 1
    axis: str
    rotary: bool = False
    limit: float = np.inf

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("share", "-", lower=0.0),)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: the largest effort of the log, where it is held for a while."""
        del sight
        u = np.abs(motion.u[:, motion.index(self.axis)])
        u = u[np.isfinite(u)]
        limit = float(u.max(initial=0.0))
        held = np.mean(u > (1.0 - AT_LIMIT) * limit) if limit > 0.0 else 0.0
        return (replace(self, limit=limit),) if held > AT_LIMIT else ()

    def columns(self, motion: Motion) -> Columns:
        joint = motion.index(self.axis)
        asked = channel(self, motion, "model")[:, joint]
        missing = np.clip(asked, -self.limit, self.limit) - asked
        return Columns((joint,), missing[:, None, None])
