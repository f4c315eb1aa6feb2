"""The part of a deflection that is fast enough to be seen, and the frame of its joint."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from pinotwin.arrays import Floats
from pinotwin.errors import DataError


def high_passed(t: Floats, angle: Floats, corner: float) -> Floats:
    """Return angles (n, ...) without what is slower than ``corner`` [Hz], zero phase, fourth order.

    Raises:
        DataError: the record is too short for that corner.
    """
    step = float(np.median(np.diff(t)))
    if len(t) * step * corner < 2.0:
        raise DataError(f"a record of {len(t) * step:.2g} s is too short for a {corner} Hz corner")
    sos = butter(2, corner, "highpass", fs=1.0 / step, output="sos")
    pad = min(len(t) - 1, round(1.0 / (corner * step)))
    return sosfiltfilt(sos, angle - np.mean(angle, axis=0), axis=0, padlen=pad)


def joint_frame(axis: Floats) -> Floats:
    """Return a right-handed frame (columns) whose first axis is ``axis``."""
    x = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(helper, x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)
