"""The low-pass of an inertial sensor as the estimate takes it to be."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, cont2discrete, lfilter, lfilter_zi

from pinotwin.arrays import Floats


def low_pass(x: Floats, cutoff: float, step: float) -> Floats:
    """Return signals (n, k) after a second-order Butterworth low-pass that starts settled.

    Discretised for inputs that are linear between samples: a bilinear map would change the delay.

    Args:
        x: signals, one a column.
        cutoff: corner [Hz], inf for none.
        step: sampling interval [s].
    """
    if not np.isfinite(cutoff):
        return x
    analog = butter(2, 2.0 * np.pi * cutoff, analog=True)
    b, a, _ = cont2discrete(analog, step, method="foh")
    b = b.ravel()
    y, _ = lfilter(b, a, x, axis=0, zi=lfilter_zi(b, a)[:, None] * x[:1])
    return y
