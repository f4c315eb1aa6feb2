"""Drive trains that are not stiff: the encoder sits on the motor and the load moves otherwise.

No channel of the log holds what the load does, so each column compares the effort of a load behind a spring or a gap
with that of a stiff drive, along the measured path of the motor:

    tau = share (carried(load; shape) - load)                                      [N or N·m]

Through the inertia matrix it pushes the other axes as well, ``tau_i = M_ij / M_jj`` times it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Coefficient, Effect, Shape, usual
from pinotwin.effects.family import TRANSMISSION
from pinotwin.effects.scene import Shaking, inertia
from pinotwin.effects.sight import Sight
from pinotwin.motion import Motion
from pinotwin.system.kernels import compiled

LOAD = 0.65
"""Share of an axis' inertia behind a spring or a gap that is assumed where others are shaken by it, and where it
changes with the posture."""
LOWEST_MODE = 8.0  # Lowest frequency of a mode that is tried [Hz]
DAMPING = (0.03, 0.08, 0.2)  # Damping ratios that are tried
GAPS = np.geomspace(0.1, 13.0, 13)  # Gaps from which identification starts, times 10 um or 0.1 mrad
FINE_GAPS = np.geomspace(0.1, 50.0, 36)
"""Gaps that a search tries, times 10 um or 0.1 mrad: a play off by a fifth meets its faces at other times, and
closes next to nothing."""
FACES = ((40.0, 0.4), (70.0, 0.4), (120.0, 0.35), (220.0, 0.25))
"""Mode [Hz] and damping ratio of a load against the faces of a gap that a search tries."""


@compiled
def _sprung(load: Floats, ratio: Floats, w: float, zeta: float, step: float) -> Floats:
    """Return the effort that a spring with a damper passes on of a load (n,) that acts if it is stiff.

    With mean inertia M, ``ratio`` = M over that of the posture and twist d, s = M d follows
    ``s'' + 2 zeta w ratio s' + w^2 ratio s = ratio load``; passed on is ``w^2 s + 2 zeta w s'``. Exact for a load
    that changes linearly within a step.
    """
    n = len(load)
    out = np.empty(n)
    s, v, last = load[0] / (w * w), 0.0, -1.0
    out[0] = load[0]
    fade = c = sn = d = ww = wd = 0.0
    for k in range(1, n):
        r = 0.5 * (ratio[k - 1] + ratio[k])
        if r != last:
            d, ww, last = zeta * w * r, w * w * r, r
            wd = np.sqrt(max(ww - d * d, 1e-6 * ww))
            fade, c, sn = np.exp(-d * step), np.cos(wd * step), np.sin(wd * step) / wd
        slope = r * (load[k] - load[k - 1]) / (step * ww)
        level = r * load[k - 1] / ww - 2.0 * d * slope / ww
        x, u = s - level, v - slope
        s = level + slope * step + fade * (x * (c + d * sn) + u * sn)
        v = slope + fade * (u * (c - d * sn) - x * ww * sn)
        out[k] = w * w * s + 2.0 * zeta * w * v
    return out


@compiled
def _carried(
    q: Floats, extra: Floats, ratio: Floats, gap: float, w: float, zeta: float, step: float
) -> Floats:
    """Return the effort per inertia that a drive with a gap carries, given the motor's path.

    The load (unit inertia) follows ``x'' + extra = T``, ``T = w^2 dz(q - x; gap) + 2 zeta w (q' - x')`` in contact;
    ``extra`` is what else acts on it, per inertia; ``ratio`` as in :func:`_sprung`. Leapfrog steps; the effort of a
    sample is the mean over half a step before and after it: one over the step before it comes late.
    """
    parts = 2 * max(2, int(np.ceil(0.5 * step * w / 0.3)))
    h = step / parts
    out = np.zeros(len(q))
    x, v = q[0], (q[1] - q[0]) / step
    for k in range(1, len(q)):
        rate = (q[k] - q[k - 1]) / step
        stiff, damper = w * w * ratio[k], 2.0 * zeta * w * ratio[k]
        for i in range(parts):
            d = q[k - 1] + rate * h * i - x
            effort = 0.0
            if d > 0.5 * gap:
                effort = max(stiff * (d - 0.5 * gap) + damper * (rate - v), 0.0)
            elif d < -0.5 * gap:
                effort = min(stiff * (d + 0.5 * gap) + damper * (rate - v), 0.0)
            v += h * (effort - extra[k])
            x += h * v
            late = 0.0 if 2 * i < parts else 0.5 if 2 * i == parts else 1.0
            out[k - 1] += (1.0 - late) * effort / parts
            out[k] += late * effort / parts
    return out


def _steadiest(load: Floats, period: float, step: float, beginning: float = 1.0) -> int:
    """Return where a spring may rest in the ``beginning`` [s]: amid the steadiest ``period`` [s] of its load (n,)."""
    width = max(2, round(period / step))
    first = load[: max(width + 1, min(round(beginning / step), len(load) // 2))]
    if len(first) <= width:
        return 0
    sums = [np.concatenate([[0.0], np.cumsum((first - first.mean()) ** k)]) for k in (1, 2)]
    mean, square = ((x[width:] - x[:-width]) / width for x in sums)
    return int(np.argmin(square - mean**2)) + width // 2


@dataclass(frozen=True)
class _Flexible(Shaking):
    """A load behind a spring and a damper: tau = share [sprung(load; frequency, damping) - load]."""

    family = TRANSMISSION
    causes = ("flexibility",)
    linear = (Coefficient("share", "-", lower=0.0, upper=1.0),)
    needs = ("rigid", "mass")
    searched = 2
    load = LOAD
    frequency: float = 30.0  # mode of the load against the motor held still [Hz]; searched
    damping: float = 0.05  # its damping ratio; searched

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("frequency", "Hz", 2.0, 200.0), Shape("damping", "-", 0.005, 0.7))

    def mode(self) -> tuple[float, float]:
        return self.frequency, self.damping

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return modes that the rows resolve."""
        top = max(Sight.of(motion, self.axis).fastest_mode, 1.5 * LOWEST_MODE)
        return np.geomspace(0.5 * LOWEST_MODE, min(top, 200.0), 15), np.asarray(DAMPING)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return modes that the rows resolve; none where they are too few for one."""
        if sight.fastest_mode < LOWEST_MODE:
            return ()
        return self.over(np.geomspace(LOWEST_MODE, max(sight.fastest_mode, 16.0), 15), DAMPING)

    def swing(self, motion: Motion) -> Floats:
        joint = motion.index(self.axis)
        own = inertia(self, motion, joint)
        itself = own * motion.a[:, joint]
        rest = self.channel(motion, "rigid")[:, joint] - itself
        # the spring carries all of gravity and coupling, of the inertia its share
        load = itself + rest / LOAD
        mean, w = float(np.mean(own)), 2.0 * np.pi * self.frequency
        # mean inertia behind the spring over that of every row, which a posture cannot make vanish
        ratio = LOAD * mean / np.maximum(own - (1.0 - LOAD) * mean, 0.05 * mean)
        out = np.zeros(len(load))
        for part in motion.segments:
            at = slice(part.start + _steadiest(load[part], 1.0 / self.frequency, motion.step), part.stop)
            if at.stop > at.start:
                out[at] = _sprung(load[at], ratio[at], w, self.damping, motion.step) - load[at]
        return out[:, None]


@dataclass(frozen=True)
class DriveFlexibility(_Flexible):
    """Screw, belt, gear or shaft that twists: tau = share [sprung(load; frequency, damping) - load].

    ``sprung`` passes on what a spring and a damper transmit of a load; the share is that of the axis'
    inertia behind the spring.
    """

    name = "drive_flexibility"
    title = "Flexible drive"
    words = "screw, belt or gear gives like a spring: motor and load swing apart"
    remedy = "check belt tension, coupling and nut; log a second encoder on the load if there is one"
    colour = "#1f9e89"
    inseparable = ("joint_flexibility",)
    imitates = ("joint_flexibility", "delay", "encoder_error", "backlash", "rigid_body")


@dataclass(frozen=True)
class JointFlexibility(_Flexible):
    """Structure that bends along an axis: tau = share [sprung(load; frequency, damping) - load].

    The equation of a flexible drive: what bends lies behind the guide or the gear, which the signals of
    the motor cannot tell. A joint of its own (``passive`` in machine.yaml) models the bend in full.
    """

    name = "joint_flexibility"
    title = "Flexible structure"
    words = "the structure gives like a spring"
    remedy = "tighten the mounting; put an accelerometer on the load and hit it with the brakes on"
    colour = "#35618f"
    inseparable = ("drive_flexibility",)
    imitates = ("drive_flexibility", "delay", "encoder_error")


@dataclass(frozen=True)
class Backlash(Shaking):
    """Play between motor and load: tau = share [carried(path; gap, frequency, damping) - load].

    The load floats through the gap after a reversal, then meets the other face, on which it settles with
    a contact mode.
    """

    name = "backlash"
    family = TRANSMISSION
    causes = ("flexibility",)
    words = "play: at reversal the motor moves before the load does"
    remedy = "hold the load and turn the motor to and fro: measure the lost motion; adjust nut or gear"
    colour = "#c44e52"
    linear = (Coefficient("share", "-", lower=0.0, upper=1.5),)
    imitates = ("presliding", "stribeck", "drive_flexibility", "delay")
    needs = ("rigid", "mass")
    sharp = True
    searched = 3
    gap: float = usual(1e-5, 1e-4)  # play [m or rad]; searched
    frequency: float = 150.0  # mode of the load against a face of the gap [Hz]; searched
    damping: float = 0.35  # its damping ratio; searched
    load: float = LOAD  # share of the axis' inertia behind the gap

    def shapes(self) -> tuple[Shape, ...]:
        low, high = (5e-6, 5e-2) if self.rotary else (5e-7, 5e-3)
        return (
            Shape("gap", self.unit("x"), low, high),
            Shape("frequency", "Hz", 20.0, 400.0),
            Shape("damping", "-", 0.05, 0.9),
        )

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return gaps [m or rad], modes [Hz] and damping ratios of the contact, some softer than faces are.

        The path does not predict each impact, and the mean over unpredictable impacts settles more slowly than one.
        """
        return self._usual() * GAPS, np.array([90.0, 150.0, 220.0, 300.0]), np.array([0.2, 0.35])

    def _usual(self) -> float:
        return 1e-4 if self.rotary else 1e-5

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return gaps wider than the noise of the position, where there are reversals."""
        if not sight.both_ways or sight.reversals < 2 or sight.rate < 50.0:
            return ()
        gaps = [g for g in self._usual() * FINE_GAPS if 2.0 * sight.noise < g < 0.05 * sight.travel]
        # the weight of a rotary axis moves it through the gap
        bodies = [replace(self, load=x) for x in ((0.65, 0.8) if self.rotary else (0.65,))]
        return tuple(e.shaped((g, f, z)) for e in bodies for g in gaps for f, z in FACES)

    def swing(self, motion: Motion) -> Floats:
        joint = motion.index(self.axis)
        rigid = self.channel(motion, "rigid")[:, joint]
        own, a = inertia(self, motion, joint), motion.a[:, joint]
        q = np.ascontiguousarray(motion.q[:, joint])
        extra = (rigid / own - a) / self.load
        ratio, out = float(np.mean(own)) / own, np.zeros(len(q))
        w = 2.0 * np.pi * self.frequency
        for part in motion.segments:
            if part.stop - part.start > 1:
                pieces = (q[part], extra[part], ratio[part])
                out[part] = _carried(*pieces, self.gap, w, self.damping, motion.step)
        values = self.load * own * out - rigid + (1.0 - self.load) * own * a
        return motion.passed(values)[:, None]
