"""How large a signal is, how large the noise in it, and its colour.

x(t) = sum_k a_k x(t - k) + w(t), w white, over all stretches at once (Burg 1975; Kay 1988, chapter 7): stable.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pinotwin.arrays import Floats


def rms(x: Floats) -> float:
    """Return the root of the mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(x**2))) if len(x) else 0.0


def roughness(parts: Iterable[Floats]) -> float:
    """Return the standard deviation of the noise on a smooth signal (n,), from the median of third differences."""
    third = np.concatenate([np.zeros(0), *(np.abs(np.diff(x, 3)) for x in parts)])
    return float(1.4826 * np.median(third) / np.sqrt(20.0)) if len(third) else 0.0


def burg(stretches: Sequence[Floats], order: int) -> tuple[Floats, float]:
    """Return a_1 ... a_p, shape (<= order,), and the variance of w, common to stretches (m,) less their mean."""
    count = sum(len(x) for x in stretches)
    variance = sum(float(x @ x) for x in stretches) / max(count, 1)
    forward = [x[1:] for x in stretches if len(x) > 1]
    backward = [x[:-1] for x in stretches if len(x) > 1]
    a = np.zeros(0)
    for _ in range(order):
        cross = sum(float(f @ b) for f, b in zip(forward, backward, strict=True))
        power = sum(float(f @ f + b @ b) for f, b in zip(forward, backward, strict=True))
        pairs = sum(len(f) for f in forward)
        if power <= 0 or pairs < 4 * order:
            break
        r = 2 * cross / power
        a = np.concatenate([a - r * a[::-1], [r]])
        variance *= 1.0 - r * r
        new = [(f - r * b, b - r * f) for f, b in zip(forward, backward, strict=True)]
        forward = [f[1:] for f, _ in new if len(f) > 1]
        backward = [b[:-1] for _, b in new if len(b) > 1]
    return a, variance
