"""Repeats of one command: how far one servo log lies behind another, and whether it is a repeat."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu.clock import best_lag
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.signals import rms


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
