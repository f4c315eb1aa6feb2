"""Clocks and frames: synchronisation and alignment on virtual data with a sealed truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks._imu_methods import mounting
from pinotwin.errors import DataError
from pinotwin.imu import align
from pinotwin.imu import rotation as rot
from pinotwin.imu.clock import SyncSettings, sync
from pinotwin.solve.sandwich import sandwich
from pinotwin.virtual.imu_sensor import GRAVITY, ImuReading, ImuSensor, SensorClock, mti630
from tests.test_imu_rig import DEG, record

run = cache(record)


def draw(k: int, seconds: float = 24.0, **clock: object) -> tuple[ImuSensor, ImuReading]:
    """A sensor of the source's errors, any mounting and clock, and its record of run k % 3."""
    rng = np.random.default_rng([77, k])
    sensor = replace(
        mti630(rng),
        mounting=Rotation.random(random_state=k).as_matrix(),
        position=rng.uniform(-0.1, 0.1, 3),
        clock=SensorClock(offset=rng.uniform(-4, 4), skew=rng.normal(0, 5e-5), **clock),  # type: ignore[arg-type]
    )
    return sensor, sensor.measure(run(k % 3, seconds)[0].motion, rng)


def errors(k: int, **clock: object) -> np.ndarray:
    """Error of the offset mid-record [s], its stated sd, error of the skew, its stated sd."""
    sensor, imu = draw(k, **clock)
    servo = run(k % 3, 24.0)[1]
    fit = sync(servo.t, servo.w, imu.t, imu.gyr, SyncSettings(delay=sensor.gyro.delay))
    s, c = fit.segments[0], sensor.clock
    return np.array([s.at_pivot - (c.offset + (1 + c.skew) * s.pivot), s.se, fit.skew - c.skew, fit.se_skew])


def test_offset_and_skew_over_fifty_mountings_and_clocks() -> None:
    e = np.array([errors(k, drop=0.01, holes=((8.0, 8.2),)) for k in range(50)])
    assert np.abs(e[:, 0]).max() < 5e-5
    assert np.sqrt(np.mean(e[:, 2] ** 2)) < 2e-6
    assert np.abs(e[:, 2]).max() < 6e-6
    assert np.mean(np.abs(e[:, 2]) < 2 * e[:, 3]) > 0.9


def test_magnitudes_alone_are_enough_and_the_mapping_is_usable() -> None:
    sensor, imu = draw(3, jitter=2e-5)
    servo = run(0, 24.0)[1]
    settings = SyncSettings(delay=sensor.gyro.delay)
    fit = sync(servo.t, np.linalg.norm(servo.w, axis=1), imu.t, imu.gyr, settings)
    truth = (1 + sensor.clock.skew) * imu.t + sensor.clock.offset
    assert np.abs(fit.to_ref(imu.t) - truth).max() < 2e-4
    assert fit.offset == pytest.approx(sensor.clock.offset, abs=2e-4)


def test_a_restarted_clock_has_two_offsets_and_one_skew() -> None:
    sensor, imu = draw(1, restart=9.0)
    servo = run(1, 24.0)[1]
    fit = sync(servo.t, servo.w, imu.t, imu.gyr, SyncSettings(delay=sensor.gyro.delay))
    assert len(fit.segments) == 2
    back = np.flatnonzero(np.diff(imu.t) < 0)[0] + 1
    tau = imu.t + np.where(np.arange(len(imu.t)) >= back, 9.0, 0.0)
    truth = (1 + sensor.clock.skew) * tau + sensor.clock.offset
    assert np.abs(fit.to_ref(imu.t) - truth).max() < 1.5e-4
    with pytest.raises(DataError, match="fitted on"):
        fit.to_ref(imu.t[:-1])


def test_no_rotation_or_another_run_is_a_clear_failure() -> None:
    servo, (_, imu) = run(0, 24.0)[1], draw(0)
    with pytest.raises(DataError, match=r"the encoders' angular rate varies by .* nothing rotates"):
        sync(servo.t, 0 * servo.w, imu.t, imu.gyr)
    still = 1e-3 * np.random.default_rng(0).normal(size=imu.gyr.shape)
    with pytest.raises(DataError, match="the IMU's angular rate varies"):
        sync(servo.t, servo.w, imu.t, still)
    other = run(2, 24.0)[1]
    with pytest.raises(DataError, match="no common rotation"):
        sync(other.t, other.w, imu.t, imu.gyr)


def test_sandwich_covers_the_mean_of_correlated_noise() -> None:
    rng = np.random.default_rng(0)
    white = rng.normal(size=(300, 2050))
    x = np.lib.stride_tricks.sliding_window_view(white, 50, axis=1).mean(axis=2)
    stated = [sandwich((r - r.mean())[:, None], np.array([[float(len(r))]]), 150)[0, 0] for r in x]
    assert np.sqrt(np.mean(stated)) == pytest.approx(x.mean(axis=1).std(), rel=0.2)


def on_servo(k: int) -> tuple[ImuSensor, np.ndarray, np.ndarray]:
    """A sensor and its readings on the servo clock, delay removed."""
    sensor, imu = draw(k)
    servo, c = run(k % 3, 24.0)[1], sensor.clock
    at = (1 + c.skew) * imu.t + c.offset - sensor.gyro.delay
    gyr, acc = (np.stack([np.interp(servo.t, at, x) for x in y.T], 1) for y in (imu.gyr, imu.acc))
    return sensor, gyr, acc


@pytest.mark.parametrize("k", range(4))
def test_mounting_from_rates_is_proper_and_within_its_errors(k: int) -> None:
    sensor, gyr, _ = on_servo(k)
    fit = align.mounting_from_rates(run(k % 3, 24.0)[1].w, gyr)
    error = Rotation.from_matrix(fit.R @ sensor.mounting).as_rotvec()
    assert np.linalg.det(fit.R) == pytest.approx(1.0)
    assert np.linalg.norm(error) < 0.06 * DEG
    assert np.sqrt(np.trace(fit.cov)) < 0.05 * DEG


def test_inertial_alignment_and_mounting_as_in_the_source() -> None:
    servo = run(0, 24.0)[1]
    R_GM = Rotation.from_rotvec([0.02, -0.03, 2.0]).as_matrix()
    R_ST = Rotation.random(random_state=9).as_matrix()
    q = Rotation.from_matrix(R_GM @ servo.R @ R_ST.T).as_quat(scalar_first=True)
    q = rot.multiply(q, rot.exp(1e-3 * np.random.default_rng(0).normal(size=(len(q), 3))))
    w_machine = np.einsum("nij,nj->ni", servo.R, servo.w)
    w_earth = rot.rotate(q, servo.w @ R_ST.T)
    inertial = align.fit_rotation(w_machine, w_earth)
    mounted = mounting(q, inertial.R, servo.R)
    for found, truth in ((inertial.R, R_GM), (mounted, R_ST)):
        error = np.linalg.norm(Rotation.from_matrix(found @ truth.T).as_rotvec())
        assert error < 0.05 * DEG
        assert error < 5 * np.sqrt(np.trace(inertial.cov)) + 2e-5


def test_one_axis_needs_gravity_and_two_are_refused_without() -> None:
    servo = record(6, 12.0, c_axis=False)[1]
    mount = Rotation.random(random_state=2).as_matrix()
    gyr = servo.w @ mount
    force = (servo.a - np.einsum("nji,j->ni", servo.R, GRAVITY)) @ mount
    up = servo.R[:, 2]
    fit = align.mounting_from_rates(servo.w, gyr, (up, force))
    assert fit.gravity
    assert np.linalg.norm(Rotation.from_matrix(fit.R @ mount).as_rotvec()) < 0.5 * DEG
    with pytest.raises(DataError, match="second, non-parallel axis or give gravity"):
        align.mounting_from_rates(servo.w, gyr)
    vertical = np.outer(np.sin(servo.t), [0, 0, 1.0])
    ez = np.array([0, 0, 1.0])
    with pytest.raises(DataError, match="gravity is parallel"):
        align.fit_rotation(vertical, vertical, (ez, ez))
    with pytest.raises(DataError, match="too little to align"):
        align.fit_rotation(0.01 * vertical, 0.01 * vertical)
