"""Spectra, correlation, and the corner frequency that suits a recording.

**The corner.** A measured position is motion plus a noise of its own (quantisation, interpolation
error of the encoder), nearly white. The acceleration is its second derivative: the noise grows
with ``f^4`` while the motion dies out, so that the acceleration's spectrum falls to a minimum and
rises again. Motion and noise are about equally strong at the minimum; where the spectrum has risen
to twice that for good, there is no motion left to win. That is the corner an axis asks for. Of
several axes the highest is taken, unless the noise let through would exceed 1 % of some axis'
acceleration power: noise in a regressor biases its coefficient by that share (errors in
variables), while motion cut off costs nothing but information, since the effort goes through the
same filter. Nor does the corner exceed twice the frequency below which the widest axis has
99.99 % of its acceleration power, where the filter still passes 99.6 %, unless that is above a fifth of the
rate: beyond there is nothing but noise of the effort.
Always 99 % of every axis' velocity power stays, for the friction's sake. The
spectrum is taken of the second difference, so that slow motion does not leak into weak high
frequencies, and averaged over half octaves, so that a line is no edge.
The effort has no say: where it does not follow the acceleration it may still follow the position (ripple of the
gears), and a corner below would hide that from every effect that might explain it.
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
    x: Floats,
    rate: float,
    segments: Sequence[slice] | None = None,
    length: int | None = None,
) -> Spectrum:
    """Return the power spectral density of ``x``, (n,) or (n, k), by Welch's method (Hann, half overlap, no trend).

    Stretches are averaged by their length; those below ``length`` samples, else an eighth of the longest within
    64 to 8192, are not used.
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
    """Return the corner [Hz] of the low-pass that suits the acceleration of positions (n,) or (n, k).

    See the module's docstring for the rule; ``margin`` is the corner over the end of the motion's band, at most. Axes
    that do not move have no say. Infinite if the motion reaches the Nyquist frequency (or nothing moves).
    """
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
    """Return the autocorrelation at lags 0..max_lag, shape (max_lag + 1,); biased, mean removed.

    Raises:
        DataError: the signal is constant or shorter than the lag.
    """
    x = np.asarray(x, dtype=float) - np.mean(x)
    if len(x) <= max_lag or not x.any():
        raise DataError(f"autocorrelation to lag {max_lag} needs a longer signal that varies")
    if max_lag <= 8:  # no transform of the whole signal
        r = np.array([x[k:] @ x[: len(x) - k] for k in range(max_lag + 1)])
        return r / r[0]
    r = scipy.signal.correlate(x, x, method="fft")[len(x) - 1 : len(x) + max_lag]
    return np.asarray(r / r[0])
