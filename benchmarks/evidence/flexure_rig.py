"""The virtual flexure rig: identified on one log of 20 s, another command of 20 s simulated; every axis counts.

As in the source, the vibration of the flexure comes from an IMU on the table while the log to fit is recorded
(`pinotwin vibration`); of the unseen log only the command is given. Five seeds by three friction laws that the model
does not hold; RMS error over RMS of tracking error and effort.
"""

from __future__ import annotations

import pinotwin as pt
from benchmarks.evidence import virtual
from benchmarks.evidence.store import Figure
from pinotwin.reconstruction import reconstruct_vibration, with_vibration
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.imu import record_imu

SEEDS = "50 to 54; unseen commands 1050 to 1054"
SLOW = True
TRUTH_RATE = 2000.0
"""Rate at which the IMU sees the true motion [Hz]."""


def figures() -> list[Figure]:
    """Measure."""
    return virtual.measure("flexure_rig", 5.54, _with_imu)


def _with_imu(rig: VirtualMachine, seed: int) -> pt.Log:
    """Return a servo log with the vibration that an IMU on the table shows."""
    run = rig.record(random_trajectory(rig, virtual.SECONDS, seed), seed=seed, truth_rate=TRUTH_RATE)
    log, imu = run.to_log(), record_imu(run.truth, "C_link", rig.truth.seed, seed)
    seen = reconstruct_vibration(pt.Machine.load("flexure_rig"), log, imu)
    return with_vibration(log, seen, row=True)
