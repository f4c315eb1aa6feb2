"""Orientation filters: Jacobians, the smoother, and the BROAD benchmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot
from pinotwin.imu.ekf import ekf, gravity_rows, transition
from pinotwin.imu.kalman import LinearModel
from pinotwin.imu.orientation import orientation

TRIALS = {
    "02": "slow_rotation",
    "07": "fast_rotation",
    "11": "slow_translation",
    "16": "fast_translation",
}
VQF_OFFLINE = {"02": 0.31, "07": 0.96, "11": 0.26, "16": 0.43}  # deg, data/broad_imu/README.md


def differences(f, x: np.ndarray, h: float = 1e-6) -> np.ndarray:
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=1)


@pytest.mark.parametrize("size", [0.0, 1e-7, 1e-3, 2.0])
def test_jacobians_equal_finite_differences(size: float) -> None:
    rng = np.random.default_rng(3)
    x = np.concatenate([rng.normal(size=4), 0.1 * rng.normal(size=3)])
    x[:4] /= np.linalg.norm(x[:4])
    gyr = x[4:7] + size * rng.normal(size=3)
    F = transition(x, gyr, 0.02)[1]
    np.testing.assert_allclose(F, differences(lambda y: transition(y, gyr, 0.02)[0], x), atol=2e-9)
    H = gravity_rows(x, 9.81)[1]
    np.testing.assert_allclose(H, differences(lambda y: gravity_rows(y, 9.81)[0], x), atol=2e-8)


def test_predicted_gravity_is_gravity_in_the_sensor_frame() -> None:
    q = rot.exp(np.array([0.3, -1.2, 0.5]))
    x = np.concatenate([q, np.zeros(3)])
    np.testing.assert_allclose(gravity_rows(x, 9.81)[0], rot.rotate(rot.conjugate(q), np.array([0, 0, 9.81])))


def test_smoother_equals_the_batch_least_squares_solution() -> None:
    rng = np.random.default_rng(0)
    n, F, H = 30, np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([[1.0, 0.0]])
    Q, P0, r = np.diag([0.01, 0.02]), np.diag([2.0, 1.0]), 0.3
    z = rng.normal(size=(n, 1))
    model = LinearModel(F[None], np.zeros((n - 1, 2)), Q[None], H[None], np.zeros(2), P0)
    x, P = model.smooth(z, np.full((n, 1), r))
    rows, rhs = [np.zeros((2, 2 * n))], [np.zeros(2)]
    rows[0][:, :2] = np.linalg.inv(np.sqrt(P0))
    for k in range(n):
        row = np.zeros((1, 2 * n))
        row[:, 2 * k : 2 * k + 2] = H / np.sqrt(r)
        rows.append(row), rhs.append(z[k] / np.sqrt(r))
        if k:
            row = np.zeros((2, 2 * n))
            W = np.linalg.inv(np.sqrt(Q))
            row[:, 2 * k - 2 : 2 * k], row[:, 2 * k : 2 * k + 2] = -W @ F, W
            rows.append(row), rhs.append(np.zeros(2))
    A, b = np.vstack(rows), np.concatenate(rhs)
    np.testing.assert_allclose(x.ravel(), np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-9)
    C = np.linalg.inv(A.T @ A)
    np.testing.assert_allclose(P[7], C[14:16, 14:16], atol=1e-9)


def swing(seconds: float = 40.0, rate: float = 200.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Truth, gyro and accelerometer of a sensor that swings and stays in place, with a bias."""
    rng = np.random.default_rng(8)
    t = np.arange(0, seconds, 1 / rate)
    w = np.stack([np.sin(1.1 * t), 0.8 * np.sin(0.7 * t + 1), np.cos(0.5 * t)], axis=1)
    w[t < 2.0] = 0.0
    q = rot.chain(rot.increments(w, 1 / rate))
    acc = rot.rotate(rot.conjugate(q), np.tile([0, 0, 9.81], (len(t), 1)))
    mean = np.vstack([w[:1], rot.increments(w, 1 / rate) * rate])  # over the step that ends there
    gyr = mean + np.array([5e-3, -3e-3, 2e-3]) + 1e-3 * rng.normal(size=w.shape)
    return q, gyr, acc + 0.02 * rng.normal(size=w.shape)


def test_bias_and_inclination_are_found_and_the_smoother_is_better() -> None:
    q, gyr, acc = swing()
    _, bias = ekf(gyr, acc, 200.0)
    np.testing.assert_allclose(bias[-1], [5e-3, -3e-3, 2e-3], atol=1.5e-3)
    error = {
        m: np.sqrt(np.mean(rot.inclination_error(orientation(gyr, acc, 200.0, m), q) ** 2))
        for m in ("ekf", "smoother", "offline", "vqf")
    }
    assert error["smoother"] < error["ekf"]
    assert error["offline"] < 2e-3
    assert error["offline"] <= 1.05 * error["vqf"]


def test_bad_input_is_one_clear_line() -> None:
    _, gyr, acc = swing(1.0)
    with pytest.raises(DataError, match=r"must both be \(n, 3\)"):
        orientation(gyr, acc[:-1], 200.0)
    with pytest.raises(DataError, match="did you mean 'smoother'"):
        orientation(gyr, acc, 200.0, "smother")  # type: ignore[arg-type]


@pytest.mark.parametrize("trial", TRIALS)
def test_broad_inclination_is_no_worse_than_offline_vqf(data_dir: Path, trial: str) -> None:
    file = data_dir / "broad_imu" / f"{trial}_undisturbed_{TRIALS[trial]}_B.mat"
    if not file.exists():
        pytest.skip(f"{file.name} is not at hand")
    m = scipy.io.loadmat(file)
    rate = float(m["sampling_rate"].item())
    moving = m["movement"].ravel().astype(bool)

    def rmse(q: np.ndarray) -> float:
        error = rot.inclination_error(q, m["opt_quat"].astype(float))
        return float(np.degrees(np.sqrt(np.nanmean(error[moving] ** 2))))

    gyr, acc = m["imu_gyr"].astype(float), m["imu_acc"].astype(float)
    vqf = rmse(orientation(gyr, acc, rate, "vqf"))
    assert vqf == pytest.approx(VQF_OFFLINE[trial], abs=0.006)  # the metric is the benchmark's
    ours, filtered = (rmse(orientation(gyr, acc, rate, k)) for k in ("offline", "ekf"))
    assert ours <= vqf
    assert ours < filtered
