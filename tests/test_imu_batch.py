"""The batch estimate against the sealed truth of the analytic rig."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lsim
from scipy.spatial.transform import Rotation

from benchmarks._imu_methods import baselines, joint_angles, naive
from pinotwin.errors import DataError
from pinotwin.imu import batch
from pinotwin.imu.clock import ClockFit, SyncSettings, sync
from pinotwin.imu.filters import group_delay, high_passed
from pinotwin.imu.mode import decay, respond
from pinotwin.imu.predict import RunModel
from pinotwin.imu.result import BatchResult
from pinotwin.imu.runs import ImuRun, Priors, ServoRun
from pinotwin.imu.whiten import Whitener
from pinotwin.reconstruction.combine import combine
from pinotwin.virtual.imu_sensor import GRAVITY, ImuSensor, SensorClock, mti630
from tests.test_imu_rig import DEG, Truth, record

PRIORS = Priors(gyro_cutoff=140.0, accel_cutoff=140.0)


def sensor(k: int, number: int = 1, tilt: object = None, **clock: object) -> ImuSensor:
    rng = np.random.default_rng([5, k, number])
    c = {"drop": 0.01, "holes": ((8.0, 8.2),), "jitter": 1e-5} | clock
    foundation = np.random.default_rng(k).normal(0, 2 * DEG, 3) if tilt is None else tilt
    return replace(
        mti630(rng, number),
        mounting=Rotation.random(random_state=100 * number + k).as_matrix(),
        position=rng.uniform(-0.1, 0.1, 3),
        gravity=Rotation.from_rotvec(foundation).as_matrix() @ GRAVITY,
        clock=SensorClock(offset=rng.uniform(-4, 4), skew=rng.normal(0, 5e-5), **c),  # type: ignore[arg-type]
    )


def as_runs(truth: Truth, servo: object, s: ImuSensor, seed: int) -> tuple[ServoRun, ImuRun]:
    view = ServoRun(*(getattr(servo, n) for n in ("t", "R", "w", "a", "axis", "arm", "load")))
    r = s.measure(truth.motion, np.random.default_rng([9, seed]))
    return view, ImuRun(r.t, r.gyr, r.acc)


def clocks(servo: list[ServoRun], imu: list[ImuRun]) -> list[ClockFit]:
    settings = SyncSettings(delay=group_delay(PRIORS.gyro_cutoff), skew=PRIORS.skew)
    return [sync(s.t, s.w, i.t, i.gyr, settings) for s, i in zip(servo, imu, strict=False)]


def estimate(servo: list[ServoRun], imu: list[ImuRun]) -> BatchResult:
    return batch.estimate(servo, imu, PRIORS, clocks(servo, imu))


Case = tuple[Truth, ServoRun, ImuRun, ImuSensor, BatchResult]


@cache
def case(k: int, hysteresis: float = 0.0, hardening: float = 0.0) -> Case:
    truth, servo = record(k, hysteresis=hysteresis, hardening=hardening)
    s = sensor(k)
    view, imu = as_runs(truth, servo, s, k)
    return truth, view, imu, s, estimate([view], [imu])


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def gaps(truth: Truth, result: BatchResult) -> tuple[float, float, float, float]:
    """RMS errors of dynamic angle, velocity, acceleration [deg...], and the true dynamic RMS."""
    r, rows = result.runs[0], slice(None, None, 10)
    dynamic = high_passed(r.t, truth.delta[rows], 0.5)
    return (
        rms(r.dynamic - dynamic) / DEG,
        rms(r.velocity - truth.delta_v[rows]) / DEG,
        rms(r.acceleration - truth.delta_a[rows]) / DEG,
        rms(dynamic) / DEG,
    )


@pytest.mark.parametrize(
    ("k", "hysteresis", "hardening"),
    [(0, 0.0, 0.0), (1, 0.0, 0.0), (0, 0.05, 0.1), (2, 0.05, 0.1)],
)
def test_one_run_beats_the_sources_mean_of_22(k: int, hysteresis: float, hardening: float) -> None:
    truth, _, _, _, result = case(k, hysteresis, hardening)
    angle, velocity, acceleration, size = gaps(truth, result)
    assert angle < 0.001
    assert angle < 0.2 * size
    assert velocity < 0.0474
    assert acceleration < 7.33
    if not hysteresis:
        assert angle < 0.0005
        assert result.frequency[0] == pytest.approx(20.0, rel=0.02)
        assert result.damping[0] == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize("k", [0, 1, 2])
def test_clock_scale_mounting_and_place_are_found_within_their_errors(k: int) -> None:
    _, _, _, s, result = case(k)
    r, c = result.runs[0], s.clock
    m = r.clock.segments[0]
    assert abs(m.at_pivot - (c.offset + (1 + c.skew) * m.pivot)) < 2e-5
    assert abs(r.clock.skew - c.skew) < 3e-6
    error = r.scale - s.gyro.scale
    assert np.abs(error).max() < 2e-4
    assert np.all(np.abs(error) < 3 * r.scale_se)
    turn = Rotation.from_matrix(result.R_ST @ s.mounting).as_rotvec()
    assert np.linalg.norm(turn) < 0.01 * DEG
    np.testing.assert_allclose(result.shared("position")[0], s.position, atol=1e-3)
    up = -s.gravity / np.linalg.norm(s.gravity)
    assert np.linalg.norm(result.R_GM_up - up) < 0.1 * DEG


@pytest.mark.parametrize(("hysteresis", "hardening"), [(0.0, 0.0), (0.05, 0.1)])
def test_the_table_of_methods(hysteresis: float, hardening: float) -> None:
    truth, servo, imu, s, result = case(0, hysteresis, hardening)
    clock = sync(servo.t, servo.w, imu.t, imu.gyr, SyncSettings(delay=s.gyro.delay))
    table = {n: d.angle[:, 0] for n, d in baselines(servo, imu, clock, s.gyro.delay).items()}
    table["batch"] = result.runs[0].angle
    true = truth.delta[::10]
    whole = {n: np.std(x - true) / DEG for n, x in table.items()}
    assert whole["naive"] > 0.02
    assert whole["ekf"] > 0.02
    assert whole["vqf"] > 0.02
    assert whole["batch"] < 0.002
    fast = {n: rms(high_passed(servo.t, x - true, 0.5)) / DEG for n, x in table.items()}
    assert min(v for n, v in fast.items() if n != "batch") > 4 * fast["batch"]


def test_an_unused_imu_is_predicted_to_its_noise() -> None:
    truth, servo, _, first, result = case(0)
    del first
    other = sensor(0, 2)
    view, imu = as_runs(truth, record(0)[1], other, 50)
    clock = sync(servo.t, servo.w, imu.t, imu.gyr, SyncSettings(delay=other.gyro.delay))
    tilt = replace(PRIORS, gravity=other.gravity)
    own = estimate([view], [imu])  # its own errors only, to take them out
    model = RunModel(view, imu, tilt, own.runs[0].clock.to_ref(imu.t))
    run, place = result.runs[0], own.shared("position")[0]
    delta = np.stack([run.angle, run.velocity, run.acceleration], axis=1)
    gyr, acc = model.readings(run.t, delta, own.R_ST, place)
    del clock
    at = own.runs[0].clock.to_ref(imu.t)
    inside = (at > servo.t[0] + 0.02) & (at < servo.t[-1] - 0.02)
    gyro = (imu.gyr, gyr, other.gyro.noise, 1.25)
    accel = (imu.acc, acc, other.accel.noise, 1.5)
    for y, yhat, noise, factor in (gyro, accel):
        X = np.hstack([yhat, np.ones((len(yhat), 1))])  # scale, cross-axis and bias of the other
        e = y[inside] - X @ np.linalg.lstsq(X, y[inside], rcond=None)[0]
        assert np.all(np.std(e, axis=0) < factor * noise)
    blind, _ = model.readings(run.t, 0.0 * delta, own.R_ST, place)
    X = np.hstack([blind, np.ones((len(blind), 1))])
    e = imu.gyr[inside] - X @ np.linalg.lstsq(X, imu.gyr[inside], rcond=None)[0]
    assert rms(e) > 2 * rms(other.gyro.noise)


def test_quasi_static_band_has_its_own_interval() -> None:
    truth, _, _, _, result = case(0)
    r = result.runs[0]
    slow = lambda x: x - x.mean() - high_passed(r.t, x, 0.5)  # noqa: E731
    assert rms(slow(r.angle) - slow(truth.delta[::10])) < 2.5 * r.quasi_static_sd
    assert "quasi-static" in r.verdict()
    assert "not observable" in replace(r, quasi_static_sd=1.0).verdict()
    fast = rms(r.dynamic - high_passed(r.t, truth.delta[::10], 0.5))
    assert fast < 2 * rms(r.sd_angle)


def test_parasitic_axes_show_what_happens_across_the_joint() -> None:
    truth, servo, _, s, result = case(0)
    assert rms(result.runs[0].parasitic) < 0.07 * DEG
    t = np.asarray(truth.motion.t)
    shake = 0.5 * DEG * np.sin(2 * np.pi * 31.0 * t)  # about the machine's y
    extra = np.einsum("nji,j->ni", truth.motion.R, [0.0, 1.0, 0.0]) * shake[:, None]
    shaken = replace(truth, motion=replace(truth.motion, w=truth.motion.w + extra))
    reading = s.measure(shaken.motion, np.random.default_rng([9, 0]))
    again = estimate([servo], [ImuRun(reading.t, reading.gyr, reading.acc)])
    sizes = sorted(np.std(again.runs[0].parasitic, axis=0) / DEG)
    assert sizes[1] == pytest.approx(0.5 / np.sqrt(2), rel=0.15)
    assert sizes[0] < 0.09


def test_several_runs_share_the_mode_and_combine() -> None:
    pairs, truths = [], []
    for k in range(3):
        truth, servo = record(3, 12.0, seed_noise=k)
        one = replace(sensor(7), clock=replace(sensor(10 + k).clock, holes=()))
        pairs.append(as_runs(truth, servo, one, k))
        truths.append(truth)
    result = estimate([p[0] for p in pairs], [p[1] for p in pairs])
    single = estimate([pairs[0][0]], [pairs[0][1]])
    assert result.frequency[1] < single.frequency[1]
    mean, _, _ = combine([r.velocity for r in result.runs], [r.sd_velocity for r in result.runs])
    each = [rms(r.velocity - truths[0].delta_v[::10]) for r in result.runs]
    assert rms(mean - truths[0].delta_v[::10]) < 0.8 * min(each)  # 1 / sqrt(3) of independent noise


def test_a_restarted_clock_inside_a_run() -> None:
    truth, servo = record(1)
    view, imu = as_runs(truth, servo, sensor(1, restart=6.0, holes=()), 3)
    result = estimate([view], [imu])
    angle, velocity, acceleration, _ = gaps(truth, result)
    assert angle < 0.001
    assert velocity < 0.0474
    assert acceleration < 7.33


def test_jacobian_equals_finite_differences() -> None:
    truth, servo = record(4, 6.0)
    s = sensor(4)
    view, imu = as_runs(truth, servo, s, 1)
    problem = batch.prepare([view], [imu], PRIORS, clocks([view], [imu]))
    rng = np.random.default_rng(0)
    theta = problem.mean + 0.1 * problem.sd * rng.normal(size=len(problem.mean))
    theta[problem.lay["gain"]] = 0.26
    run = problem.models[0]
    _, J = run.predict(theta, problem.lay, problem.R_ST)
    scale = np.concatenate([np.full(3, 1.5e-3), np.full(3, 8e-3)])  # noise of the channels
    for j in range(problem.lay.size):
        h = 1e-3 * problem.sd[j] * np.eye(problem.lay.size)[j]
        above, below = (run.predict(theta + x, problem.lay, problem.R_ST)[0] for x in (h, -h))
        numeric = (above - below) / 2e-3 / scale
        analytic = J[:, :, j] * problem.sd[j] / scale
        assert np.abs(numeric - analytic).max() < 0.03 * max(1.0, np.abs(numeric).max()), j


def test_mode_response_against_scipy_and_its_decay() -> None:
    rng = np.random.default_rng(1)
    load = np.cumsum(rng.normal(size=(400, 2)), axis=0)
    r = respond(load, 1e-3, 120.0, 0.06, rest=False)
    t = 1e-3 * np.arange(400)
    _, y, _ = lsim(([1.0], [1.0, 2 * 0.06 * 120, 120.0**2]), load[:, 1], t)
    np.testing.assert_allclose(r.x[:, 1], y, atol=1e-12 * np.abs(y).max() + 1e-14)
    d = decay(400, 1e-3, 120.0, 0.06)
    assert d.x[0].tolist() == [1.0, 0.0]
    np.testing.assert_allclose(np.gradient(d.x, 1e-3, axis=0)[5:-5], d.v[5:-5], atol=0.4)
    np.testing.assert_allclose(respond(np.ones((9, 1)), 1e-3, 120.0, 0.06).v, 0.0, atol=1e-12)


def test_nothing_rotates_and_bad_arrays_are_refused() -> None:
    _, servo, imu, _, _ = case(0)
    with pytest.raises(DataError, match="nothing rotates"):
        estimate([replace(servo, w=0 * servo.w)], [imu])
    with pytest.raises(DataError, match="in pairs"):
        estimate([servo], [])
    with pytest.raises(DataError, match="'axis' has shape"):
        replace(servo, axis=servo.axis[:-1])
    with pytest.raises(DataError, match="did you mean"):
        case(0)[4].shared("positon")


def test_reconstruction_and_integration_in_closed_form() -> None:
    angles = np.random.default_rng(0).normal(0, 0.02, (50, 3))
    R = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()  # Eq. 6.28, turning vectors
    np.testing.assert_allclose(joint_angles(R), angles, atol=1e-12)
    axis = np.array([0.0, 1.0, 0.0])
    about_y = Rotation.from_rotvec(np.outer([0.01, -0.02], axis)).as_matrix()
    np.testing.assert_allclose(joint_angles(about_y, axis)[:, 0], [0.01, -0.02], atol=1e-12)
    t = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(naive(t, np.cos(t)[:, None])[:, 0], np.sin(t), atol=1e-6)
    with pytest.raises(DataError, match=r"too short for a 0\.5 Hz corner"):
        high_passed(t, t, 0.5)


def test_averaging_weighs_by_information() -> None:
    rng = np.random.default_rng(3)
    runs = [s * rng.normal(size=2000) for s in (1.0, 1.0, 5.0)]
    weighed, sd, _ = combine(runs, [np.array(1.0), np.array(1.0), np.array(5.0)])
    assert rms(weighed) < 0.5 * rms(np.mean(runs, axis=0))
    assert sd.mean() == pytest.approx(rms(weighed), rel=0.1)
    best = np.average(runs, axis=0, weights=[25, 25, 1])
    np.testing.assert_allclose(weighed, best, atol=0.1)
    with pytest.raises(DataError, match="at least two runs"):
        combine(runs[:1], [np.array(1.0)])


def test_the_noise_admits_what_a_model_leaves_and_never_shrinks() -> None:
    left = np.random.default_rng(0).normal(size=(20_000, 2)) * [0.5, 3.0]
    wider = Whitener(np.ones((2, 1)), np.array([1.0, 2.0])).at_least(left)
    np.testing.assert_allclose(wider.sigma, [1.0, 6.0], rtol=0.03)
