"""The orientation of an IMU from its log alone: quaternion and inclination on an even clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import LogError
from pinotwin.imu import rotation as rot
from pinotwin.imu.orientation import Method, orientation
from pinotwin.log import Log
from pinotwin.reconstruction.sensor_log import imu_run


@dataclass(frozen=True)
class Orientation:
    """Where a sensor pointed."""

    t: Floats  # time on the sensor's clock, even [s], shape (n,)
    q: Floats  # quaternions w, x, y, z from the sensor to the earth (z up), heading as at the start, (n, 4)
    inclination: Floats  # angle between the sensor's z axis and the vertical [rad], (n,)
    rate: float  # sampling rate [Hz]
    missing: float  # share of the samples that were interpolated over holes in the log
    force: Floats  # specific force along the sensor's axes [m/s²], (n, 3)
    remade: bool  # whether the clock was uneven and the log was interpolated to an even one

    def channels(self) -> dict[str, Floats]:
        """Return ``t, qw, qx, qy, qz, inclination``."""
        names = ("qw", "qx", "qy", "qz")
        return {"t": self.t, **dict(zip(names, self.q.T, strict=True)), "inclination": self.inclination}


def orientation_of_log(log: Log, method: Method = "vqf", *, hole: float = 3.5) -> Orientation:
    """Return the orientation over an IMU's log; LogError for a channel, clock or hole over 1 s that forbids it."""
    # On an even clock samples are the sensor's own means; else they are interpolated: instantaneous rates.
    run = imu_run(log)
    gaps = np.diff(run.t)
    step = float(np.median(gaps))
    if np.any(gaps <= 0.0):
        at = float(run.t[int(np.argmax(gaps <= 0.0))])
        raise LogError(
            f"{log.source}: t does not increase after {at:g} s; cut the log where its clock restarts"
        )
    if gaps.max() > max(1.0, hole * step):
        at = float(run.t[int(np.argmax(gaps))])
        raise LogError(f"{log.source}: a hole of {gaps.max():.3g} s after {at:g} s; cut the log there")
    remade = bool(np.ptp(gaps) >= 0.01 * step)
    t, gyr, acc, missing = run.t, run.gyr, run.acc, 0.0
    if remade:
        t = np.arange(run.t[0], run.t[-1], step)
        gyr, acc = (np.stack([np.interp(t, run.t, c) for c in x.T], axis=1) for x in (run.gyr, run.acc))
        k = np.clip(np.searchsorted(run.t, t), 1, len(run.t) - 1)
        missing = float(np.mean(gaps[k - 1] > hole * step))
    q = orientation(gyr, acc, 1.0 / step, method, rule="coning" if remade else "mean")
    up = rot.to_matrix(q)[:, 2, 2]
    return Orientation(t, q, np.arccos(np.clip(up, -1.0, 1.0)), 1.0 / step, missing, acc, remade)
