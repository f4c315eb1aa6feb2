"""Jerk-limited point-to-point motion in closed form (seven phases), and other commands of one axis.

Rest to rest over a distance d with limits (v, a, j), Biagiotti & Melchiorri 2008,
doi:10.1007/978-3-540-85629-0, section 3.4: whichever of jerk, acceleration and speed limit is
reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from pinotwin.arrays import Floats


class Profile(Protocol):
    """The command of one axis."""

    def at(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        """Return position, velocity and acceleration at times ``t`` [s], each of shape (n,)."""
        ...


@dataclass(frozen=True)
class JerkPieces:
    """Pieces of constant jerk: exact at any time.

    Attributes:
        start: start of every piece [s], shape (k,), increasing; the last piece lasts for ever.
        q: position at each start, shape (k,); likewise ``v`` and ``a``; ``j`` the jerk of the
            piece.
        v: velocity.
        a: acceleration.
        j: jerk.
    """

    start: Floats
    q: Floats
    v: Floats
    a: Floats
    j: Floats

    def at(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        """See :meth:`Profile.at`."""
        k = np.clip(np.searchsorted(self.start, t, side="right") - 1, 0, len(self.start) - 1)
        s = np.maximum(np.asarray(t) - self.start[k], 0.0)
        q, v, a, j = self.q[k], self.v[k], self.a[k], self.j[k]
        return (
            q + s * (v + s * (a / 2.0 + s * j / 6.0)),
            v + s * (a + s * j / 2.0),
            a + s * j,
        )


@dataclass(frozen=True)
class Sines:
    """A sum of sines about a centre, faded in and out so that it starts and ends at rest.

    Attributes:
        centre: [m or rad].
        amplitude: [m or rad], shape (k,).
        frequency: [Hz], shape (k,).
        phase: [rad], shape (k,).
        seconds: length [s].
        fade: length of the fades [s].
    """

    centre: float
    amplitude: Floats
    frequency: Floats
    phase: Floats
    seconds: float
    fade: float = 1.0

    def at(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        """See :meth:`Profile.at`."""
        w = 2.0 * np.pi * self.frequency
        angle = np.outer(t, w) + self.phase
        s0 = np.sin(angle) @ self.amplitude
        s1 = np.cos(angle) @ (self.amplitude * w)
        s2 = -np.sin(angle) @ (self.amplitude * w * w)
        f0, f1, f2 = self._window(np.asarray(t))
        return (
            self.centre + f0 * s0,
            f1 * s0 + f0 * s1,
            f2 * s0 + 2.0 * f1 * s1 + f0 * s2,
        )

    def _window(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        edge = np.minimum(t, self.seconds - t)
        x = np.clip(edge / self.fade, 0.0, 1.0)
        side = np.where(t < 0.5 * self.seconds, 1.0, -1.0) / self.fade
        inside = (x > 0.0) & (x < 1.0)
        rise = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        slope = 30.0 * x**2 * (1.0 - x) ** 2 * inside
        bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * inside
        return rise, slope * side, bend * side**2


def phases(distance: float, v: float, a: float, j: float) -> tuple[float, float, float]:
    """Return the durations of jerk, constant acceleration and constant speed [s].

    Args:
        distance: length of the move, positive [m or rad].
        v: speed limit.
        a: acceleration limit.
        j: jerk limit.
    """
    ramp = min(a / j, np.sqrt(v / j), (distance / (2.0 * j)) ** (1.0 / 3.0))
    hold = 0.0
    if ramp == a / j:
        # distance covered by two ramps of speed without a cruise: v (v/a + a/j) = distance
        peak = 0.5 * (-a * a / j + np.sqrt((a * a / j) ** 2 + 4.0 * a * distance))
        hold = max(min(v, peak) / a - ramp, 0.0)
    speed = j * ramp * (ramp + hold)
    cruise = max(distance / speed - (2.0 * ramp + hold), 0.0) if speed > 0.0 else 0.0
    return ramp, hold, cruise


def move_time(distance: float, limits: tuple[float, float, float]) -> float:
    """Return the shortest duration of a rest-to-rest move [s]."""
    if distance == 0.0:
        return 0.0
    ramp, hold, cruise = phases(abs(distance), *limits)
    return 4.0 * ramp + 2.0 * hold + cruise


def move_pieces(
    start: float, distance: float, limits: tuple[float, float, float], stretch: float = 1.0
) -> list[tuple[float, float]]:
    """Return the move as (start time, jerk) of its pieces, the last one at rest.

    Args:
        start: when it starts [s].
        distance: signed length [m or rad].
        limits: speed, acceleration, jerk.
        stretch: slow-down factor (>= 1): speed, acceleration and jerk fall by its powers 1, 2, 3.
    """
    ramp, hold, cruise = phases(abs(distance), *limits)
    # Where the distance ends inside a phase, the jerk that covers it exactly in these durations.
    reach = ramp * (ramp + hold) * (2.0 * ramp + hold + cruise)
    jerk = distance / reach / stretch**3
    pieces, t = [], start
    spans = (ramp, hold, ramp, cruise, ramp, hold, ramp)
    for span, sign in zip(spans, (1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0), strict=True):
        pieces.append((t, sign * jerk))
        t += span * stretch
    return [*pieces, (t, 0.0)]


def chain(home: float, moves: list[tuple[list[tuple[float, float]], float]]) -> JerkPieces:
    """Return the profile that makes the moves one after another, starting at rest at ``home``.

    Args:
        home: first position [m or rad].
        moves: pieces of each move (:func:`move_pieces`) and the position that it ends at.
    """
    rows = [(0.0, home, 0.0, 0.0, 0.0)]
    for pieces, target in moves:
        q, v, a = rows[-1][1], 0.0, 0.0
        for (t, j), (after, _) in pairwise(pieces):
            rows.append((t, q, v, a, j))
            s = after - t
            q += s * (v + s * (a / 2.0 + s * j / 6.0))
            v += s * (a + s * j / 2.0)
            a += s * j
        rows.append((pieces[-1][0], target, 0.0, 0.0, 0.0))  # no rounding is carried on
    table = np.array(rows)
    return JerkPieces(*(table[:, k].copy() for k in range(5)))
