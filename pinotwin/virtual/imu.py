"""An IMU on a virtual machine: its log on its own clock, from the machine's sealed truth.

What belongs to the sensor and its place (mounting, non-orthogonality, g-sensitivity, errors of the
accelerometer) is drawn once per machine and sensor; what changes from run to run (gyro scale, clock
offset and skew, noise) is drawn from the run's seed (thesis Section 6.5).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, nearest
from pinotwin.log import Log
from pinotwin.virtual.imu_sensor import ImuReading, ImuSensor, LinkMotion, SensorClock, mti630
from pinotwin.virtual.recording import SealedTruth

RATE = 400.0
"""Sampling rate of the sensor [Hz]."""


def sensor(machine_seed: int, number: int, run_seed: int, **clock: object) -> ImuSensor:
    """Return an MTi-630 on a table with errors of the size of thesis Tables 6-3, 6-4 and B-1.

    Args:
        machine_seed: draws what belongs to the sensor and its place.
        number: 1 or 2, the two sensors of the thesis; more are copies of the second.
        run_seed: draws what changes from run to run.
        clock: faults of the clock, see :class:`pinotwin.virtual.imu_sensor.SensorClock`.
    """
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
    """Return the true motion of a link, all samples at once.

    Raises:
        InputError: the machine has no such link.
    """
    if link not in truth.links:
        raise InputError(f"no link {link!r} in this machine; {nearest(link, truth.links)}")
    joint, rotation, offset = truth.links[link]
    tree, n = truth.tree, len(truth.t)
    R = np.broadcast_to(np.eye(3), (n, 3, 3))
    w, dw, a = (np.zeros((n, 3)) for _ in range(3))  # in the axes of the body
    for j in _path(tree.parent, joint):
        arm, turn = tree.offset[j], tree.placement[j]
        q, v, qdd = truth.q[:, j, None], truth.v[:, j, None], truth.a[:, j, None]
        axis = tree.axis[j]
        rotary = bool(tree.rotary[j])
        arm = arm + (0.0 if rotary else q * (turn @ axis))
        a = a + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        E = turn @ Rotation.from_rotvec(q * axis).as_matrix() if rotary else turn[None]
        R = R @ E
        w, dw, a = (np.einsum("nji,nj->ni", np.broadcast_to(E, (n, 3, 3)), x) for x in (w, dw, a))
        if rotary:
            dw = dw + qdd * axis + np.cross(w, v * axis)
            w = w + v * axis
        else:
            a = a + qdd * axis + 2.0 * np.cross(w, v * axis)
    a = a + np.cross(dw, offset) + np.cross(w, np.cross(w, offset))
    return LinkMotion(truth.t, R @ rotation, w @ rotation, a @ rotation)


def _path(parent: np.ndarray, joint: int) -> list[int]:
    """Return the joints from the base to ``joint``."""
    out = []
    while joint >= 0:
        out.append(int(joint))
        joint = int(parent[joint])
    return out[::-1]


def channels(reading: ImuReading) -> Mapping[str, Floats]:
    """Return a reading as the channels of an IMU log."""
    names = ("gx", "gy", "gz", "ax", "ay", "az")
    columns = [*reading.gyr.T, *reading.acc.T]
    return {"t": reading.t, **dict(zip(names, columns, strict=True))}


def record_imu(
    truth: SealedTruth,
    link: str,
    machine_seed: int,
    run_seed: int,
    number: int = 1,
    **clock: object,
) -> Log:
    """Return the log of a virtual IMU on a link of a virtual machine.

    Args:
        truth: of a recording, sampled well above the sensor's 400 Hz.
        link: the link that carries the sensor.
        machine_seed: see :func:`sensor`.
        run_seed: likewise.
        number: which sensor.
        clock: faults of its clock: ``drop``, ``holes``, ``restart``, ``jitter``.
    """
    own = replace(sensor(machine_seed, number, run_seed, **clock), gravity=truth.tree.gravity)
    rng = np.random.default_rng([machine_seed, 632, number, run_seed])
    reading = own.measure(link_motion(truth, link), rng)
    return Log(channels(reading), source=f"virtual imu{number} on {link} (seed {run_seed})")
