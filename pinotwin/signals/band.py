"""The band in which a structure vibrates: slower is motion, faster is noise."""

from __future__ import annotations

import numpy as np
import scipy

from pinotwin.arrays import Floats

BAND = (1.0, 60.0)
"""[Hz]"""


def edge_rows(n: int, rate: float) -> int:
    """Return how many of n rows at either end :func:`vibration_band` cuts."""
    return min(round(0.5 * rate / BAND[0]), n // 8)


def vibration_band(x: Floats, rate: float) -> Floats:
    """Return signals (n, k) within the band, zero phase, ends cut.

    Args:
        x: an unbroken stretch.
        rate: of its sampling [Hz].
    """
    low, high = BAND
    sos = scipy.signal.butter(2, (low, min(high, 0.4 * rate)), "bandpass", fs=rate, output="sos")
    edge = edge_rows(len(x), rate)
    y = scipy.signal.sosfiltfilt(sos, x, axis=0, padlen=min(len(x) - 1, 3 * edge))
    return np.asarray(y[edge : len(x) - edge], dtype=float)
