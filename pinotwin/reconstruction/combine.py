"""IMUs and repeats as one motion, weighted by information, 1 / (s_r² + scatter²); how far a repeat lies behind.

A mean of n runs (thesis Eq. 6.11, Table 6-5) does not lower what each run has of its own, such as a scale error: the
scatter, by moments (DerSimonian and Laird 1986, 10.1016/0197-2456(86)90046-2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu.clock import best_lag
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.reconstruction.result import Motion3, Sensor
from pinotwin.signals import rms


def combine(runs: Sequence[Floats], sd: Sequence[Floats]) -> tuple[Floats, Floats, Floats]:
    """Return the mean of runs (n, ...), weighted by their errors, its own standard deviation, and that between runs."""
    if len(runs) < 2 or len({np.shape(r) for r in runs}) != 1:
        raise DataError("averaging needs at least two runs of one length, on one clock")
    x = np.stack([np.asarray(r, dtype=float) for r in runs])
    s2 = np.stack([np.mean(np.broadcast_to(s, x.shape[1:]) ** 2, axis=0) for s in sd])
    if len(s2) != len(x) or not np.all(s2 > 0.0):
        raise DataError("every run needs a positive standard deviation")
    w = 1.0 / s2
    mean = np.sum((w / w.sum(axis=0))[:, None] * x, axis=0)
    cochran = np.mean(np.sum(w[:, None] * (x - mean) ** 2, axis=0), axis=0)
    scatter = (cochran - (len(x) - 1)) / (w.sum(axis=0) - (w**2).sum(axis=0) / w.sum(axis=0))
    w = 1.0 / (s2 + np.maximum(scatter, 0.0))
    mean = np.sum((w / w.sum(axis=0))[:, None] * x, axis=0)
    spread = np.sqrt(np.mean((x - mean) ** 2, axis=(0, 1)) * len(x) / (len(x) - 1))
    sd_mean = np.broadcast_to(1.0 / np.sqrt(w.sum(axis=0)), mean.shape)
    return mean, np.array(sd_mean), np.asarray(spread)


def of_run(run: int, t: Floats, sensors: Sequence[Sensor]) -> Motion3:
    """Return one run on its servo stamps (n,), all IMUs combined."""
    return _mean([_of_sensor(run, t, sensor) for sensor in sensors])[0]


def _of_sensor(run: int, t: Floats, sensor: Sensor) -> Motion3:
    """Return what one IMU says at the log's stamps; NaN outside its stretches."""
    x = np.full((len(t), 6), np.nan)
    for part in sensor.runs:
        if part.run != run:
            continue
        f = part.found
        columns = f.angle, f.velocity, f.acceleration, f.sd_angle, f.sd_velocity, f.sd_acceleration
        stamps = np.clip(part.piece.t, f.t[0], f.t[-1])  # its ends are those of the log, but for rounding
        x[part.piece.rows] = at_stamps(stamps, f.t, np.stack(columns, axis=1), bridged=np.inf)
    return Motion3(t, *x.T)


def combined(runs: Sequence[Motion3], delays: Sequence[float]) -> tuple[Motion3, Floats]:
    """Return the mean of repeats on the first one's clock, and the spread of q, v, a between them."""
    first = runs[0]
    each = [first]
    for run, delay in zip(runs[1:], delays[1:], strict=True):
        x = np.stack([run.q, run.v, run.a, run.sd_q, run.sd_v, run.sd_a], axis=1)
        each.append(Motion3(first.t, *at_stamps(first.t + delay, run.t, x, bridged=1.5).T))
    return _mean(each)


def at_stamps(t: Floats, source: Floats, x: Floats, *, bridged: float) -> Floats:
    """Return signals (n, ...) with stamps ``source`` at stamps t [s], (m,), by splines, NaN in a hole."""
    if len(t) == len(source) and np.allclose(t, source, rtol=0.0, atol=1e-9):
        return x
    good = np.isfinite(source) & np.isfinite(x.reshape(len(x), -1)).all(axis=1)
    if good.sum() < 4:
        return np.full((len(t), *x.shape[1:]), np.nan)
    stamps = source[good]
    after = np.clip(np.searchsorted(stamps, t), 1, len(stamps) - 1)
    near = stamps[after] - stamps[after - 1] <= bridged * np.median(np.diff(stamps))
    near |= t == stamps[after]  # the first row behind a hole
    near &= (t >= stamps[0]) & (t <= stamps[-1])
    return np.where(near.reshape(-1, *[1] * (x.ndim - 1)), CubicSpline(stamps, x[good])(t), np.nan)


def _mean(each: Sequence[Motion3]) -> tuple[Motion3, Floats]:
    """Return the mean of motions on one clock where all are known, and their spread; one alone is itself."""
    if len(each) == 1:
        return each[0], np.full(3, np.nan)
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
        x[known, k], x[known, k + 3], spread[k] = combine(values, sd)
    return Motion3(t, *x.T), spread


def delay(machine: Machine, reference: Log, other: Log, same: float = 0.02) -> float:
    """Return the time that passes in ``other`` before it shows what ``reference`` shows [s], both bound logs."""
    (ta, a), (tb, b) = _positions(machine, reference), _positions(machine, other)
    step = float(np.median(np.diff(ta)))
    grid, early, late = np.arange(ta[0], ta[-1], step), CubicSpline(ta, a), CubicSpline(tb, b)
    speeds = early(grid, 1), late(np.arange(tb[0], tb[-1], step), 1)
    lag, _ = best_lag(*(np.linalg.norm(v, axis=1) for v in speeds))
    shift = float(tb[0] - ta[0] - lag * step)
    for _ in range(7):
        t = grid[(grid + shift > tb[0]) & (grid + shift < tb[-1])]
        if len(t) < 0.5 * len(grid):
            gap = np.inf
            break
        e, slope = early(t) - late(t + shift), late(t + shift, 1)
        gap = rms(e)
        shift += float(np.clip(np.sum(slope * e) / np.sum(slope**2), -0.01, 0.01))
    if gap > same:
        raise DataError(
            f"{other.source} is not a repeat of {reference.source} (their commands differ by "
            f"{min(gap, 9.99):.0%} of the motion); reconstruct them one by one"
        )
    return shift


def _positions(machine: Machine, log: Log) -> tuple[Floats, Floats]:
    """Return stamps and the commands, else the positions, each over its RMS variation."""
    kind = "qr" if all(f"{name}.qr" in log for name in machine.axes) else "q"
    x = np.stack([log[f"{name}.{kind}"] for name in machine.axes], axis=1)
    good = np.isfinite(x).all(axis=1) & np.isfinite(log.t)
    t, x = log.t[good], x[good]
    forward = np.concatenate([[True], np.diff(np.maximum.accumulate(t)) > 0])
    t, x = t[forward], x[forward]
    size = np.std(x, axis=0)
    moves = size > 1e-9
    return t, (x[:, moves] - x[:, moves].mean(axis=0)) / size[moves] / np.sqrt(max(moves.sum(), 1))
