"""The honest test: an IMU that was not used must read what the deflection found by another implies.

Clock, mounting and place are from its own estimate; scale, cross-axis terms and bias (12 numbers) from its readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.imu.noise import rest
from pinotwin.imu.result import predict_readings
from pinotwin.imu.runs import Priors
from pinotwin.reconstruction.result import Sensor, SensorRun, Unused


def unused(sensors: Sequence[Sensor], prior: Priors) -> tuple[Unused, ...]:
    """Return the test for every ordered pair of IMUs on one link; none for a single IMU."""
    return tuple(_pair(a, b, prior) for a in sensors for b in sensors if a is not b and a.link == b.link)


def _pair(fitted: Sensor, other: Sensor, prior: Priors) -> Unused:
    rows = []
    for mine in fitted.runs:
        for theirs in other.runs:
            if theirs.run == mine.run and np.array_equal(theirs.piece.rows, mine.piece.rows):
                rows.append(_one(mine, theirs, other, prior))
    x = np.square(rows)
    count = np.isfinite(x).sum(axis=0)  # the noise is unknown where no log has a rest
    mean = np.where(count > 0, np.nansum(x, axis=0) / np.maximum(count, 1), np.nan)
    return Unused(fitted.name, other.name, *np.sqrt(mean))


def _one(mine: SensorRun, theirs: SensorRun, other: Sensor, prior: Priors) -> list[float]:
    """Return gyro (left, rigid, noise) and accelerometer (left, rigid, noise)."""
    shared = other.batch.shared
    own, place = replace(prior, gravity=shared("gravity")[0]), shared("position")[0]
    none = 0.0 * mine.found.t
    still = replace(mine.found, angle=none, velocity=none, acceleration=none)
    predicted = [
        predict_readings(mine.piece.run, theirs.imu, found, other.batch.R_ST, place, theirs.found.clock, own)
        for found in (mine.found, still)
    ]
    at, t = theirs.found.clock.to_ref(theirs.imu.t), mine.piece.run.t
    inside = np.isfinite(at) & (at > t[0] + 0.02) & (at < t[-1] - 0.02)  # the stamps of a prediction
    rate = 1.0 / float(np.median(np.diff(theirs.imu.t)))
    quiet = rest(theirs.imu.gyr, theirs.imu.acc, rate)
    out = []
    for k, y in enumerate((theirs.imu.gyr, theirs.imu.acc)):
        out += [_left(y[inside], p[k]) for p in predicted]
        out.append(_noise(y, quiet))
    return out


def _noise(y: Floats, quiet: Mask, window: int = 40) -> float:
    """Return the standard deviation per axis in the quieter windows at rest, NaN without a rest."""
    count = len(y) // window
    windows = y[: count * window].reshape(count, window, -1)
    still = quiet[: count * window].reshape(count, window).all(axis=1)
    if not still.any():
        return float("nan")
    return float(np.sqrt(np.quantile(np.var(windows[still], axis=1).mean(axis=1), 0.25)))


def _left(y: Floats, predicted: Floats) -> float:
    """Return the RMS per axis of readings less what is affine in the prediction."""
    X = np.hstack([predicted, np.ones((len(predicted), 1))])
    e = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    return float(np.sqrt(np.mean(e**2)))
