"""IMUs and repeats as one motion, weighted by information."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu.averaging import combine
from pinotwin.reconstruction.result import Motion3, Sensor

_KINDS = (("angle", "sd_angle"), ("velocity", "sd_velocity"), ("acceleration", "sd_acceleration"))


def of_run(run: int, t: Floats, sensors: Sequence[Sensor]) -> Motion3:
    """Return one run on its servo stamps (n,), all IMUs combined."""
    each = [_of_sensor(run, t, sensor) for sensor in sensors]
    return each[0] if len(each) == 1 else _mean(each)[0]


def _of_sensor(run: int, t: Floats, sensor: Sensor) -> Motion3:
    """Return what one IMU says at the log's stamps; NaN outside its stretches."""
    x = np.full((len(t), 6), np.nan)
    for part in sensor.runs:
        if part.run != run:
            continue
        f, rows = part.found, part.piece.rows
        columns = [getattr(f, name) for pair in zip(*_KINDS, strict=True) for name in pair]
        values = np.stack(columns, axis=1)
        on_grid = len(f.t) == len(rows) and np.allclose(f.t, part.piece.t, rtol=0.0, atol=1e-9)
        x[rows] = values if on_grid else CubicSpline(f.t, values)(part.piece.t)
    return Motion3(t, *x.T)


def combined(runs: Sequence[Motion3], delays: Sequence[float]) -> tuple[Motion3, Floats]:
    """Return the mean of repeats on the first one's clock, and the spread of q, v, a between them.

    The slow part of each angle differs by what its run could not observe; the mean weighs it alike.
    """
    first = runs[0]
    if len(runs) == 1:
        return first, np.full(3, np.nan)
    return _mean([first, *(_moved(r, d, first.t) for r, d in zip(runs[1:], delays[1:], strict=True))])


def _moved(run: Motion3, delay: float, t: Floats) -> Motion3:
    """Return a run at the stamps of the first one."""
    at = t + delay
    if len(at) == len(run.t) and np.allclose(at, run.t, rtol=0.0, atol=1e-9):
        return Motion3(t, run.q, run.v, run.a, run.sd_q, run.sd_v, run.sd_a)
    x = np.stack([run.q, run.v, run.a, run.sd_q, run.sd_v, run.sd_a], axis=1)
    good = run.known
    stamps = run.t[good]
    step = float(np.median(np.diff(stamps)))
    after = np.clip(np.searchsorted(stamps, at), 1, len(stamps) - 1)
    near = (stamps[after] - stamps[after - 1] < 1.5 * step) & (at >= stamps[0]) & (at <= stamps[-1])
    values = np.where(near[:, None], CubicSpline(stamps, x[good])(at), np.nan)
    return Motion3(t, *values.T)


def _mean(each: Sequence[Motion3]) -> tuple[Motion3, Floats]:
    """Return the mean of motions on one clock where all are known."""
    t = each[0].t
    known = np.all([m.known for m in each], axis=0)
    if known.sum() < 20:
        raise DataError("the runs share no stretch in which the deflection is known")
    x, spread = np.full((len(t), 6), np.nan), np.empty(3)
    for k, name in enumerate(("q", "v", "a")):
        values = [getattr(m, name)[known] for m in each]
        if name == "q":  # a constant angle cannot be observed; runs must not differ by it
            middle = np.mean([np.mean(v) for v in values])
            values = [v - np.mean(v) + middle for v in values]
        sd = [np.maximum(getattr(m, f"sd_{name}")[known], 1e-12) for m in each]
        found = combine(values, sd)
        x[known, k], x[known, k + 3], spread[k] = found.mean, found.sd, float(found.spread)
    return Motion3(t, *x.T), spread
