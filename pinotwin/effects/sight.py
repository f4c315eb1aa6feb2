"""What a motion can show of one axis: the bounds of every search for an effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.motion import Motion
from pinotwin.signals import roughness


@dataclass(frozen=True)
class Sight:
    """What one motion shows of one axis; SI."""

    travel: float  # of the axis [m or rad]
    noise: float  # standard deviation of the position's noise, quantisation included [m or rad]
    speed: Floats  # |v| of every row, shape (n,)
    forward: float  # share of the rows that move forward, of those that move
    reversals: int  # changes of direction
    step: float  # sampling interval of the log [s]
    rate: float  # rows a second that are fitted [Hz]
    cutoff: float  # corner of the low-pass that the log went through [Hz]
    noises: float = 20.0  # standard deviations of the noise that a travel must have to be motion
    slow: float = 0.05  # of the top speed; rows below it are slow ones

    @classmethod
    def of(cls, motion: Motion, axis: str) -> Sight:
        """Return what a motion shows of an axis."""
        own = motion.axis(axis)
        speed = np.abs(own.v)
        side = np.sign(own.v[speed > 0.01 * speed.max(initial=0.0)])
        return cls(
            travel=float(np.ptp(own.q)) if len(own.q) else 0.0,
            noise=roughness(own.q[s] for s in own.segments),
            speed=speed,
            forward=float(np.mean(side > 0.0)) if len(side) else 0.5,
            reversals=int(np.count_nonzero(np.diff(side))),
            step=motion.step,
            rate=1.0 / (motion.step * max(motion.decimation, 1)),
            cutoff=motion.cutoff,
        )

    @property
    def top(self) -> float:
        """Largest speed [m/s or rad/s]."""
        return float(self.speed.max(initial=0.0))

    @property
    def moves(self) -> bool:
        """Whether the axis moves by more than its noise."""
        return bool(np.isfinite(self.travel) and self.travel > max(self.noises * self.noise, 1e-12))

    @property
    def both_ways(self) -> bool:
        """Whether it moves forward and backward, each in 5 % of the moving rows at least."""
        return self.moves and 0.05 < self.forward < 0.95

    def rows_slower(self, speed: float) -> int:
        """Return how many rows move slower than a speed [m/s or rad/s], but not as slowly as noise does."""
        least = 2.0 * self.noise / self.step if self.rate < 1.0 / self.step else 0.0
        return int(np.count_nonzero((self.speed < speed) & (self.speed > min(least, 0.2 * speed))))

    @property
    def pace(self) -> float:
        """Distance between two rows at the median speed of the moving ones [m or rad]."""
        moving = self.speed[self.speed > self.slow * self.top]
        return float(np.median(moving)) / self.rate if len(moving) else 0.0

    @property
    def fastest_mode(self) -> float:
        """Highest frequency of a vibration that these rows resolve [Hz]."""
        return min(0.45 * self.rate, 2.0 * self.cutoff, 120.0)
