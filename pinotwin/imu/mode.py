"""A spring-mass-damper mode driven by a known load, exactly.

    x'' + 2 zeta wn x' + wn² x = load            first-order hold of the load over every step

The derivatives in wn and zeta are responses of the same mode, driven by -2 zeta x' - 2 wn x and by -2 wn x'.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.imu.filters import driven


class Response(NamedTuple):
    """Deflection, rate and acceleration of every load column, (n, k) each."""

    x: Floats
    v: Floats
    a: Floats


def respond(load: Floats, step: float, wn: float, zeta: float, *, rest: bool = True) -> Response:
    """Return the response to loads (n, k) [1/s² of x], ``step`` [s] apart; ``wn`` [rad/s]; settled or at ``rest``."""
    x, v = (driven((top, [1.0, 2.0 * zeta * wn, wn**2]), load, step) for top in ([1.0], [1.0, 0.0]))
    if not rest:
        free, start = decay(len(load), step, wn, zeta), load[0] / wn**2
        x, v = x - free.x[:, :1] * start, v - free.v[:, :1] * start
    return Response(x, v, load - 2.0 * zeta * wn * v - wn**2 * x)


def decay(n: int, step: float, wn: float, zeta: float) -> Response:
    """Return the free decays from a unit deflection and from a unit rate, (n, 2) each."""
    wd = wn * np.sqrt(1.0 - zeta**2)
    t = step * np.arange(n)
    envelope, c, s = np.exp(-zeta * wn * t), np.cos(wd * t), np.sin(wd * t)
    x = np.stack([envelope * (c + zeta * wn / wd * s), envelope * s / wd], axis=1)
    v = np.stack([-envelope * wn**2 / wd * s, envelope * (c - zeta * wn / wd * s)], axis=1)
    return Response(x, v, -2.0 * zeta * wn * v - wn**2 * x)
