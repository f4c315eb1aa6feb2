"""Inclination of an IMU alone, on four trials of BROAD (real, optical reference): RMS error while it moves.

`pinotwin orientation --method offline`, beside VQF (its default) and the source's filter, in the same run.
"""

from __future__ import annotations

import numpy as np
import scipy.io

from benchmarks.evidence.real import folder
from benchmarks.evidence.store import Figure
from pinotwin.imu import rotation
from pinotwin.imu.orientation import orientation

SEEDS = "none: recordings"
TRIALS = {"02": "slow_rotation", "07": "fast_rotation", "11": "slow_translation", "16": "fast_translation"}
METHODS = {"offline": "ours", "vqf": "VQF, offline", "ekf": "adaptive EKF"}


def figures() -> list[Figure]:
    """Measure."""
    data = folder("broad_imu")
    out = []
    for trial, words in TRIALS.items():
        m = scipy.io.loadmat(data / f"{trial}_undisturbed_{words}_B.mat")
        rate, moving = float(m["sampling_rate"].item()), m["movement"].ravel().astype(bool)
        for method, name in METHODS.items():
            q = orientation(m["imu_gyr"].astype(float), m["imu_acc"].astype(float), rate, method)  # type: ignore[arg-type]
            error = rotation.inclination_error(q, m["opt_quat"].astype(float))
            value = float(np.degrees(np.sqrt(np.nanmean(error[moving] ** 2))))
            what = f"{name}, {words.replace('_', ' ')}"
            out.append(Figure(f"{method}_{trial}", what, value, "deg", "development"))
    return out
