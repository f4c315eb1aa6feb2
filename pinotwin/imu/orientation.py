"""Orientation from a gyroscope and an accelerometer: one door to four estimators."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, require
from pinotwin.imu import rotation as rot
from pinotwin.imu.ekf import ekf, offline_orientation

Method = Literal["ekf", "smoother", "vqf", "offline"]


def orientation(
    gyr: Floats, acc: Floats, rate: float, method: Method = "vqf", *, rule: rot.Rule = "mean"
) -> Floats:
    """Return quaternions (n, 4), sensor to earth (z up), heading as at the start, from rates [rad/s] and forces [m/s²].

    ``method`` is "vqf" (offline; Laidig and Seel 2023, doi:10.1016/j.inffus.2022.10.014), "offline" our smoother, "ekf"
    the adaptive filter (thesis Fig. 6-5) or "smoother" its two-way form. DataError for arrays that are of no use.
    """
    gyr, acc = np.ascontiguousarray(gyr, dtype=float), np.ascontiguousarray(acc, dtype=float)
    if gyr.shape != acc.shape or gyr.ndim != 2 or gyr.shape[1] != 3:
        raise DataError(f"gyr {gyr.shape} and acc {acc.shape} must both be (n, 3)")
    if not (np.isfinite(gyr).all() and np.isfinite(acc).all()):
        raise DataError("gyr or acc holds NaN or infinity; fill the holes first")
    require(method, get_args(Method), "unknown method", DataError)
    if method == "offline":
        return offline_orientation(gyr, acc, rate, rule=rule)
    if method in ("ekf", "smoother"):
        return ekf(gyr, acc, rate, smooth=method == "smoother", rule=rule)[0]
    from vqf import offlineVQF

    if rule != "mean":
        gyr = np.concatenate([gyr[:1], rot.increments(gyr, 1.0 / rate, rule) * rate])
    return np.asarray(offlineVQF(np.ascontiguousarray(gyr), acc, None, 1.0 / rate)["quat6D"])
