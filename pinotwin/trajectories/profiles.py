"""Jerk-limited moves from rest to rest in closed form, and sums of sines.

Biagiotti & Melchiorri 2008, doi:10.1007/978-3-540-85629-0, section 3.4: whichever limit (v, a, j) is reached.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from pinotwin.arrays import Floats

Profile = Callable[[Floats, int], Floats]
"""The command of one axis, or its derivative of an order up to 2, at times [s]; shape (n,) all."""
Limited = tuple[float, float, float]  # limits of speed, acceleration and jerk


@dataclass(frozen=True)
class Sines:
    """A sum of sines about a centre, faded in and out so that it starts and ends at rest."""

    centre: float  # [m or rad]
    amplitude: Floats  # [m or rad], shape (k,)
    frequency: Floats  # [Hz], shape (k,)
    phase: Floats  # [rad], shape (k,)
    seconds: float  # length [s]
    fade: float = 1.0  # length of the fades [s]

    def __call__(self, t: Floats, order: int = 0) -> Floats:
        """Return the command or its first or second derivative, shape (n,)."""
        w = 2.0 * np.pi * self.frequency
        angle = np.outer(t, w) + self.phase
        s0 = np.sin(angle) @ self.amplitude
        s1 = np.cos(angle) @ (self.amplitude * w)
        s2 = -np.sin(angle) @ (self.amplitude * w * w)
        f0, f1, f2 = self._window(np.asarray(t))
        if order == 0:
            return self.centre + f0 * s0
        return f1 * s0 + f0 * s1 if order == 1 else f2 * s0 + 2.0 * f1 * s1 + f0 * s2

    def _window(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        edge = np.minimum(t, self.seconds - t)
        x = np.clip(edge / self.fade, 0.0, 1.0)
        side = np.where(t < 0.5 * self.seconds, 1.0, -1.0) / self.fade
        inside = (x > 0.0) & (x < 1.0)
        rise = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        slope = 30.0 * x**2 * (1.0 - x) ** 2 * inside
        bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * inside
        return rise, slope * side, bend * side**2


def phases(distance: float, limits: Limited) -> Limited:
    """Return the durations of jerk, constant acceleration and constant speed of a move [s]."""
    v, a, j = limits
    ramp = min(a / j, np.sqrt(v / j), (distance / (2.0 * j)) ** (1.0 / 3.0))
    hold = 0.0
    if ramp == a / j:
        # distance covered by two ramps of speed without a cruise: v (v/a + a/j) = distance
        peak = 0.5 * (-a * a / j + np.sqrt((a * a / j) ** 2 + 4.0 * a * distance))
        hold = max(min(v, peak) / a - ramp, 0.0)
    speed = j * ramp * (ramp + hold)
    cruise = max(distance / speed - (2.0 * ramp + hold), 0.0) if speed > 0.0 else 0.0
    return ramp, hold, cruise


def move_time(distance: float, limits: Limited) -> float:
    """Return the shortest duration of a rest-to-rest move [s]."""
    if distance == 0.0:
        return 0.0
    ramp, hold, cruise = phases(abs(distance), limits)
    return 4.0 * ramp + 2.0 * hold + cruise


def move_pieces(
    start: float, distance: float, limits: Limited, stretch: float = 1.0
) -> list[tuple[float, float]]:
    """Return (start [s], jerk) of the pieces of a move over a distance [m or rad], rest last, slowed by ``stretch``."""
    ramp, hold, cruise = phases(abs(distance), limits)
    # Where the distance ends inside a phase, the jerk that covers it exactly in these durations.
    reach = ramp * (ramp + hold) * (2.0 * ramp + hold + cruise)
    jerk = distance / reach / stretch**3
    spans = stretch * np.array([ramp, hold, ramp, cruise, ramp, hold, ramp])
    starts = np.cumsum([start, *spans])
    return list(zip(starts.tolist(), (jerk, 0.0, -jerk, 0.0, -jerk, 0.0, jerk, 0.0), strict=True))


def chain(home: float, moves: list[tuple[list[tuple[float, float]], float]]) -> PPoly:
    """Return the command that starts at rest at ``home`` and makes moves: their pieces, and where each ends."""
    starts, rows = [0.0], [(0.0, 0.0, 0.0, home)]
    for pieces, target in moves:
        times = [t for t, _ in pieces]
        q, v, a = rows[-1][3], 0.0, 0.0
        for (_, j), s in zip(pieces, np.diff(times).tolist(), strict=False):
            rows.append((j / 6.0, a / 2.0, v, q))
            q += s * (v + s * (a / 2.0 + s * j / 6.0))
            v += s * (a + s * j / 2.0)
            a += s * j
        rows.append((0.0, 0.0, 0.0, target))  # no rounding is carried on
        starts += times
    return PPoly(np.array(rows).T, np.array([*starts, starts[-1] + 1.0]))  # the last piece goes on for ever


def rest(q: float) -> PPoly:
    """Return the command of an axis that stays at ``q``."""
    return chain(q, [])
