"""Do 95 % intervals cover the truth 95 times in a hundred? White, coloured and filtered noise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import butter, filtfilt, lfilter

from pinotwin.signals import burg
from pinotwin.solve.autoregression import autoregressions, whiten
from pinotwin.solve.jackknife import block_sums, jackknife, solved, without_each
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.problem import AxisRows, Problem

MIX = np.array([[1, 0.5, 0], [0, 1, 0.3], [0, 0, 1]])  # the axes' noise is correlated
LEVEL = np.array([1.0, 10.0, 0.1])


def regressors(rng, n, step=0.02):
    """Three coupled axes: 12 shared columns and 6 of friction and ripple for each."""
    t = np.arange(n) * step
    q, v, a = np.empty((3, n, 3))
    for i in range(3):
        w = 2 * np.pi * rng.uniform(0.1, 2, 5)
        size, phase = rng.uniform(0.3, 1, 5) / w * 6, rng.uniform(0, 2 * np.pi, 5)
        arg = w * t[:, None] + phase
        q[:, i], v[:, i] = np.sin(arg) @ size, np.cos(arg) @ (size * w)
        a[:, i] = -np.sin(arg) @ (size * w**2)
    out = []
    for i in range(3):
        W = np.zeros((n, 30))
        for k in range(12):
            j, l = rng.integers(0, 3, 2)
            W[:, k] = (
                a[:, i] * np.cos(q[:, j] + k),
                v[:, j] * v[:, l] * np.sin(q[:, i] + k),
                9.8 * np.sin(q[:, j] + 0.5 * k),
                a[:, j] * np.sin(0.7 * q[:, l] + k),
            )[rng.integers(0, 4)]
        sign = np.sign(v[:, i])
        own = (v[:, i], sign, 1 + 0 * sign, sign * np.exp(-2 * np.abs(v[:, i])))
        W[:, 12 + 6 * i : 18 + 6 * i] = np.stack([*own, np.cos(3 * q[:, i]), np.sin(3 * q[:, i])], axis=1)
        out.append(W)
    return out


def white(rng, n):
    return rng.standard_normal((n, 3)) @ MIX


def ar1(rng, n):
    return lfilter([1], [1, -0.9], rng.standard_normal((n + 100, 3)) @ MIX, axis=0)[100:]


def filtered(rng, n):
    """White noise at 500 Hz through a zero-phase 10 Hz low-pass, every tenth sample kept."""
    b, a = butter(4, 10 / 250)
    return 5 * filtfilt(b, a, rng.standard_normal((10 * n + 400, 3)) @ MIX, axis=0)[200:-200:10]


def coverage(noise, inference, whiten=0, draws=150, n=500, keep=1.0):
    rng = np.random.default_rng(1)
    hits = []
    for draw in range(draws):
        if draw % 20 == 0:
            Ws = regressors(rng, n)
            truth = rng.standard_normal(30)
            chosen = rng.random((3, n)) < keep
        e = noise(rng, n) * LEVEL
        time = np.arange(n)
        parts = [
            AxisRows(W[c], (W @ truth + e[:, i])[c], time[c])
            for i, (W, c) in enumerate(zip(Ws, chosen, strict=True))
        ]
        problem = Problem.stack(parts, [f"p{k}" for k in range(30)])
        fit = linear(problem, Options(inference=inference, whiten=whiten))
        low, high = fit.interval(0.95).T
        hits.append((low < truth) & (truth < high))
    return float(np.mean(hits))


@pytest.mark.parametrize("noise", [white, ar1, filtered], ids=lambda f: f.__name__)
@pytest.mark.parametrize("inference", ["hac", "stationary"])
def test_intervals_cover_the_truth(noise, inference):
    draws = 300 if inference == "hac" else 150
    assert 0.90 <= coverage(noise, inference, draws=draws) <= 0.98


def test_independent_residuals_are_a_wrong_belief_for_coloured_ones():
    assert coverage(ar1, "ols", draws=40) < 0.70
    assert coverage(filtered, "ols", draws=40) < 0.85
    assert 0.90 <= coverage(white, "ols", draws=40) <= 0.98


def test_holes_in_the_data_do_not_spoil_the_coverage():
    assert 0.89 <= coverage(ar1, "hac", draws=60, n=800, keep=0.7) <= 0.98


def test_whitened_rows_cover_too_and_sharpen():
    assert 0.90 <= coverage(ar1, "hac", whiten=4, draws=60) <= 0.98
    rng = np.random.default_rng(3)
    Ws, e = regressors(rng, 1000), ar1(rng, 1000)
    parts = [AxisRows(W, W.sum(1) + e[:, i], np.arange(1000)) for i, W in enumerate(Ws)]
    problem = Problem.stack(parts, [f"p{k}" for k in range(30)])
    plain, sharp = linear(problem), linear(problem, Options(whiten=4))
    assert np.median(sharp.standard_errors / plain.standard_errors) < 0.85
    assert np.linalg.norm(sharp.theta - 1) < np.linalg.norm(plain.theta - 1)
    assert len(sharp.residual) == 3000


def test_heteroscedastic_noise_needs_the_kernel():
    """Noise that grows with the regressor: only the scores know."""
    rng = np.random.default_rng(4)
    hits = {"hac": [], "stationary": []}
    for _ in range(200):
        x = np.sin(np.arange(600) * 0.05) ** 3
        e = rng.standard_normal(600) * np.abs(x) * 3
        problem = Problem.stack([AxisRows(x[:, None], x + e, np.arange(600))], ["p"])
        for inference, found in hits.items():
            low, high = linear(problem, Options(inference=inference)).interval()[0]
            found.append(low < 1 < high)
    assert np.mean(hits["hac"]) > 0.90
    assert np.mean(hits["stationary"]) < 0.85


def test_blocks_are_not_correlated_with_each_other():
    """Two halves far apart in time and two blocks with the same times mean the same."""
    rng = np.random.default_rng(5)
    n = 400
    W, e = rng.standard_normal((2 * n, 2)), ar1(rng, 2 * n)[:, 0]
    time = np.arange(2 * n)
    far = np.where(time < n, time, time + 10 * n)
    blocks = (time >= n).astype(int)
    one = linear(Problem.stack([AxisRows(W, e, far)], "ab"))
    two = linear(Problem.stack([AxisRows(W, e, time % n, blocks)], "ab"))
    assert_allclose(one.covariance, two.covariance, rtol=1e-9)


def test_decimated_time_is_the_same_time():
    rng = np.random.default_rng(6)
    W, e = rng.standard_normal((300, 2)), ar1(rng, 300)[:, 0]
    one = linear(Problem.stack([AxisRows(W, e, np.arange(300))], "ab"))
    two = linear(Problem.stack([AxisRows(W, e, 7 + 5 * np.arange(300))], "ab"))
    assert_allclose(one.covariance, two.covariance, rtol=1e-12)


def test_kernel_is_the_textbook_one():
    """Bartlett sum written out over lags, for one axis without holes."""
    rng = np.random.default_rng(7)
    n = 400
    W = rng.standard_normal((n, 2))
    y = W @ [1.0, 2.0] + ar1(rng, n)[:, 0]
    problem = Problem.stack([AxisRows(W, y, np.arange(n))], "ab")
    fit = linear(problem, Options(sigma=np.ones(1)))
    H = np.linalg.inv(W.T @ W)
    h = np.sum((W @ H) * W, axis=1)
    s = W * (fit.residual / (1 - h))[:, None]
    L = fit.lags
    Omega = s.T @ s
    for lag in range(1, L):
        G = s[lag:].T @ s[:-lag]
        Omega += (1 - lag / L) * (G + G.T)
    b = L / n
    Omega /= 1 - b + b * b / 3
    power = fit.residual @ fit.residual
    factor = power / (power - np.trace(H @ Omega)) * (1 - 2 / n)
    assert_allclose(fit.covariance, H @ Omega @ H * max(factor, 1.0), rtol=1e-9)


def test_burg_finds_the_autoregression_and_whitening_undoes_it():
    rng = np.random.default_rng(8)
    w = rng.standard_normal(6000)
    a = np.array([1.2, -0.5])
    e = lfilter([1], [1, *-a], w)
    assert_allclose(burg([e[:2500], e[2500:]], 2)[0], a, atol=0.04)
    time = np.delete(np.arange(6000), slice(1000, 1010))
    problem = Problem.stack([AxisRows(np.ones((5990, 1)), e[time], time)], ["o"])
    models = autoregressions(problem, problem.y, 2)
    out, keep = whiten(problem, problem.y[:, None], models)
    assert keep.sum() == 5990 - 4
    assert_allclose(out[keep, 0], w[time][keep], atol=0.25)


def test_leaving_blocks_out_by_sums_is_leaving_their_rows_out():
    rng = np.random.default_rng(3)
    X = rng.standard_normal((120, 3)) * [1.0, 1e-4, 1e5]
    y = X @ [1.0, 2e4, 3e-5] + rng.standard_normal(120)
    blocks = [slice(k, k + 20) for k in range(0, 120, 20)]
    each = solved(*(without_each(x) for x in block_sums(X, y, blocks)), 1e-12)
    for b, theta in zip(blocks, each[:-1], strict=True):
        rest = np.setdiff1d(np.arange(120), np.arange(b.start, b.stop))
        assert_allclose(theta, np.linalg.lstsq(X[rest], y[rest], rcond=None)[0], rtol=1e-6)
    assert_allclose(each[-1], np.linalg.lstsq(X, y, rcond=None)[0], rtol=1e-6)
    error = np.sqrt(np.diag(jackknife(each[:-1])))
    usual = np.sqrt(np.diag(np.linalg.inv(X.T @ X)))
    assert_allclose(error, usual, rtol=0.8)
    assert (error > 0.3 * usual).all()


def test_standard_errors_do_not_hang_on_rounding():
    """Columns in other units differ in their last digit: another pivot comes first, the errors stay."""
    rng = np.random.default_rng(5)
    n, p = 3000, 12
    W = lfilter([1.0], [1.0, -0.99], rng.standard_normal((n, p)), axis=0)
    y = W @ rng.standard_normal(p) + lfilter([1.0], [1.0, -0.99], rng.standard_normal(n))
    errors = []
    for factor in (1.0, 1.5, 1.1, 0.7, 1.3):
        scale = np.where(np.arange(p) % 3 == 1, factor, 1.0)
        fit = linear(Problem.stack([AxisRows(W * scale, y, np.arange(n))], [f"p{k}" for k in range(p)]))
        errors.append(fit.standard_errors * scale)
    assert_allclose(errors, np.tile(errors[0], (5, 1)), rtol=1e-9)
