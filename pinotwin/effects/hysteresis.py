"""Drag with a long memory: cables, hoses, seals and preloaded gears that follow late and give way slowly.

    tau = k z,      dz/dx = [1 - |z|^n (1 + sgn(z dx)) / 2] / x_h         (Bouc 1967; Wen 1976,
                                                                            10.1061/JMCEA3.0002106)

z, from -1 to 1, is the share of the drag that has built up over the distance x_h since the last reversal, in
displacement: at rest it holds. Unlike presliding (micrometres) the distance is millimetres or degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Coefficient, Effect, Shape, usual
from pinotwin.effects.friction import Friction
from pinotwin.effects.sight import Sight
from pinotwin.motion import AxisMotion, Motion
from pinotwin.system.kernels import compiled

LONG = np.geomspace(0.005, 0.5, 8)  # Distances of build-up that are tried, as shares of the travel
SHARP = (0.5, 1.0, 2.0)  # Exponents that are tried
BUILT_UP = 1e-10  # [per distance] What z still gains when it counts as built up


@compiled
def _follow(q: Floats, x_h: float, n: float, out: Floats) -> None:
    """Fill z along a path, by Runge-Kutta steps of a twentieth of the distance at most."""
    z = 0.0
    out[0] = z
    for k in range(1, len(q)):
        dx = q[k] - q[k - 1]
        parts = int(np.ceil(20.0 * abs(dx) / x_h)) if dx != 0.0 else 0
        h = dx / (parts * x_h) if parts else 0.0
        for _ in range(parts):
            first = _slope(z, h, n)
            if first < BUILT_UP:  # sliding on, however far, adds nothing
                break
            second = _slope(z + 0.5 * h * first, h, n)
            third = _slope(z + 0.5 * h * second, h, n)
            last = _slope(z + h * third, h, n)
            z += h * (first + 2.0 * second + 2.0 * third + last) / 6.0
            z = min(1.0, max(-1.0, z))
        out[k] = z


@compiled
def _slope(z: float, h: float, n: float) -> float:
    """Return dz over dx / x_h: full while the drag lets go, less and less while it builds up."""
    if z * h <= 0.0:
        return 1.0
    size = abs(z)
    if n == 1.0:
        return 1.0 - size
    if n == 2.0:
        return 1.0 - size * size
    return 1.0 - (np.sqrt(size) if n == 0.5 else size**n)  # a power costs ten times a root


@dataclass(frozen=True)
class Hysteresis(Friction, AxisEffect):
    """Drag of cables and seals that builds up over a distance: tau = k z.

        dz/dx = [1 - |z|^n (1 + sgn(z dx)) / 2] / x_h

    Every stretch of a log starts with z = 0: what the strokes before it left is not known.
    """

    name = "hysteresis"
    words = "drag that turns round slowly after a reversal, as of cables, hoses or seals"
    remedy = "follow the cable carrier by hand: stiff cables, rubbing hoses, rolling seals; record short, long strokes"
    colour = "#8c6d31"
    linear = (Coefficient("k", "F", lower=0.0),)
    imitates = ("presliding", "coulomb", "backlash", "spring", "position_table")
    searched = 2
    # Slow as it is, an integrating controller answers it with next to no tracking error: the loop would
    # trade it for dry friction, which the effort of the open loop tells apart.
    refined_in_loop = False
    sharp = True
    x_h: float = usual(0.005, 0.05)  # distance over which the drag builds up [m or rad]; searched
    n: float = 1.0  # how sharply it gives way at the end; searched

    def shapes(self) -> tuple[Shape, ...]:
        low, high = (1e-4, 3.0) if self.rotary else (1e-5, 0.5)
        return (Shape("x_h", self.unit("x"), low, high), Shape("n", "-", 0.25, 4.0))

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return shares of the travel [m or rad], and exponents."""
        (shape, _) = self.shapes()
        travel = max(float(np.ptp(motion.axis(self.axis).q)), 1e3 * shape.lower)
        return np.clip(LONG * travel, shape.lower, shape.upper), np.array(SHARP)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return distances of some rows and of more than the noise, where there are reversals."""
        if not sight.both_ways or sight.reversals < 2:
            return ()
        distances, sharp = self.grid(motion)
        least = max(0.25 * sight.pace, 10.0 * sight.noise)
        return self.over([x for x in distances if x >= least], sharp)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        out = np.zeros((len(motion.q), 1))
        for part in motion.segments:
            if part.stop > part.start:
                z = np.zeros(part.stop - part.start)
                _follow(np.ascontiguousarray(motion.q[part]), self.x_h, self.n, z)
                out[part, 0] = z
        return out
