"""Linear least squares: exactness, rank, weights, bounds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import lsq_linear
from scipy.sparse import csr_array

from pinotwin.errors import DataError
from pinotwin.solve.bounds import active_set
from pinotwin.solve.crossval import held_out
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import r_factor
from tests.stacked import AxisRows, interval, stack


def problem_of(rng, n=400, p=5, levels=(0.1, 10.0), truth=None, W=None):
    truth = rng.standard_normal(p) if truth is None else truth
    parts = []
    for i, level in enumerate(levels):
        Wi = rng.standard_normal((n, p)) if W is None else W[i]
        parts.append(AxisRows(Wi, Wi @ truth + level * rng.standard_normal(n), np.arange(n)))
    return stack(parts, [f"p{i}" for i in range(len(truth))]), truth


def test_r_factor_equals_numpy_whatever_the_blocks():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((5321, 7)) * np.geomspace(1, 1e-6, 7)
    reference = np.abs(np.linalg.qr(A, mode="r"))
    assert_allclose(np.abs(r_factor(A, 100)), reference, rtol=1e-10, atol=1e-14)
    assert r_factor(A[:3]).shape == (7, 7)


def test_known_levels_give_the_textbook_weighted_estimate():
    rng = np.random.default_rng(1)
    problem, _ = problem_of(rng)
    sigma = np.array([0.1, 10.0])
    fit = linear(problem, Options(sigma=sigma, inference="ols"))
    w = 1 / sigma[problem.axis]
    reference = np.linalg.lstsq(problem.W.toarray() * w[:, None], problem.y * w)[0]
    assert_allclose(fit.theta, reference, rtol=1e-10)
    H = (problem.W.toarray() * w[:, None]).T @ (problem.W.toarray() * w[:, None])
    e = (problem.y - problem.W @ reference) * w
    assert_allclose(fit.covariance, np.linalg.inv(H) * (e @ e) / (len(e) - 5), rtol=1e-8)


def test_levels_are_found_and_sharpen_the_estimate():
    rng = np.random.default_rng(2)
    problem, truth = problem_of(rng, n=2000)
    fit = linear(problem)
    assert_allclose(fit.sigma, [0.1, 10.0], rtol=0.05)
    plain = np.linalg.lstsq(problem.W.toarray(), problem.y)[0]
    assert np.linalg.norm(fit.theta - truth) < 0.1 * np.linalg.norm(plain - truth)


def test_what_the_data_leave_open_stays_at_the_prior_and_is_named():
    rng = np.random.default_rng(4)
    n = 300
    W = rng.standard_normal((n, 6)) * [1, 10, 1, 0.1, 1, 1]
    W[:, 2] = 0.0  # unexcited
    W[:, 4] = 2 * W[:, 1] - W[:, 3]  # 1, 3, 4 tied by one relation
    y = W @ np.array([1.0, 2.0, 0.0, 3.0, 0.0, -1.0])
    problem = stack([AxisRows(W, y, np.arange(n))], list("abcdef"))
    mean = np.array([9.0, 1.5, 7.0, 2.0, 0.7, 9.0])
    fit = linear(problem, Options(prior=mean))
    assert fit.rank == 4
    assert fit.unexcited == (2,)
    assert fit.group_names() == (("b", "d", "e"),)
    assert fit.determined.tolist() == [True, False, False, False, False, True]
    assert_allclose(fit.theta[[0, 5]], [1, -1], rtol=1e-8)
    assert fit.theta[2] == 7.0
    # Oracle: constrained optimum of the distance to the prior, in column lengths, on the line of equal fits.
    line = np.array([0, 2.0, 0, -1.0, -1.0, 0])
    base = np.array([1.0, 2.0, 7.0, 3.0, 0.0, -1.0])
    size = np.linalg.norm(W, axis=0)
    step = np.sum(line * (mean - base) * size**2) / np.sum(line**2 * size**2)
    assert_allclose(fit.theta, base + step * line, rtol=1e-7)
    assert np.isinf(fit.standard_errors[[1, 2, 3, 4]]).all()
    assert np.isfinite(fit.standard_errors[[0, 5]]).all()


def test_nothing_excited_at_all():
    problem = stack([AxisRows(np.zeros((9, 2)), np.ones(9), np.arange(9))], "ab")
    fit = linear(problem, Options(prior=np.array([1.0, 2.0])))
    assert fit.rank == 0
    assert fit.unexcited == (0, 1)
    assert_allclose(fit.theta, [1, 2])


def test_units_of_the_parameters_do_not_matter():
    rng = np.random.default_rng(5)
    problem, _ = problem_of(rng)
    unit = np.geomspace(1e-5, 1e5, 5)
    other = problem.with_columns(csr_array(problem.W.toarray() * unit), problem.names)
    a, b = linear(problem), linear(other)
    assert_allclose(b.theta * unit, a.theta, rtol=1e-8)
    assert_allclose(b.standard_errors * unit, a.standard_errors, rtol=1e-6)
    assert_allclose(a.condition, b.condition, rtol=1e-6)


def test_ridge_equals_extra_rows():
    rng = np.random.default_rng(6)
    problem, truth = problem_of(rng, n=20, levels=(1.0,))
    mean, std = truth + 0.1, np.full(5, 0.2)
    fit = linear(problem, Options(prior=mean, ridge=std, sigma=np.ones(1)))
    A = np.concatenate([problem.W.toarray(), np.diag(1 / std)])
    reference = np.linalg.lstsq(A, np.concatenate([problem.y, mean / std]))[0]
    assert_allclose(fit.theta, reference, rtol=1e-9)


def test_bounds_equal_scipy_and_are_reported():
    rng = np.random.default_rng(7)
    truth = np.array([1.0, -0.5, 2.0, -3.0, 0.1])
    problem, _ = problem_of(rng, levels=(1.0,), truth=truth)
    lower = np.array([0, 0, 0, -np.inf, -np.inf])
    upper = np.array([np.inf, np.inf, 1.5, np.inf, np.inf])
    fit = linear(problem, Options(lower=lower, upper=upper, sigma=np.ones(1)))
    reference = lsq_linear(problem.W.toarray(), problem.y, (lower, upper), tol=1e-14).x
    assert_allclose(fit.theta, reference, atol=1e-7)
    assert fit.active.tolist() == [False, True, True, False, False]
    assert (interval(fit)[:, 0] >= lower).all()
    assert (interval(fit)[:, 1] <= upper).all()


def test_the_twoactive_sets_agree(monkeypatch):
    rng = np.random.default_rng(17)
    A, b = rng.standard_normal((30, 6)), rng.standard_normal(30)
    low = np.array([-0.1, 0.0, 0.05, 0.0, 0.2, -1.0])
    usual = active_set(A, b, low, np.full(6, np.inf))

    def rounds(*_, **how):
        if how["method"] == "bvls":
            raise FloatingPointError("divide by zero encountered in divide")
        return lsq_linear(*_, **how)

    monkeypatch.setattr("scipy.optimize.lsq_linear", rounds)
    assert_allclose(active_set(A, b, low, np.full(6, np.inf)), usual, atol=1e-12)
    assert (usual == low).sum() in range(1, 6)
    both = active_set(A, b, low, low + 0.1)  # bounds on both sides: by an interior path
    assert_allclose(both, lsq_linear(A, b, (low, low + 0.1), method="bvls").x, atol=1e-6)


def test_factor_reproduces_the_cost():
    problem, _ = problem_of(np.random.default_rng(8))
    fit = linear(problem)
    weight = 1 / fit.sigma[problem.axis_place]

    def cost(theta):
        return np.sum((weight * (problem.y - problem.W @ theta)) ** 2)

    def small(theta):
        return np.sum((fit.factor @ theta - fit.right) ** 2)

    other = fit.theta + 0.3
    assert_allclose(small(other) - small(fit.theta), cost(other) - cost(fit.theta), rtol=1e-8)


def test_held_out_error_is_the_noise_and_shows_overfitting():
    rng = np.random.default_rng(10)
    n = 600
    W = rng.standard_normal((n, 120))
    y = 3 * W[:, 0] + rng.standard_normal(n)
    size = np.linalg.norm(y)
    lean = np.linalg.norm(held_out(stack([AxisRows(W[:, :1], y, np.arange(n))], ["a"])).error) / size
    names = [f"p{i}" for i in range(120)]
    fat_problem = stack([AxisRows(W, y, np.arange(n))], names)
    fat = np.linalg.norm(held_out(fat_problem).error) / size
    assert_allclose(lean, 1 / np.sqrt(10), rtol=0.1)
    assert np.linalg.norm(linear(fat_problem).residual) / size < 0.95 * lean
    assert fat > 1.08 * lean


def test_held_out_equals_refits_on_the_remaining_rows():
    problem, _ = problem_of(np.random.default_rng(11), n=200, levels=(1.0, 2.0))
    options = Options(sigma=np.array([1.0, 2.0]))
    out = held_out(problem, folds=4, guard=5, options=options)
    total = np.zeros(2)
    for k in range(4):
        a, b = 50 * k, 50 * (k + 1)
        train = (problem.time < a - 5) | (problem.time >= b + 5)
        theta = linear(problem.rows(train), options).theta
        e = problem.y - problem.W @ theta
        inside = (problem.time >= a) & (problem.time < b)
        total += [np.sum(e[inside & (problem.axis == i)] ** 2) for i in range(2)]
    assert_allclose([np.sum(out.error[s] ** 2) for s in problem.slices.values()], total, rtol=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("a",)}, "regressor has shape (4, 2) for 1 named parameters"),
        ({"y": np.zeros(3)}, "W has 4 rows, y has 3"),
        ({"y": np.full(4, np.nan)}, "NaN or infinite"),
        ({"time": np.array([0, 1, 1, 2])}, "strictly increasing time"),
    ],
)
def test_rows_that_are_no_problem_are_refused(change, message):
    good = {
        "W": csr_array(np.ones((4, 2))),
        "y": np.ones(4),
        "axis": np.zeros(4, int),
        "time": np.arange(4),
        "names": ("a", "b"),
        "block": np.zeros(4, int),
    }
    with pytest.raises(DataError, match=message.replace("(", r"\(").replace(")", r"\)")):
        Problem(**(good | change))


def test_as_many_parameters_as_rows_are_refused():
    problem, _ = problem_of(np.random.default_rng(13), n=5, levels=(1.0,))
    with pytest.raises(DataError, match="5 rows for 5 parameters leave nothing to judge"):
        linear(problem)
