"""An IMU on a virtual machine: its log on its own clock, from the machine's sealed truth (thesis Section 6.5).

Mounting and errors of the accelerometer are drawn once per machine; gyro scale, clock and noise from the run's seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, require
from pinotwin.log import Log
from pinotwin.virtual.imu_sensor import ImuReading, ImuSensor, LinkMotion, SensorClock, mti630
from pinotwin.virtual.recording import SealedTruth
from pinotwin.virtual.tree import links_of

RATE = 400.0  # sampling rate of the sensor [Hz]


def sensor(machine_seed: int, number: int, run_seed: int, **clock: object) -> ImuSensor:
    """Return MTi-630 1 or 2 with errors as in thesis Tables 6-3, 6-4, B-1, drawn by machine and run seeds."""
    place = np.random.default_rng([machine_seed, 630, number])
    run = np.random.default_rng([machine_seed, 631, number, run_seed])
    own = mti630(place, min(number, 2))
    faults = {"jitter": 1e-5, **clock}
    return replace(
        own,
        gyro=replace(own.gyro, scale=run.normal(0.0, 3e-3, 3)),
        mounting=Rotation.random(random_state=int(place.integers(1 << 31))).as_matrix(),
        position=np.array([*place.uniform(-0.08, 0.08, 2), 0.01]),
        clock=SensorClock(RATE, run.uniform(-3.0, 3.0), run.normal(0.0, 5e-5), **faults),  # type: ignore[arg-type]
    )


def link_motion(truth: SealedTruth, link: str) -> LinkMotion:
    """Return the true motion of a link; InputError if the machine has none of that name."""
    model, data = truth.model, truth.model.createData()
    require(link, links_of(model), "this machine has no link", InputError)
    frame, n = model.getFrameId(link, pin.FrameType.BODY), len(truth.t)
    R, w, a = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    for k, state in enumerate(zip(truth.q, truth.v, truth.a, strict=True)):
        pin.forwardKinematics(model, data, *state)
        R[k] = pin.updateFramePlacement(model, data, frame).rotation
        w[k] = pin.getFrameVelocity(model, data, frame, pin.LOCAL).angular
        a[k] = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).linear
    return LinkMotion(truth.t, R, w, a)


def channels(reading: ImuReading) -> Mapping[str, Floats]:
    """Return a reading as the channels of an IMU log."""
    names = ("gx", "gy", "gz", "ax", "ay", "az")
    columns = [*reading.gyr.T, *reading.acc.T]
    return {"t": reading.t, **dict(zip(names, columns, strict=True))}


def record_imu(
    truth: SealedTruth, link: str, machine_seed: int, run_seed: int, number: int = 1, **clock: object
) -> Log:
    """Return the log of a virtual IMU on a link; the truth is sampled well above the sensor's 400 Hz.

    Seeds and ``number`` are those of :func:`sensor`; ``clock``: its faults drop, holes, restart, jitter.
    """
    own = replace(
        sensor(machine_seed, number, run_seed, **clock), gravity=np.array(truth.model.gravity.linear)
    )
    rng = np.random.default_rng([machine_seed, 632, number, run_seed])
    reading = own.measure(link_motion(truth, link), rng)
    return Log(channels(reading), source=f"virtual imu{number} on {link} (seed {run_seed})")
