"""Patterns that no effect of the catalogue has: they compete with the effects and name nothing.

An effort that swings in time, a ripple that grows with speed, a curve over speed or over position and speed.
"""

from __future__ import annotations

import abc
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.effects.effect import AxisEffect, Coefficient, Effect, Shape
from pinotwin.effects.family import LOAD
from pinotwin.effects.ripple import Ripple, RippleModulated
from pinotwin.motion import AxisMotion
from pinotwin.signals import joined


@dataclass(frozen=True)
class Pattern(AxisEffect):
    """A pattern; see the module's docstring."""

    family = LOAD
    depends = "velocity"
    linear = (Coefficient("c0", "F"), Coefficient("c1", "F"))

    @abc.abstractmethod
    def says(self) -> str:
        """Return what the pattern is, with its numbers."""


@dataclass(frozen=True)
class Hum(Pattern):
    """A swing in time: tau = a sin(2 pi f t) + b cos(2 pi f t)."""

    name = "hum"
    searched = 1
    frequency: float = 5.0

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("frequency", "Hz", 0.2, 200.0),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        """See :meth:`AxisEffect.axis_columns`; every log counts its time from its own beginning."""
        phase = 2.0 * np.pi * self.frequency * motion.t
        return np.stack([np.sin(phase), np.cos(phase)], axis=1)

    def says(self) -> str:
        return f"swings in time at {self.frequency:.3g} Hz"


@dataclass(frozen=True)
class SpeedRipple(Pattern):
    """A ripple that grows with speed: tau = |v| (a sin(2 pi q / L) + b cos(2 pi q / L))."""

    name = "speed_ripple"
    searched = 1
    pitch: float = 1.0
    low: float = 1e-6
    high: float = 1e3

    def shapes(self) -> tuple[Shape, ...]:
        return (Shape("pitch", self.unit("x"), self.low, self.high),)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        phase = 2.0 * np.pi * motion.q / self.pitch
        return np.abs(motion.v)[:, None] * np.stack([np.sin(phase), np.cos(phase)], axis=1)

    def says(self) -> str:
        return f"is a ripple of pitch {self.pitch:.4g} {self.unit('x')} that grows with speed"


@dataclass(frozen=True)
class Curve(Pattern):
    """A free curve: hat functions between knots."""

    searched = 4
    knots: tuple[float, ...] = ()

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"c{k}", self.unit("F")) for k in range(len(self.knots)))

    def _hats(self, x: Floats) -> Floats:
        return np.stack([np.interp(x, self.knots, row) for row in np.eye(len(self.knots))], axis=1)

    def says(self) -> str:
        return f"looks like {self.words}"


@dataclass(frozen=True)
class SpeedCurve(Curve):
    """A free curve over speed, its own for each direction: hat functions between knots."""

    name = "speed_curve"
    words = "a function of speed of a form that no friction law has"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return self._hats(motion.v)


@dataclass(frozen=True)
class PositionSpeedCurve(Curve):
    """A position-dependent viscosity: v times a free curve over position."""

    name = "position_viscosity"
    words = "friction that changes along the stroke"
    dry: bool = False

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return self._hats(motion.q) * (np.sign(motion.v) if self.dry else motion.v)[:, None]


LOUDEST = 40  # Frequencies that are tried: where the spectrum of what is left peaks
SLOWEST = 1.0  # [Hz] What is slower comes with the motion
PAUSE = 60.0
"""[s] A longer one parts a log as well: a spectrum over the hours between two days' logs would tell no more."""


def loudest(t: Floats, left: Floats) -> list[float]:
    """Return the frequencies of the highest peaks of a spectrum, of all logs together [Hz]."""
    step = float(np.median(np.diff(t)))
    logs = joined(t, PAUSE)
    count = 1 + max(round(float(np.ptp(t[part])) / step) for part in logs)
    power = np.zeros(2 * count + 1)
    for part in logs:
        even = np.zeros(count)
        even[np.round((t[part] - t[part][0]) / step).astype(int)] = left[part]
        power += np.abs(np.fft.rfft(even, 4 * count)) ** 2
    frequency = np.fft.rfftfreq(4 * count, step)
    power[(frequency < SLOWEST) | (frequency > 0.4 / step)] = 0.0
    peaks, _ = find_peaks(power)
    return [float(frequency[k]) for k in peaks[np.argsort(-power[peaks])][:LOUDEST]]


def patterns(comparison: Comparison) -> Iterator[Effect]:
    """Yield the patterns worth trying on every axis."""
    motion = comparison.new.motion
    for axis in (x for x in comparison.machine.axes.values() if x.index in comparison.new.joints):
        j = axis.index
        rows = comparison.new.samples(j)
        q, v, t = motion.q[rows, j], motion.v[rows, j], motion.t[rows]
        low, high = np.quantile(v, [0.005, 0.995])
        travel = float(np.ptp(q))
        if travel <= 0.0:
            continue
        for f in loudest(t, comparison.new.residual[j]):
            yield Hum(axis.name, axis.rotary, frequency=f)
        yield SpeedCurve(axis.name, axis.rotary, knots=tuple(np.linspace(low, high, 9).tolist()))
        knots = tuple(np.linspace(q.min(), q.max(), 7).tolist())
        yield PositionSpeedCurve(axis.name, axis.rotary, knots=knots)
        yield PositionSpeedCurve(axis.name, axis.rotary, knots=knots, dry=True)
        longest = travel / RippleModulated.repeats
        for ripple in Ripple.candidates(comparison.machine, axis.name, motion):
            pitch = float(ripple.shape_values()[0]) if ripple.shape_values() else 0.0
            if 0.0 < pitch <= longest:
                bounds = {"low": 0.5 * pitch, "high": min(2.0 * pitch, longest)}
                yield SpeedRipple(axis.name, axis.rotary, pitch=pitch, **bounds)
