"""An IMU's log: ``t, gx, gy, gz`` [rad/s] and ``ax, ay, az`` [m/s²] on the sensor's own clock."""

from __future__ import annotations

import numpy as np

from pinotwin.columns import IMU_SIGNALS
from pinotwin.errors import LogError, nearest
from pinotwin.imu.runs import ImuRun
from pinotwin.log import Log
from pinotwin.units import si_factor


def imu_run(log: Log, *, fastest: float = 70.0, gravity: tuple[float, float] = (5.0, 30.0)) -> ImuRun:
    """Return an IMU's log in SI, complete rows only; above ``fastest`` [rad/s], 4000 deg/s, its unit is wrong."""
    for name in ("t", *IMU_SIGNALS):
        if name not in log:
            raise LogError(
                f"{log.source}: no channel {name!r}; an IMU log has t, "
                f"{', '.join(IMU_SIGNALS)} (rad/s and m/s²); {nearest(name, log.channels)}"
            )
    x = np.stack([log[n] * si_factor(log.units.get(n, "1")) for n in ("t", *IMU_SIGNALS)], axis=1)
    x = x[np.isfinite(x).all(axis=1)]
    if len(x) < 50:
        raise LogError(f"{log.source}: only {len(x)} rows hold numbers; record longer")
    run = ImuRun(x[:, 0], x[:, 1:4], x[:, 4:])
    if float(np.abs(run.gyr).max()) > fastest:
        raise LogError(
            f"{log.source}: gx, gy, gz reach {np.abs(run.gyr).max():.3g}, too fast for rad/s; "
            "convert them, or write the unit in the header, e.g. gx [deg/s]"
        )
    force = float(np.median(np.linalg.norm(run.acc, axis=1)))
    if not gravity[0] < force < gravity[1]:
        raise LogError(
            f"{log.source}: ax, ay, az have a median size of {force:.3g}, not gravity in m/s²; "
            "convert them, or write the unit in the header, e.g. ax [g] (gravity must not be "
            "removed)"
        )
    return run
