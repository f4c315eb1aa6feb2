"""A servo log of two axes from plain formulas: a slide Y and a table A that tilts on it.

With the table's first moment ``s`` below its axis, its angle q and the slide's position y:

    u_Y = M y'' + s (cos(q) q'' - sin(q) q'^2) + friction,    u_A = I q'' + s cos(q) y'' + s g sin(q) + friction
"""

from __future__ import annotations

import numpy as np

MASS, INERTIA, MOMENT = 90.0, 2.4, 1.1
FRICTION = {"Y": (180.0, 25.0), "A": (1.5, 0.8)}
_G = 9.81


def servo_log(seconds: float = 10.0, rate: float = 250.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Return ``t``, ``<axis>.qr .q .v .u`` in SI."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    (y, vy, ay), (q, vq, aq) = (_motion(t, size, rng) for size in (0.09, 0.5))
    efforts = {
        "Y": MASS * ay + MOMENT * (np.cos(q) * aq - np.sin(q) * vq**2),
        "A": INERTIA * aq + MOMENT * np.cos(q) * ay + MOMENT * _G * np.sin(q),
    }
    out = {"t": t}
    for axis, x, v in (("Y", y, vy), ("A", q, vq)):
        viscous, dry = FRICTION[axis]
        out[f"{axis}.qr"] = x + 1e-4 * v
        out[f"{axis}.q"] = x + 2e-7 * rng.normal(size=len(t))
        out[f"{axis}.v"] = v
        noise = 0.01 * np.std(efforts[axis]) * rng.normal(size=len(t))
        out[f"{axis}.u"] = efforts[axis] + viscous * v + dry * np.tanh(v / 1e-3) + noise
    return out


def _motion(
    t: np.ndarray, size: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position, velocity and acceleration of a sum of five sines."""
    w = 2 * np.pi * 0.4 * np.arange(1, 6)[:, None]
    c = size * rng.uniform(0.3, 1.0, 5)[:, None] / np.arange(1, 6)[:, None]
    angle = w * t + rng.uniform(0, 2 * np.pi, 5)[:, None]
    x, v, a = c * np.sin(angle), c * w * np.cos(angle), -c * w**2 * np.sin(angle)
    return x.sum(0), v.sum(0), a.sum(0)
