"""The table of methods: naive integration, high-passed, adaptive EKF, VQF and the batch estimate.

No truth is at hand on a machine. The slow RMS of a method's angle shows its drift; with two IMUs
the table also says by how much their results differ, which is the source's own measure (0.0474
deg/s and 7.33 deg/s² after 22 repeats; angles +-0.04 deg).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.imu.baselines import baselines
from pinotwin.imu.reconstruct import high_passed
from pinotwin.imu.result import CORNER
from pinotwin.imu.runs import Priors
from pinotwin.reconstruction.result import MethodRow, Sensor, SensorRun
from pinotwin.signals import rms


def methods(sensors: Sequence[Sensor], prior: Priors) -> tuple[MethodRow, ...]:
    """Return the table for the first run."""
    each = [_signals(sensor.runs[0], prior) for sensor in sensors]
    out = []
    for name, first in each[0].items():
        differ = np.full(4, np.nan)
        if len(each) > 1 and first[0].shape == each[1][name][0].shape:
            differ = np.array([rms(a - b) for a, b in zip(first, each[1][name], strict=True)])
        slow, dynamic, velocity, acceleration = (rms(x) for x in first)
        out.append(MethodRow(name, slow, dynamic, velocity, acceleration, differ))
    return tuple(out)


def _signals(part: SensorRun, prior: Priors) -> Mapping[str, tuple[Floats, ...]]:
    """Return slow angle, dynamic angle, velocity and acceleration by method."""
    delay = float(np.sqrt(2.0) / (2.0 * np.pi * prior.gyro_cutoff))
    found = baselines(part.piece.run, part.imu, part.found.clock, delay)
    t = part.piece.run.t
    out = {
        name: _split(t, d.angle[:, 0], d.velocity[:, 0], d.acceleration[:, 0]) for name, d in found.items()
    }
    best = part.found
    out["batch"] = _split(best.t, best.angle, best.velocity, best.acceleration)
    return out


def _split(t: Floats, q: Floats, v: Floats, a: Floats) -> tuple[Floats, ...]:
    fast = high_passed(t, q, CORNER)
    return q - np.mean(q) - fast, fast, v, a
