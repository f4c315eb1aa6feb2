"""Variable projection: the right basin, the right digits, the right uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import stdtrit

from pinotwin.errors import DataError
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.moving import Moving
from pinotwin.solve.problem import Problem
from pinotwin.solve.projection import Projection
from pinotwin.solve.separable import _Search, separable, variable_projection
from tests.stacked import AxisRows, interval, stack

LEVEL = np.array([1.0, 5.0, 0.2])


def motion(rng, n, step=0.01):
    t = np.arange(n) * step
    w = 2 * np.pi * rng.uniform(0.05, 1.2, 6)
    size, phase = rng.uniform(0.3, 1, 6) / w**0.7, rng.uniform(0, 2 * np.pi, 6)
    arg = w * t[:, None] + phase
    return np.sin(arg) @ size * 2, np.cos(arg) @ (size * w) * 2, -np.sin(arg) @ (size * w**2) * 2


def values(shapes, block):
    return np.array([s.value for s in shapes if s.block == block])


def stribeck(name, rows, v):
    def columns(shape):
        return (np.sign(v) * np.exp(-np.abs(v) / shape[0]))[:, None]

    grid = np.geomspace(0.01, 5, 15)
    return Moving(
        name,
        rows,
        columns,
        ("s",),
        ("vs",),
        np.array([0.01]),
        np.array([5.0]),
        np.array([True]),
        (grid,),
    )


def ripple(name, rows, q):
    def columns(shape):
        return np.stack([np.cos(shape[0] * q), np.sin(shape[0] * q)], axis=1)

    return Moving(
        name,
        rows,
        columns,
        ("c", "s"),
        ("w",),
        np.array([2.0]),
        np.array([100.0]),
        np.array([False]),
        (np.linspace(2, 100, 400),),
    )


def modulated(name, rows, q):
    def columns(shape):
        pair = np.stack([np.cos(shape[0] * q), np.sin(shape[0] * q)], axis=1)
        return np.concatenate([pair, np.abs(np.sin(q + shape[1]))[:, None] * pair], axis=1)

    return Moving(
        name,
        rows,
        columns,
        ("c", "s", "mc", "ms"),
        ("w", "eps"),
        np.array([2.0, 0.0]),
        np.array([100.0, np.pi]),
        np.array([False, False]),
        (np.linspace(2, 100, 400), np.linspace(0, np.pi, 13)),
    )


class Machine:
    """Three axes that share an inertia, each with Stribeck and ripple, the second modulated."""

    def __init__(self, seed, n=1200):
        rng = np.random.default_rng(seed)
        self.n = n
        self.motion = [motion(rng, n) for _ in range(3)]
        self.vs = np.exp(rng.uniform(np.log(0.1), np.log(0.6), 3))
        self.w = rng.uniform(8, 90, 3)
        self.eps = rng.uniform(0.3, 2.8)
        self.moving = []
        self.clean, self.W = [], []
        for i, (q, v, a) in enumerate(self.motion):
            W = np.zeros((n, 10))
            W[:, 0] = a + 0.3 * self.motion[i - 1][2]
            W[:, 1 + 3 * i : 4 + 3 * i] = np.stack([v, np.sign(v), np.ones(n)], axis=1)
            rows = slice(i * n, (i + 1) * n)
            wave = modulated if i == 1 else ripple
            blocks = stribeck(f"{i}.stribeck", rows, v), wave(f"{i}.ripple", rows, q)
            effort = W @ np.linspace(1, 2, 10)
            effort += blocks[0].columns(self.vs[i : i + 1])[:, 0] * 0.8
            truth = self.truth(i)
            effort += blocks[1].columns(truth) @ np.array([0.3, 0.4, -0.3, 0.3])[: 4 if i == 1 else 2]
            self.moving += blocks
            self.clean.append(effort)
            self.W.append(W)

    def truth(self, i):
        return np.array([self.w[i], self.eps]) if i == 1 else self.w[i : i + 1]

    def problem(self, rng, noise):
        parts = [
            AxisRows(W, y + noise * LEVEL[i] * rng.standard_normal(self.n), np.arange(self.n))
            for i, (W, y) in enumerate(zip(self.W, self.clean, strict=True))
        ]
        return stack(parts, [f"p{k}" for k in range(10)])


@pytest.mark.parametrize("seed", range(4))
def test_stribeck_speeds_and_ripple_pitches_are_found(seed):
    machine = Machine(seed)
    fit, shapes = separable(machine.problem(np.random.default_rng(seed), 0.002), machine.moving)
    for i in range(3):
        assert_allclose(values(shapes, f"{i}.stribeck"), machine.vs[i], rtol=0.05)
        assert_allclose(values(shapes, f"{i}.ripple")[0], machine.w[i], atol=1e-3)
    assert_allclose(values(shapes, "1.ripple")[1], machine.eps, atol=0.02)
    assert all(not s.at_bound and np.isfinite(s.error) for s in shapes)
    assert_allclose(fit.sigma, 0.002 * LEVEL, rtol=0.1)


def test_intervals_of_shapes_and_coefficients_cover_the_truth():
    machine = Machine(7, n=500)
    rng = np.random.default_rng(0)
    truth = np.concatenate([x for i in range(3) for x in (machine.vs[i : i + 1], machine.truth(i))])
    shape_hits, theta_hits, widening = [], [], []
    for _ in range(12):
        fit, shapes = separable(machine.problem(rng, 0.02), machine.moving)
        shape_hits.append(
            [
                abs(s.x - (np.log(x) if s.log else x)) < stdtrit(fit.dof, 0.975) * s.error
                for s, x in zip(shapes, truth, strict=True)
            ]
        )
        amplitude = [k for k, name in enumerate(fit.names) if name in "cs"]
        known = np.array([0.8, 0.3, 0.4, 0.8, 0.3, 0.4, 0.8, 0.3, 0.4])
        low, high = interval(fit)[amplitude].T
        theta_hits.append((low < known) & (known < high))
        fixed = linear(fit.problem, Options(sigma=fit.sigma))
        widening.append(fit.standard_errors[amplitude] / fixed.standard_errors[amplitude])
    assert 0.88 <= np.mean(shape_hits) <= 0.99
    assert 0.88 <= np.mean(theta_hits) <= 0.99
    assert np.mean(widening, axis=0).max() > 1.3  # shapes taken as known would be too narrow


def test_search_is_deterministic():
    machine = Machine(1, n=600)
    problem = machine.problem(np.random.default_rng(1), 0.05)
    one, two = separable(problem, machine.moving), separable(problem, machine.moving)
    assert one[1] == two[1]


def test_blocks_that_are_known_are_not_scanned_again(monkeypatch):
    """The way back from a wider effect of one axis: the same answer for a fraction of the search."""
    machine = Machine(3)
    problem = machine.problem(np.random.default_rng(3), 0.002)
    whole = separable(problem, machine.moving)
    known = {b: values(whole[1], m.name) for b, m in enumerate(machine.moving[:-1])}
    scanned, scan = set(), _Search.scan
    monkeypatch.setattr(
        _Search, "scan", lambda self, b, *rest, **how: scanned.add(b) or scan(self, b, *rest, **how)
    )
    again = separable(problem, machine.moving, known=known)
    assert scanned == {len(machine.moving) - 1}
    assert_allclose([s.value for s in again[1]], [s.value for s in whole[1]], rtol=1e-5)
    assert_allclose(again[0].theta, whole[0].theta, rtol=1e-4, atol=1e-6)


def test_a_block_is_scanned_again_only_where_one_of_its_axis_jumped(monkeypatch):
    """What axes share moves no basin: every block is scanned twice, then those beside a block that jumped."""
    scanned, jumped = [], []
    machine, scan = Machine(3), _Search.scan

    def watched(self, b, others, refine=True):
        before = self.x[b]
        scan(self, b, others, refine)
        if refine:
            scanned.append(b // 2)
            jumped.append(b // 2 if self.cell(b, before) != self.cell(b, self.x[b]) else None)

    monkeypatch.setattr(_Search, "scan", watched)
    separable(machine.problem(np.random.default_rng(3), 0.002), machine.moving)
    assert sorted(scanned[:6]) == [0, 0, 1, 1, 2, 2]
    assert set(scanned[6:]) <= set(jumped)


def test_small_coordinates_keep_cost_and_gradient():
    machine = Machine(2, n=300)
    problem = machine.problem(np.random.default_rng(2), 0.1)
    free = np.full(10 + sum(len(m.names) for m in machine.moving), np.inf)
    projection = Projection.of(problem, machine.moving)
    small = variable_projection(projection, LEVEL, Options(lower=-free, upper=free, tolerance=1e-10))
    x = np.concatenate([m.search(np.array([g[len(g) // 3] for g in m.starts])) for m in machine.moving])

    def cost(x):
        W = np.zeros((len(problem.y), len(free)))
        W[:, :10] = problem.W.toarray()
        at = 10
        for m, part in zip(machine.moving, projection.split(x), strict=True):
            W[m.rows, at : at + len(m.names)] = m.at(part)
            at += len(m.names)
        weight = 1 / LEVEL[problem.axis]
        theta = np.linalg.lstsq(W * weight[:, None], problem.y * weight)[0]
        return np.sum((weight * (problem.y - W @ theta)) ** 2)

    residual, jacobian = small(x)
    assert_allclose(residual @ residual, cost(x), rtol=1e-10)
    gradient = 2 * jacobian.T @ residual
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-6 * max(1.0, abs(x[k]))
        quotient = (cost(x + step) - cost(x - step)) / (2 * step[k])
        assert_allclose(gradient[k], quotient, rtol=2e-3, atol=1e-4 * np.abs(gradient).max())


def test_dissipative_coefficients_stay_dissipative():
    machine = Machine(3, n=600)
    problem = machine.problem(np.random.default_rng(3), 0.05)
    y = problem.y.copy()
    y[:600] -= 1.6 * machine.moving[0].columns(machine.vs[:1])[:, 0]  # amplitude is now -0.8
    wrong = Problem(problem.W, y, problem.axis, problem.time, problem.names, problem.block)
    p = 10 + sum(len(m.names) for m in machine.moving)
    lower = np.full(p, -np.inf)
    lower[10] = 0.0
    fit, shapes = separable(wrong, machine.moving, Options(lower=lower))
    assert fit.theta[10] == 0.0
    assert fit.active[10]
    assert not np.isfinite(shapes[0].error)
    assert_allclose(values(shapes, "2.ripple")[0], machine.w[2], atol=0.05)


def test_a_shape_beyond_its_bounds_is_reported_at_the_bound():
    rng = np.random.default_rng(4)
    _, v, _ = motion(rng, 800)
    y = v + np.sign(v) * (1 + np.exp(-np.abs(v) / 0.5)) + 0.001 * rng.standard_normal(800)
    block = stribeck("s", slice(0, 800), v)
    tight = Moving(
        "s",
        block.rows,
        block.columns,
        block.names,
        block.shapes,
        np.array([0.01]),
        np.array([0.2]),
        block.log,
        block.starts,
    )
    problem = stack([AxisRows(np.stack([v, np.sign(v)], 1), y, np.arange(800))], "ab")
    (shape,) = separable(problem, [tight])[1]
    assert shape.at_bound
    assert shape.x > 0.5 * (shape.lower + shape.upper)
    assert_allclose(shape.value, 0.2, rtol=1e-5)


def test_rivals_are_named():
    """Two ripples of nearly equal strength for a block that may take only one."""
    rng = np.random.default_rng(5)
    q, v, _ = motion(rng, 1500)
    y = v + np.cos(20 * q) + 0.98 * np.sin(35 * q) + 0.01 * rng.standard_normal(1500)
    problem = stack([AxisRows(v[:, None], y, np.arange(1500))], ["fv"])
    search = _Search(problem, (ripple("r", slice(None), q),), Options(), {})
    search.sweep()
    best, *rivals = search.basins[0]
    found = sorted(float(b.x[0]) for b in (best, *rivals) if b.gain >= 0.9 * best.gain)
    assert_allclose(found, [20, 35], atol=0.05)


def test_rows_may_be_any_selection_over_several_axes():
    rng = np.random.default_rng(6)
    q, v, _ = motion(rng, 900)
    n = 900
    parts = [AxisRows(np.stack([v, 0 * v], 1), 2 * v + np.cos(17.3 * q), np.arange(n))]
    parts += [AxisRows(np.stack([0 * v, v], 1), 3 * v + 2 * np.cos(17.3 * q), np.arange(n))]
    parts = [AxisRows(p.W, p.y + 0.01 * rng.standard_normal(n), p.time) for p in parts]
    problem = stack(parts, "ab")
    rows = np.concatenate([np.arange(n), n + np.arange(n)])
    both = ripple("r", rows, q)

    def columns(shape):
        wave = np.cos(shape[0] * q)
        return np.concatenate([wave, 2 * wave])[:, None]

    joint = Moving("r", rows, columns, ("c",), both.shapes, both.lower, both.upper, both.log, both.starts)
    fit, shapes = separable(problem, [joint])
    assert_allclose(values(shapes, "r"), 17.3, atol=1e-3)
    assert_allclose(fit.theta, [2, 3, 1], atol=0.01)


def test_without_moving_blocks_it_is_the_linear_fit():
    problem = Machine(0, n=200).problem(np.random.default_rng(0), 0.1)
    assert_allclose(separable(problem, [])[0].theta, linear(problem).theta)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lower": np.array([200.0])}, "r: a lower bound is not below"),
        ({"log": np.array([True]), "lower": np.array([0.0])}, "needs a positive bound"),
        ({"starts": ()}, "1 shapes but 0 values of starts"),
        ({"starts": (np.zeros(0),)}, "r: no start value"),
    ],
)
def test_bad_blocks_are_refused(change, message):
    good = ripple("r", slice(None), np.zeros(3))
    with pytest.raises(DataError, match=message):
        Moving(**(good.__dict__ | change))
