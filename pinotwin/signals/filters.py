"""Zero-phase low-pass, differentiation, and decimation of uniformly sampled signals.

Run forward and backward a filter has no phase (Gustafsson 1996, doi:10.1109/78.492552), ``|H(f)|^2``, -6 dB at its
corner, as MATLAB's ``filtfilt``. Every signal of one regression goes through the same one: ``effort = columns @ theta``
still holds, up to the products of the motion (Gautier 1997; Janot, Gautier & Brunot 2019).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError

_butterworth = lru_cache(scipy.signal.butter)
Segments = Sequence[slice] | None
BAND = (1.0, 60.0)  # in which a structure vibrates: slower is motion, faster is noise [Hz]


def low_pass(x: Floats, rate: float, cutoff: float, order: int = 4, segments: Segments = None) -> Floats:
    """Return ``x``, (n,) or (n, k), low-passed without phase, stretch by stretch; corner in [Hz], infinite for none."""
    if not cutoff > 0 or order < 1:
        raise DataError(f"low-pass: corner {cutoff} Hz and order {order} must be above 0")
    x = np.asarray(x, dtype=float)
    if cutoff >= rate / 2:
        return x.copy()
    return _both_ways(x, _butterworth(order, cutoff, fs=rate, output="sos"), order, segments)


def _both_ways(x: Floats, sos: Floats, order: int, segments: Segments) -> Floats:
    """Filter each stretch of x, (n, ...), both ways, extended by odd reflection over 3 * order samples."""
    pad, out, moving = 3 * order, x.copy(), x.any(axis=0)
    for part in _stretches(x, segments):
        if len(x[part]) <= pad:
            raise DataError(
                f"a stretch of {len(x[part])} samples is too short for a filter of order {order}, "
                f"which needs {pad + 1}; leave it out or lower the order"
            )
        out[part][:, moving] = scipy.signal.sosfiltfilt(sos, x[part][:, moving], axis=0, padlen=pad)
    return out


def _stretches(x: Floats, segments: Segments) -> Sequence[slice]:
    return (slice(0, len(x)),) if segments is None else segments


def differentiate(x: Floats, step: float, segments: Segments = None) -> Floats:
    """Return the time derivative of ``x``, (n,) or (n, k), by central differences; ``step`` [s]; NaN outside."""
    x = np.asarray(x, dtype=float)
    out = np.full_like(x, np.nan)
    for part in _stretches(x, segments):
        if len(x[part]) < 2:
            raise DataError("a stretch of one sample has no derivative; leave it out")
        out[part] = np.gradient(x[part], step, axis=0)
    return out


def derivatives(
    x: Floats, rate: float, cutoff: float = np.inf, order: int = 4, segments: Segments = None
) -> tuple[Floats, Floats, Floats]:
    """Return the filtered signal and its first and second derivative, repeated central differences of it."""
    smooth = low_pass(x, rate, cutoff, order, segments)
    first = differentiate(smooth, 1.0 / rate, segments)
    return smooth, first, differentiate(first, 1.0 / rate, segments)


def decimate_zero_phase(x: Floats, factor: int, segments: Segments = None) -> Floats:
    """Return every ``factor``-th sample of the stretches of ``x``, (n,) or (n, k), low-passed, as MATLAB ``decimate``.

    Chebyshev I of order 8, 0.05 dB ripple, corner 0.8 of the new Nyquist frequency, both ways; the last sample is kept.
    """
    if factor < 1:
        raise DataError(f"decimation by {factor}: the factor must be a whole number from 1")
    x = np.asarray(x, dtype=float)
    if factor == 1:
        return np.concatenate([x[part] for part in _stretches(x, segments)])
    sos = scipy.signal.cheby1(8, 0.05, 0.8 / factor, output="sos")
    smooth = _both_ways(x, sos, 8, segments)
    parts = [smooth[part] for part in _stretches(x, segments)]
    return np.concatenate([part[(len(part) - 1) % factor :: factor] for part in parts])


def edge_samples(cutoff: float, rate: float, order: int = 4) -> int:
    """Return how many samples at each end of a stretch the filter's slowest pole needs to fall to 1 % ([Hz])."""
    if not math.isfinite(cutoff) or cutoff >= rate / 2:
        return 2
    _, poles, _ = scipy.signal.butter(order, cutoff, fs=rate, output="zpk")
    return math.ceil(math.log(0.01) / math.log(np.abs(poles).max())) + 2


def interior(n: int, edge: int, segments: Segments = None) -> Mask:
    """Return which of ``n`` rows are at least ``edge`` samples inside their stretch."""
    keep = np.zeros(n, dtype=bool)
    for part in _stretches(keep, segments):
        keep[part.start + edge : max(part.start + edge, part.stop - edge)] = True
    return keep


def edge_rows(n: int, rate: float) -> int:
    """Return how many of n rows at either end :func:`vibration_band` cuts."""
    return min(round(0.5 * rate / BAND[0]), n // 8)


def vibration_band(x: Floats, rate: float) -> Floats:
    """Return signals (n, k) of an unbroken stretch within the band, zero phase, ends cut; ``rate`` in [Hz]."""
    low, high = BAND
    sos = scipy.signal.butter(2, (low, min(high, 0.4 * rate)), "bandpass", fs=rate, output="sos")
    edge = edge_rows(len(x), rate)
    y = scipy.signal.sosfiltfilt(sos, x, axis=0, padlen=min(len(x) - 1, 3 * edge))
    return np.asarray(y[edge : len(x) - edge], dtype=float)
