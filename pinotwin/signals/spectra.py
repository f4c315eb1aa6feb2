"""Spectra, correlation, and the corner frequency that suits a recording.

**The corner.** The noise of a measured position is nearly white; in acceleration it grows with ``f^4`` while motion
dies out, so that the spectrum falls to a minimum and rises again. Where it has risen to twice that for good, there is
no motion left: the corner an axis asks for. Of several the highest is taken, unless the noise let through exceeded 1 %
of some axis' acceleration power: that share biases a coefficient (errors in variables), motion cut off costs only
information. Nor does it exceed twice the frequency below which the widest axis has 99.99 % of its acceleration power
(the filter passes 99.6 % there), unless that is above a fifth of the rate; 99 % of every axis' velocity power stays,
for friction. The second difference keeps slow motion out of weak high frequencies, means over half octaves keep lines
from being edges. The effort has no say: it may follow the position (ripple of the gears), which a corner would hide.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.errors import DataError


@dataclass(frozen=True)
class Spectrum:
    """One-sided power spectral density."""

    f: Floats  # frequency [Hz], (m,)
    density: Floats  # unit² / Hz, (m,) or (m, k)


def welch(
    x: Floats, rate: float, segments: Sequence[slice] | None = None, length: int | None = None
) -> Spectrum:
    """Return the power spectral density of ``x``, (n,) or (n, k), by Welch's method (Hann, half overlap, no trend).

    Stretches below ``length``, else an eighth of the longest within 64 to 8192, do not count; others by their length.
    """
    parts = [slice(0, len(x))] if segments is None else list(segments)
    longest = max((p.stop - p.start for p in parts), default=0)
    size = length or min(longest, int(np.clip(longest // 8, 64, 8192)))
    if longest < max(size, 16):
        raise DataError(
            f"the longest unbroken stretch has {longest} samples; a spectrum needs {max(size, 16)}"
        )
    total, weight, f = np.zeros(1), 0, np.empty(0)
    for part in parts:
        n = part.stop - part.start
        if n >= size:
            f, density = scipy.signal.welch(
                x[part], fs=rate, nperseg=size, detrend=_without_trend, axis=0, scaling="density"
            )
            total = total + density * n
            weight += n
    return Spectrum(f, total / weight)


def _without_trend(windows: Floats) -> Floats:
    """Return windows (..., m) without their straight lines: scipy's own detrend solves for each of them."""
    ramp = np.linspace(-1.0, 1.0, windows.shape[-1])
    slope = windows @ ramp / (ramp @ ramp)
    return windows - windows.mean(axis=-1, keepdims=True) - slope[..., None] * ramp


def suggest_cutoff(
    q: Floats, rate: float, segments: Sequence[slice] | None = None, *, margin: float = 2.0
) -> float:
    """Return the corner [Hz] for the acceleration of positions (n,) or (n, k), inf for none: the module's rule."""
    q = q[:, None] if q.ndim == 1 else q
    parts = [slice(0, len(q))] if segments is None else list(segments)
    parts = [p for p in parts if p.stop - p.start >= 34]
    if not parts:
        return np.inf
    second = np.concatenate([np.diff(q[p], 2, axis=0) for p in parts]) * rate**2
    bounds = np.cumsum([0, *(p.stop - p.start - 2 for p in parts)])
    inner = [slice(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
    moving = np.std(second, axis=0) > 0
    if not moving.any():
        return np.inf
    spectrum = welch(second[:, moving], rate, inner)
    asked = [_corner(spectrum.f, s, rate) for s in spectrum.density.T]
    known = [x for x in asked if x is not None]
    if not known:
        return np.inf
    wanted, bearable, needed, band = np.array(known).T
    corner = max(min(wanted.max(), bearable.min()), needed.max())
    if margin * band.max() < rate / 5.0:  # above, no row could be spared
        corner = min(corner, max(margin * band.max(), needed.max()))
    return np.inf if corner >= 0.45 * rate else float(corner)


def _corner(
    f: Floats,
    density: Floats,
    rate: float,
    bearable: float = 0.01,
    needed: float = 0.99,
    band: float = 0.9999,
) -> tuple[float, float, float, float] | None:
    """Return the corners that one axis asks for, can bear, and needs, and where its band ends; None at rest."""
    gain = (2.0 * np.sin(np.pi * f / rate) * rate) ** 4
    smooth = _half_octave_means(f, density)
    # Divided by f, the noise at the top of the band stays below the motion's own peak.
    peak = 1 + int(np.argmax(smooth[1:] / f[1:]))
    if peak >= len(f) // 2:
        return None
    least = peak + int(np.argmin(smooth[peak:]))
    end = int(np.flatnonzero(smooth <= 2.0 * smooth[least])[-1])
    drowns = end < len(f) - 2
    top = (f > 0.6 * rate / 2) & (f < 0.95 * rate / 2)
    noise = np.median(density[top] / gain[top]) * gain if drowns else 0.0 * gain
    motion = np.clip(density - noise, 0.0, None)
    too_much = np.flatnonzero(np.cumsum(noise) > bearable * motion[: least + 1].sum())
    speed = np.cumsum(motion[1 : least + 1] / f[1 : least + 1] ** 2)
    power = np.cumsum(motion[: least + 1])
    return (
        float(f[end]) if drowns else np.inf,
        float(f[too_much[0]]) if len(too_much) else np.inf,
        float(f[1 + np.searchsorted(speed, needed * speed[-1])]),
        float(f[np.searchsorted(power, band * power[-1])]) if drowns else np.inf,
    )


def _half_octave_means(f: Floats, density: Floats) -> Floats:
    total = np.r_[0.0, np.cumsum(density)]
    low = np.searchsorted(f, f / 2**0.25)
    high = np.searchsorted(f, f * 2**0.25, side="right")
    return np.asarray((total[high] - total[low]) / (high - low))


def autocorrelation(x: Floats, max_lag: int) -> Floats:
    """Return the autocorrelation at lags 0..max_lag, shape (max_lag + 1,), biased; DataError if that is undefined."""
    x = np.asarray(x, dtype=float) - np.mean(x)
    if len(x) <= max_lag or not x.any():
        raise DataError(f"autocorrelation to lag {max_lag} needs a longer signal that varies")
    if max_lag <= 8:  # no transform of the whole signal
        r = np.array([x[k:] @ x[: len(x) - k] for k in range(max_lag + 1)])
        return r / r[0]
    r = scipy.signal.correlate(x, x, method="fft")[len(x) - 1 : len(x) + max_lag]
    return np.asarray(r / r[0])
