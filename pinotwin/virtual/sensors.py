"""What the sensors add: noise, colour, scale, lag, quantisation."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.virtual.axis_truth import EffortSensor


def coloured_noise(n: int, rms: float, corner: float, rate: float, rng: np.random.Generator) -> Floats:
    """Return first-order low-passed noise that is stationary from its first sample, shape (n,).

    Args:
        n: samples.
        rms: standard deviation.
        corner: corner frequency [Hz].
        rate: sampling rate [Hz].
        rng: source of the numbers.
    """
    phi = np.exp(-2.0 * np.pi * corner / rate)
    shocks = rng.normal(0.0, rms * np.sqrt(1.0 - phi * phi), n)
    if n:
        shocks[0] = rng.normal(0.0, rms)
    return np.asarray(lfilter([1.0], [1.0, -phi], shocks))


def measured_effort(
    t: Floats, u: Floats, sensor: EffortSensor, rate: float, rng: np.random.Generator | None
) -> Floats:
    """Return the effort as logged, shape (n,).

    Args:
        t: times of the log [s], shape (n,).
        u: true effort at those times, shape (n,).
        sensor: what the sensor does.
        rate: log rate [Hz].
        rng: source of the noise; None for no noise and no quantisation.
    """
    out = sensor.scale * (np.interp(t - sensor.lag, t, u) if sensor.lag else u)
    if rng is None:
        return np.array(out)
    out = out + rng.normal(0.0, sensor.white or 0.0, len(t))
    out = out + coloured_noise(len(t), sensor.coloured or 0.0, sensor.corner, rate, rng)
    step = sensor.resolution or 0.0
    return step * np.round(out / step) if step > 0.0 else out
