"""The controller: what it adds to the effort or does not deliver, answered by a tracking error, e = G_ed d.

In the effort balance of an open loop it does not appear: the logged effort is what the motor gave.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Coefficient, Columns, Effect, OneAxis
from pinotwin.effects.family import SERVO
from pinotwin.effects.sight import Sight
from pinotwin.errors import DataError
from pinotwin.motion import Motion

AT_LIMIT = 2e-3  # Share of rows that a drive must spend at its limit, and how near to it they are


@dataclass(frozen=True)
class Commanded(OneAxis):
    """What a controller makes of its command."""

    family = SERVO
    unlisted = "belongs to the controller, which identify finds from the logged command"

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return the effect; only a log with a command shows it."""
        return () if motion.vr is None else (self,)

    def rates(self, motion: Motion) -> Floats:
        """Return velocity and acceleration of the command on the axis, shape (n, 2); DataError without one."""
        if motion.qr is None or motion.vr is None or motion.ar is None:
            raise DataError(f"{self.axis}.{self.name}: the log has no command; log {self.axis}.qr")
        joint = motion.index(self.axis)
        return np.stack([motion.vr[:, joint], motion.ar[:, joint]], axis=-1)


@dataclass(frozen=True)
class Feedforward(Commanded):
    """Effort that the controller adds from the command: tau = K_v vr + K_a ar."""

    name = "feedforward"
    title = "Feed-forward"
    words = "the controller's feed-forward of speed or acceleration is not what the model holds"
    remedy = "read the feed-forward gains of the drive, or switch them off, and record once more"
    colour = "#6f6fc9"
    linear = (Coefficient("K_v", "F·s/x"), Coefficient("K_a", "I"))
    imitates = ("loop_gain", "rigid_body", "viscous")

    def columns(self, motion: Motion) -> Columns:
        return Columns((motion.index(self.axis),), self.rates(motion)[:, None, :])


@dataclass(frozen=True)
class LoopGain(Commanded):
    """Gains of the controller that have changed: tau = dK_p e + dK_d e' + dK_i int(e), e = qr - q."""

    name = "loop_gain"
    title = "Gain of the controller"
    words = "a gain of the controller is not what it was"
    remedy = "compare the drive's parameters with the backup; look for a change of mode or gain set"
    colour = "#9467bd"
    linear = (Coefficient("dK_p", "F/x"), Coefficient("dK_d", "F·s/x"), Coefficient("dK_i", "F/(x·s)"))
    imitates = ("feedforward", "saturation")

    def columns(self, motion: Motion) -> Columns:
        """Return e, e' and the integral of e, which starts at zero in every stretch."""
        vr = self.rates(motion)[:, 0]
        own = motion.axis(self.axis)
        e = motion.error[:, own.index]
        total = np.zeros_like(e)
        for part in motion.segments:
            total[part] = np.cumsum(e[part]) * motion.step
        values = np.stack([e, vr - own.v, total], axis=-1)
        return Columns((own.index,), values[:, None, :])


@dataclass(frozen=True)
class Saturation(OneAxis):
    """A drive at its limit: tau = share [clip(m, -limit, limit) - m], m the effort of the model."""

    name = "saturation"
    family = SERVO
    title = "Drive at its limit"
    words = "the motor reached its limit"
    remedy = "lower acceleration or payload, or raise the current limit if the motor allows it"
    colour = "#b03a3a"
    linear = (Coefficient("share", "-", lower=0.0),)
    imitates = ("loop_gain", "external_force", "effort_scale")
    unlisted = "is stated by `effort_limit` of the axis"
    needs = ("model",)
    searched = 1
    limit: float = np.inf  # largest effort of the drive [N or N·m]; the largest of the log when not given

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return the largest effort of the log, where it is held for a while."""
        u = np.abs(motion.u[:, motion.index(self.axis)])
        u = u[np.isfinite(u)]
        limit = float(u.max(initial=0.0))
        held = np.mean(u > (1.0 - AT_LIMIT) * limit) if limit > 0.0 else 0.0
        return (replace(self, limit=limit),) if held > AT_LIMIT else ()

    def columns(self, motion: Motion) -> Columns:
        joint = motion.index(self.axis)
        asked = self.channel(motion, "model")[:, joint]
        missing = np.clip(asked, -self.limit, self.limit) - asked
        return Columns((joint,), missing[:, None, None])
