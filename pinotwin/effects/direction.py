"""The sign of the velocity with memory: what dry friction follows near standstill (thesis Eq. 3.9).

``sign(v)`` chatters at a zero crossing with noise. The direction ``d`` in [-1, 1] changes with slope ``1/width`` while
the axis speeds up, and holds while it slows down or stands: it goes on the same way without releasing its friction.
(Eq. 3.9 read to the letter would release it at the sample where v is exactly zero.)
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.motion import AxisMotion
from pinotwin.system.kernels import compiled


@compiled
def _scan(v: Floats, a: Floats, width: float, d0: float) -> Floats:
    d = np.empty_like(v)
    state = d0
    previous = 0.0 if len(v) == 0 else v[0]
    for k in range(len(v)):
        if v[k] * a[k] > 0.0 or (a[k] == 0.0 and v[k] != 0.0):
            state = min(1.0, max(-1.0, state + (v[k] - previous) / width))
        previous = v[k]
        d[k] = state
    return d


def direction(motion: AxisMotion, width: float) -> Floats:
    """Return the direction of motion with memory, shape (n,), within [-1, 1]; it turns over ``width`` [m/s or rad/s].

    Each segment starts from ``clip(v / width)``: what came before it is not known. A width of 0 gives ``sign(v)``.
    """
    if width <= 0.0:
        return np.sign(motion.v)
    d: Floats = np.clip(motion.v / width, -1.0, 1.0)  # rows between the segments
    for s in motion.segments:
        v, a = motion.v[s], motion.a[s]
        start = float(np.clip(v[0] / width, -1.0, 1.0)) if len(v) else 0.0
        d[s] = _scan(np.ascontiguousarray(v), np.ascontiguousarray(a), width, start)
    return d


def default_width(rotary: bool) -> float:
    """Return the usual width of the turn-over [m/s or rad/s]: 1 mm/s, or 10 mrad/s for a rotary axis."""
    return 1e-2 if rotary else 1e-3
