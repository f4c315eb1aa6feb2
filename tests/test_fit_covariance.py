"""Do 95 % intervals cover the truth 95 times in a hundred? White, coloured and filtered noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import butter, filtfilt, lfilter

from pinotwin.signals import burg
from pinotwin.solve.jackknife import jackknife, without_each
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.sandwich import long_run
from tests.stacked import AxisRows, interval, stack

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


def coverage(noise, inference, draws=150, n=500, keep=1.0):
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
        problem = stack(parts, [f"p{k}" for k in range(30)])
        fit = linear(problem, Options(inference=inference))
        low, high = interval(fit).T
        hits.append((low < truth) & (truth < high))
    return float(np.mean(hits))


@pytest.mark.parametrize("noise", [white, ar1, filtered], ids=lambda f: f.__name__)
def test_intervals_cover_the_truth(noise):
    assert 0.90 <= coverage(noise, "blocks", draws=300) <= 0.98


def test_independent_residuals_are_a_wrong_belief_for_coloured_ones():
    assert coverage(ar1, "ols", draws=40) < 0.70
    assert coverage(filtered, "ols", draws=40) < 0.85
    assert 0.90 <= coverage(white, "ols", draws=40) <= 0.98


def test_holes_in_the_data_do_not_spoil_the_coverage():
    assert 0.89 <= coverage(ar1, "blocks", draws=60, n=800, keep=0.7) <= 0.98


def test_heteroscedastic_noise_is_covered_too():
    """Noise that grows with the regressor: only the scores know."""
    rng = np.random.default_rng(4)
    hits = []
    for _ in range(200):
        x = np.sin(np.arange(600) * 0.05) ** 3
        e = rng.standard_normal(600) * np.abs(x) * 3
        problem = stack([AxisRows(x[:, None], x + e, np.arange(600))], ["p"])
        low, high = interval(linear(problem, Options()))[0]
        hits.append(low < 1 < high)
    assert np.mean(hits) > 0.90


def test_long_run_is_the_textbook_sum():
    s = np.random.default_rng(2).standard_normal((300, 2))
    expected = s.T @ s
    for lag in range(1, 13):
        G = s[lag:].T @ s[:-lag]
        expected += (1 - lag / 13) * (G + G.T)
    assert_allclose(long_run(s, 12), expected, rtol=1e-9, atol=1e-9)


def test_blocks_are_not_correlated_with_each_other():
    """Two halves far apart in time and two blocks with the same times mean the same."""
    rng = np.random.default_rng(5)
    n = 400
    W, e = rng.standard_normal((2 * n, 2)), ar1(rng, 2 * n)[:, 0]
    time = np.arange(2 * n)
    far = np.where(time < n, time, time + 10 * n)
    blocks = (time >= n).astype(int)
    one = linear(stack([AxisRows(W, e, far)], "ab"))
    two = linear(stack([AxisRows(W, e, time % n, blocks)], "ab"))
    assert_allclose(one.covariance, two.covariance, rtol=1e-9)


def test_decimated_time_is_the_same_time():
    rng = np.random.default_rng(6)
    W, e = rng.standard_normal((300, 2)), ar1(rng, 300)[:, 0]
    one = linear(stack([AxisRows(W, e, np.arange(300))], "ab"))
    two = linear(stack([AxisRows(W, e, 7 + 5 * np.arange(300))], "ab"))
    assert_allclose(one.covariance, two.covariance, rtol=1e-12)


def test_covariance_is_that_of_each_second_freed_of_what_the_fit_took():
    """Two axes, two stretches, a hole: (I - H_g)^-1/2 e_g of every second; of white noise F F' in the mean."""
    rng = np.random.default_rng(7)
    n, theta = 400, [1.0, 2.0, 3.0]
    W, time = rng.standard_normal((2, n, 3)), np.arange(n)
    W[0, :, 2] = 0.0
    there = (time < 120) | (time > 150)
    stretch = (time >= 200).astype(int)
    parts = [
        AxisRows(x[there], x[there] @ theta + ar1(rng, n)[there, 0], time[there], stretch[there]) for x in W
    ]
    problem = replace(stack(parts, "abc"), second=20.0)
    fit = linear(problem, Options(sigma=np.array([1.0, 3.0])))
    level = np.where(problem.axis == 0, 1.0, 3.0)
    A = problem.W.toarray() / level[:, None]
    e, inverse = fit.residual / level, np.linalg.inv(A.T @ A)
    left, steps, share, white = np.eye(len(A)) - A @ inverse @ A.T, [], [], 0.0
    for k in np.unique(problem.time // 20):
        own = problem.time // 20 == k
        power, U = np.linalg.eigh(left[np.ix_(own, own)])
        step = inverse @ A[own].T @ (U / np.sqrt(power)) @ U.T
        steps.append(step @ e[own])
        share.append(np.diag(inverse @ A[own].T @ A[own] @ inverse))
        white += step @ left[np.ix_(own, own)] @ step.T
    assert_allclose(fit.covariance, np.array(steps).T @ steps, rtol=1e-9)
    assert_allclose(white, inverse, rtol=1e-9, atol=1e-15)
    share = np.array(share)
    assert_allclose(fit.dof, share.sum(axis=0) ** 2 / (share**2).sum(axis=0) - 1.0, rtol=1e-9)


def test_what_rows_behind_a_turn_do_is_in_the_error():
    """A third of the square of the step that a fit without them takes."""
    rng = np.random.default_rng(11)
    n, theta = 600, np.array([1.0, 2.0])
    W, time = rng.standard_normal((n, 2)), np.arange(n)
    turning = time % 60 < 6
    y = W @ theta - 0.4 * turning * W[:, 0] + ar1(rng, n)[:, 0]
    plain = replace(stack([AxisRows(W, y, time)], "ab"), second=20.0)
    options = Options(sigma=np.array([1.0]))
    one, two = (linear(problem, options) for problem in (plain, replace(plain, turning=turning)))
    step = np.linalg.lstsq(W[~turning], y[~turning], rcond=None)[0] - one.theta
    assert_allclose(two.theta, one.theta)
    assert_allclose(two.covariance - one.covariance, np.outer(step, step) / 3.0, rtol=1e-6, atol=1e-12)
    assert two.standard_errors[0] > abs(step[0]) / 2.0
    share = np.diag(one.covariance) / np.diag(two.covariance)
    assert_allclose(two.dof * share**2, one.dof, rtol=1e-6)


def test_what_few_seconds_tell_has_few_degrees_of_freedom():
    """A knot that a log passes in three of its twenty seconds: its interval holds, wide as it is."""
    rng = np.random.default_rng(9)
    W = np.zeros((1000, 2))
    W[:, 0], W[100:250, 1] = rng.standard_normal(1000), 1.0
    hits = []
    for _ in range(300):
        problem = stack([AxisRows(W, ar1(rng, 1000)[:, 0], np.arange(1000))], "ab")
        fit = linear(replace(problem, second=50.0))
        low, high = interval(fit).T
        hits.append((low < 0.0) & (high > 0.0))
    assert_allclose(fit.dof, [18.0, 2.0], atol=0.7)
    assert (np.mean(hits, axis=0) > 0.92).all()


def test_burg_finds_the_autoregression():
    rng = np.random.default_rng(8)
    w = rng.standard_normal(6000)
    a = np.array([1.2, -0.5])
    e = lfilter([1], [1, *-a], w)
    assert_allclose(burg([e[:2500], e[2500:]], 2)[0], a, atol=0.04)


def test_leaving_blocks_out_by_sums_is_leaving_their_rows_out():
    rng = np.random.default_rng(3)
    X = rng.standard_normal((120, 3)) * [1.0, 1e-4, 1e5]
    y = X @ [1.0, 2e4, 3e-5] + rng.standard_normal(120)
    blocks = [slice(k, k + 20) for k in range(0, 120, 20)]
    each = without_each(X, y, blocks, 1e-12)
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
        fit = linear(stack([AxisRows(W * scale, y, np.arange(n))], [f"p{k}" for k in range(p)]))
        errors.append(fit.standard_errors * scale)
    assert_allclose(errors, np.tile(errors[0], (5, 1)), rtol=1e-9)
