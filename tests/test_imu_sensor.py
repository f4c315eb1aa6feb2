"""The virtual IMU and the noise figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinotwin.errors import DataError
from pinotwin.imu.filters import low_pass as assumed
from pinotwin.imu.whiten import rest
from pinotwin.signals import roughness
from pinotwin.virtual.imu_sensor import ImuSensor, LinkMotion, SensorClock, Triad, low_pass, mti630
from tests.test_imu_rig import DEG, record


def carousel(rate: float, seconds: float = 4.0) -> LinkMotion:
    """A link that turns about z at a constant rate, its origin on the axis."""
    t = np.arange(round(seconds * 4000)) / 4000
    R = Rotation.from_rotvec(np.outer(rate * t, [0, 0, 1.0])).as_matrix()
    return LinkMotion(t, R, np.tile([0.0, 0.0, rate], (len(t), 1)), np.zeros((len(t), 3)))


def test_carousel_reads_the_centripetal_acceleration_and_gravity() -> None:
    mount = Rotation.random(random_state=3).as_matrix()
    sensor = ImuSensor(position=np.array([0.2, 0.0, 0.0]), mounting=mount)
    reading = sensor.measure(carousel(3.0), np.random.default_rng(0))
    turned = reading.gyr @ mount.T
    np.testing.assert_allclose(turned, np.tile([0, 0, 3.0], (len(turned), 1)), atol=1e-12)
    expected = np.tile([-9.0 * 0.2, 0.0, 9.81], (len(reading.t), 1))
    np.testing.assert_allclose(reading.acc @ mount.T, expected, atol=1e-9)


def test_scale_nonorthogonality_and_g_sensitivity_act_as_stated() -> None:
    cross = np.array([[0, 1e-3, 0], [1e-3, 0, 2e-3], [0, 2e-3, 0.0]])
    gyro = Triad(
        scale=np.array([0, 0, 0.005]),
        nonorthogonality=cross,
        bias=np.full(3, 0.01),
        asymmetry=np.array([0, 0, 1e-3]),
        g_sensitivity=np.full((3, 3), 1e-4),
    )
    reading = ImuSensor(gyro=gyro).measure(carousel(-2.0), np.random.default_rng(0))
    g = 9.81e-4
    expected = [0.01 + g, -4e-3 + 0.01 + g, -2 * 1.005 + 2e-3 + 0.01 + g]
    np.testing.assert_allclose(reading.gyr.mean(axis=0), expected, atol=1e-12)


def test_noise_has_the_size_of_the_source_and_the_clock_what_was_asked() -> None:
    clock = SensorClock(offset=1.5, skew=1e-3, drop=0.01, holes=((0.5, 0.7),), restart=2.0)
    sensor = replace(mti630(np.random.default_rng(5), 2), clock=clock)
    reading = sensor.measure(carousel(0.0, 30.0), np.random.default_rng(1))
    figure = np.std(reading.gyr, axis=0) / DEG
    np.testing.assert_allclose(figure, [0.1663, 0.09148, 0.08925], rtol=0.05)
    steps = np.diff(reading.t)
    assert (steps < 0).sum() == 1
    assert steps.max() > 0.199
    assert len(reading.t) == pytest.approx(0.99 * (30 / 1.001 - 0.2) * 400, rel=0.005)


def test_low_pass_delays_by_its_group_delay() -> None:
    t = np.arange(4000) / 2000
    ramp = low_pass(t[:, None], 140.0, 1 / 2000)
    assert np.median(t - ramp[:, 0]) == pytest.approx(Triad(cutoff=140.0).delay, rel=1e-6)


def test_the_sensors_low_pass_and_the_estimates_are_one_filter_written_twice() -> None:
    x = np.cumsum(np.random.default_rng(2).normal(size=(800, 3)), axis=0) + 5.0
    np.testing.assert_allclose(low_pass(x, 140.0, 1 / 2000), assumed(x, 140.0, 1 / 2000), atol=1e-10)


def test_a_coarse_truth_is_refused() -> None:
    motion = carousel(1.0)
    coarse = LinkMotion(motion.t[::20], motion.R[::20], motion.w[::20], motion.a[::20])
    with pytest.raises(DataError, match="sampled at 200 Hz"):
        ImuSensor().measure(coarse, np.random.default_rng(0))


def test_rest_is_found_where_the_rig_rests_and_nowhere_else() -> None:
    truth, _ = record(4, 12.0)
    sensor = mti630(np.random.default_rng(0))
    reading = sensor.measure(truth.motion, np.random.default_rng(1))
    found = rest(reading.gyr, reading.acc, 400.0)
    assert found[:340].mean() > 0.95
    moving = np.interp(reading.t, truth.motion.t, np.linalg.norm(truth.motion.w, axis=1)) > 0.05
    assert (found & moving).mean() < 0.005
    offset = reading.gyr[found].mean(axis=0) - sensor.gyro.bias
    assert np.abs(offset).max() < 0.01 * DEG
    busy = slice(600, 3600)
    assert not rest(reading.gyr[busy], reading.acc[busy], 400.0)[200:-200].all()
    shaking = np.arange(800) > 400  # about a mean of zero
    noise = 1e-3 * np.random.default_rng(2).normal(size=(800, 3))
    shaken = noise + 0.01 * (shaking * np.sin(np.arange(800) * 2 * np.pi / 20))[:, None]
    still = rest(shaken, noise + np.array([0.0, 0.0, 9.81]), 400.0)
    assert still[:400].all()
    assert not still[430:].any()
    np.testing.assert_allclose(roughness([np.random.default_rng(0).normal(size=9999)]), 1, 0.05)
