"""Dry friction with the memory of its bristles, as a function of position: what a healthy axis shows.

    dz = (dq - |dq| z) / s              Dahl 1968: the Coulomb level builds up over the distance s
    dw = |dq| (fade(v) z - w) / s       first-order response of LuGre to a level that fades with speed

Both are rate-independent, so encoder noise far below ``s`` cannot make them chatter, as ``sign`` of a
filtered velocity does (Canudas de Wit et al. 1995, doi:10.1109/9.376053).
"""

from __future__ import annotations

import numba
import numpy as np

from pinotwin.arrays import Floats
from pinotwin.motion import AxisMotion


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _scan(q: Floats, fade: Floats, s: float, z0: float) -> Floats:
    out = np.empty((len(q), 2))
    z, w = z0, z0 * fade[0]
    for k in range(len(q)):
        if k > 0:
            step = q[k] - q[k - 1]
            stay = np.exp(-abs(step) / s)
            target = 1.0 if step > 0.0 else -1.0
            w = z * fade[k] + (w - z * fade[k]) * stay
            z = target + (z - target) * stay
        out[k, 0] = z
        out[k, 1] = w
    return out


def bristles(motion: AxisMotion, s: float, fade: Floats | None = None) -> Floats:
    """Return the columns z and w, shape (n, 2).

    Args:
        motion: motion of one axis.
        s: presliding distance [m or rad].
        fade: fading of the level with speed, shape (n,); zero when None.
    """
    fade = np.zeros(len(motion.q)) if fade is None else fade
    out = np.zeros((len(motion.q), 2))
    for part in motion.segments:
        if part.stop <= part.start:
            continue
        q = np.ascontiguousarray(motion.q[part])
        start = float(np.sign(motion.v[part][0])) if len(q) else 0.0
        out[part] = _scan(q, np.ascontiguousarray(fade[part]), s, start)
    return out


def usual_distance(rotary: bool) -> float:
    """Return the presliding distance of an ordinary guide or bearing [m or rad]."""
    return 2e-5 if rotary else 5e-6
