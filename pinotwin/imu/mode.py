"""A spring-mass-damper mode driven by a known load, exactly.

    x'' + 2 zeta wn x' + wn² x = load            first-order hold of the load over every step

The state of the discrete system follows by the matrix exponential; the derivatives in wn and zeta
are responses of the same mode, driven by -2 zeta x' - 2 wn x and by -2 wn x'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from pinotwin.arrays import Floats
from pinotwin.system.kernels import compiled


@dataclass(frozen=True)
class Response:
    """Deflection, rate and acceleration of every load column, (n, k) each."""

    x: Floats
    v: Floats
    a: Floats


def respond(load: Floats, step: float, wn: float, zeta: float, *, rest: bool = True) -> Response:
    """Return the response to load columns (n, k) [1/s² of x], from equilibrium or from zero.

    Args:
        load: driving acceleration, first-order hold.
        step: sampling interval [s].
        wn: undamped natural frequency [rad/s].
        zeta: damping ratio.
        rest: begin at equilibrium under the first load; else at zero.
    """
    A = np.array([[0.0, 1.0], [-(wn**2), -2.0 * zeta * wn]])
    big = np.zeros((4, 4))
    big[:2, :2], big[1, 2], big[2, 3] = A * step, step, 1.0
    E = expm(big)
    Phi, G1 = E[:2, :2], E[:2, 3]
    G0 = E[:2, 2] - G1
    start = load[0] / wn**2 if rest else np.zeros(load.shape[1])
    x, v = _run(np.ascontiguousarray(load), Phi, G0, G1, start)
    return Response(x, v, load - 2.0 * zeta * wn * v - wn**2 * x)


def decay(n: int, step: float, wn: float, zeta: float) -> Response:
    """Return the free decays from a unit deflection and from a unit rate, (n, 2) each."""
    wd = wn * np.sqrt(1.0 - zeta**2)
    t = step * np.arange(n)
    envelope, c, s = np.exp(-zeta * wn * t), np.cos(wd * t), np.sin(wd * t)
    x = np.stack([envelope * (c + zeta * wn / wd * s), envelope * s / wd], axis=1)
    v = np.stack([-envelope * wn**2 / wd * s, envelope * (c - zeta * wn / wd * s)], axis=1)
    return Response(x, v, -2.0 * zeta * wn * v - wn**2 * x)


@compiled
def _run(load, Phi, G0, G1, start):  # type: ignore[no-untyped-def]
    n, k = load.shape
    x, v = np.empty((n, k)), np.empty((n, k))
    for j in range(k):
        p, r = start[j], 0.0
        x[0, j], v[0, j] = p, r
        for i in range(n - 1):
            a, b = load[i, j], load[i + 1, j]
            p, r = (
                Phi[0, 0] * p + Phi[0, 1] * r + G0[0] * a + G1[0] * b,
                Phi[1, 0] * p + Phi[1, 1] * r + G0[1] * a + G1[1] * b,
            )
            x[i + 1, j], v[i + 1, j] = p, r
    return x, v
