"""What the sensor of an effort adds: noise, colour, scale, lag, quantisation."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.virtual.axis_truth import EffortSensor


def measured_effort(
    t: Floats, u: Floats, sensor: EffortSensor, rate: float, rng: np.random.Generator | None
) -> Floats:
    """Return the effort as logged at ``rate`` [Hz], shape (n,); without ``rng`` no noise and no quantisation."""
    out = sensor.scale * (np.interp(t - sensor.lag, t, u) if sensor.lag else u)
    if rng is None:
        return np.array(out)
    out = out + rng.normal(0.0, sensor.white or 0.0, len(t))
    # First-order low-passed noise that is stationary from its first sample.
    phi, rms = np.exp(-2.0 * np.pi * sensor.corner / rate), sensor.coloured or 0.0
    shocks = rng.normal(0.0, rms * np.sqrt(1.0 - phi * phi), len(t))
    shocks[:1] = rng.normal(0.0, rms, len(t[:1]))
    out = out + np.asarray(lfilter([1.0], [1.0, -phi], shocks))
    step = sensor.resolution or 0.0
    return step * np.round(out / step) if step > 0.0 else out
