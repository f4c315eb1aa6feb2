"""How large a signal is, and how large the noise in it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pinotwin.arrays import Floats


def rms(x: Floats) -> float:
    """Return the root of the mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(x**2))) if len(x) else 0.0


def roughness(parts: Iterable[Floats]) -> float:
    """Return the standard deviation of the noise on a smooth signal, quantisation included.

    From third differences, in which motion is small beside noise; by their median, which jerks do not
    move.

    Args:
        parts: unbroken stretches of the signal, each of shape (n,).
    """
    third = np.concatenate([np.zeros(0), *(np.abs(np.diff(x, 3)) for x in parts)])
    return float(1.4826 * np.median(third) / np.sqrt(20.0)) if len(third) else 0.0
