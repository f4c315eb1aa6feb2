"""The vibration estimate on an IMU that shares nothing with the estimator, nor with ``pinotwin.virtual``.

Kinematics by Pinocchio on the rig's true motion; the filter, the errors and the clock are written here.
The estimate is told a second-order low-pass at 140 Hz in every case; it is true in none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.signal import bessel, sosfilt
from scipy.spatial.transform import Rotation

from pinotwin.dynamics import frame_acceleration, frame_rotation, frame_velocity
from pinotwin.imu.filters import high_passed
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.reconstruction import reconstruct_vibration
from pinotwin.virtual import VirtualMachine, random_trajectory

DEG = np.pi / 180
FINE = 4000.0
OFFSET, SKEW = 0.731, -4e-5


@pytest.fixture(scope="module")
def run():
    virtual = VirtualMachine.load("urdf/flexure_rig")
    return virtual.record(random_trajectory(virtual, 11.5, 3), seed=1, truth_rate=FINE)


def readings(run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, angular rate and specific force in a tilted sensor off the link's origin."""
    machine = Machine.load("flexure_rig")
    order = [run.truth.joint(name) for name in machine.names]
    q, v, a = (np.stack([joint[k] for joint in order], axis=1) for k in range(3))
    R = frame_rotation(machine.model, "C_link", q)
    w = frame_velocity(machine.model, "C_link", q, v)[:, 3:]
    acc = frame_acceleration(machine.model, "C_link", q, v, a)
    place = np.array([0.05, -0.03, 0.01])
    force = acc[:, :3] - np.einsum("nji,j->ni", R, [0.0, 0.0, -9.81])
    force += np.cross(acc[:, 3:], place) + np.cross(w, np.cross(w, place))
    turn = Rotation.from_euler("xyz", [17.0, -8.0, 120.0], degrees=True).as_matrix()
    return run.truth.t, w @ turn, force @ turn


def no_filter(x: np.ndarray) -> np.ndarray:
    return x


def mean_of_ten(x: np.ndarray) -> np.ndarray:
    """The sensor sums ten raw samples at 4 kHz: half of them late."""
    c = np.cumsum(np.concatenate([np.repeat(x[:1], 10, axis=0), x]), axis=0)
    return (c[10:] - c[:-10]) / 10.0


def bessel_120(x: np.ndarray) -> np.ndarray:
    """A fourth-order Bessel filter: the angle of its phase is straight, no ripple."""
    sos = bessel(4, 120.0, fs=FINE, output="sos", norm="mag")
    return sosfilt(sos, x - x[:1], axis=0) + x[:1]


def imu_log(run, low_pass: Callable[[np.ndarray], np.ndarray], cubic: float) -> Log:
    """Return the log on the sensor's own clock; ``cubic`` in 1/(rad/s)² adds c u³ to the rate."""
    rng = np.random.default_rng(77)
    t, w, f = readings(run)
    w = w * (1.0 + rng.normal(0.0, 2e-3, 3)) + cubic * w**3
    w, f = low_pass(w), low_pass(f)
    tau = np.arange(np.ceil((t[0] - OFFSET + 0.05) * 400), np.floor((t[-1] - OFFSET - 0.05) * 400)) / 400
    true = OFFSET + (1.0 + SKEW) * tau + rng.uniform(-2e-5, 2e-5, len(tau))
    gyr = PchipInterpolator(t, w)(true) + rng.normal(0.0, 0.09 * DEG, (len(tau), 3)) + 0.08 * DEG
    acc = PchipInterpolator(t, f)(true) + rng.normal(0.0, 7e-3, (len(tau), 3)) + 0.015
    names = ("gx", "gy", "gz", "ax", "ay", "az")
    return Log({"t": tau, **dict(zip(names, [*gyr.T, *acc.T], strict=True))}, source="another IMU")


@pytest.mark.parametrize(
    ("low_pass", "cubic", "velocity", "angle"),
    [
        # measured: 0.0026, 0.0053, 0.0042 deg/s and 0.00008, 0.00041, 0.00017 deg; 1.5 times that passes
        (no_filter, 0.0, 0.0039, 0.00012),
        (mean_of_ten, 3e-3, 0.0080, 0.00062),
        (bessel_120, 1e-3, 0.0063, 0.00026),
    ],
)
def test_the_vibration_is_found(run, low_pass, cubic, velocity, angle) -> None:
    found = reconstruct_vibration(
        Machine.load("flexure_rig"),
        run.to_log(),
        imu_log(run, low_pass, cubic),
    )
    m = found.motion
    fine = run.truth.joint("delta")
    true = [np.interp(m.t, run.truth.t, x) for x in fine]
    error_v = np.sqrt(np.mean((m.v - true[1]) ** 2)) / DEG
    error_q = np.sqrt(np.mean((high_passed(m.t, m.q, 0.5) - high_passed(m.t, true[0], 0.5)) ** 2)) / DEG
    assert error_v < velocity
    assert error_q < angle
    assert found.frequency[0] == pytest.approx(19.93, rel=0.002)
    assert found.damping[0] == pytest.approx(0.05, abs=0.0005)
