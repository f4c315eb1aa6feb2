"""The low-pass of an inertial sensor as the estimate takes it to be, and the part of an angle that is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import butter, cont2discrete, lfilter, lfilter_zi, sosfiltfilt

from pinotwin.arrays import Floats
from pinotwin.errors import DataError


def group_delay(cutoff: float) -> float:
    """Return by how much :func:`low_pass` delays what is slow [s]; ``cutoff`` [Hz]."""
    return float(np.sqrt(2.0) / (2.0 * np.pi * cutoff))


def low_pass(x: Floats, cutoff: float, step: float) -> Floats:
    """Return signals (n, k) after a second-order Butterworth low-pass [Hz], inf for none, that starts settled."""
    return driven(butter(2, 2.0 * np.pi * cutoff, analog=True), x, step) if np.isfinite(cutoff) else x


def driven(system: tuple[Sequence[float], Sequence[float]], x: Floats, step: float) -> Floats:
    """Return what a system in s makes of signals (n, k), settled, linear between samples ``step`` [s] apart."""
    b, a, _ = cont2discrete(system, step, method="foh")
    b = b.ravel()
    y, _ = lfilter(b, a, x, axis=0, zi=lfilter_zi(b, a)[:, None] * x[:1])
    return np.asarray(y)


def high_passed(t: Floats, angle: Floats, corner: float = 0.5) -> Floats:
    """Return angles (n, ...) without what is slower than ``corner`` [Hz], zero phase; DataError if too short.

    Above its default lies the dynamic band.
    """
    step = float(np.median(np.diff(t)))
    if len(t) * step * corner < 2.0:
        raise DataError(f"a record of {len(t) * step:.2g} s is too short for a {corner} Hz corner")
    sos = butter(2, corner, "highpass", fs=1.0 / step, output="sos")
    pad = min(len(t) - 1, round(1.0 / (corner * step)))
    return sosfiltfilt(sos, angle - np.mean(angle, axis=0), axis=0, padlen=pad)
