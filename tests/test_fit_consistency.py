"""Physical consistency: exact where the data allow it, a stated cost where they do not."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from pinotwin.errors import DataError
from pinotwin.solve import consistency
from pinotwin.solve.consistency import Bodies, Evidence, consistent
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.pseudoinertia import pseudo_inertia
from tests.stacked import AxisRows, stack


def robot(seed=0, joints=3):
    """Random chain in Pinocchio, its base matrix and standard parameters with rotors behind."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    model = pin.Model()
    parent = 0
    for k in range(joints):
        joint = (pin.JointModelRX, pin.JointModelRY, pin.JointModelPZ)[k % 3]()
        parent = model.addJoint(parent, joint, pin.SE3(pin.SE3.Random().rotation, rng.random(3)), f"j{k}")
        centre = rng.uniform(-0.2, 0.2, 3)
        cloud = centre + 0.1 * rng.standard_normal((30, 3))
        masses = rng.uniform(0.1, 1, 30)
        com = masses @ cloud / masses.sum()
        arm = cloud - com
        inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arm, strict=True))
        model.appendBodyToJoint(parent, pin.Inertia(masses.sum(), com, inertia), pin.SE3.Identity())
    pi = np.concatenate([model.inertias[k + 1].toDynamicParameters() for k in range(joints)])
    return model, np.concatenate([pi, np.full(joints, 0.02)])


def rows(model, rng, n):
    data = model.createData()
    nv = model.nv
    W = np.zeros((n, nv, 11 * nv))
    for k in range(n):
        q, v, a = (rng.uniform(-1, 1, nv) * s for s in (2, 3, 10))
        W[k, :, : 10 * nv] = pin.computeJointTorqueRegressor(model, data, q, v, a)
        W[k, np.arange(nv), 10 * nv + np.arange(nv)] = a
    return W


def base(W, tolerance=1e-8):
    """Base columns and P by SVD-free elimination: independent columns, the rest regrouped."""
    from scipy.linalg import qr, solve_triangular

    _, R, pivot = qr(W, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > tolerance * abs(R[0, 0])))
    P = np.zeros((rank, W.shape[1]))
    P[:, pivot[:rank]] = np.eye(rank)
    P[:, pivot[rank:]] = solve_triangular(R[:rank, :rank], R[:rank, rank:])
    P[np.abs(P) < 1e-9] = 0
    return pivot[:rank], P


def fitted(seed, noise, n=200, prior_error=0.1):
    model, pi = robot(seed)
    rng = np.random.default_rng(seed + 100)
    nv = model.nv
    W = rows(model, rng, n)
    flat = W.transpose(1, 0, 2).reshape(-1, 11 * nv)
    index, P = base(flat)
    v = rng.standard_normal((nv, n))
    parts = []
    for i in range(nv):
        extra = np.zeros((n, nv))
        extra[:, i] = v[i]
        y = W[:, i] @ pi + 0.5 * v[i] + noise * rng.standard_normal(n)
        parts.append(AxisRows(np.column_stack([W[:, i][:, index], extra]), y, np.arange(n)))
    names = [f"b{i}" for i in range(len(index))] + [f"fv{i}" for i in range(nv)]
    problem = stack(parts, names)
    pi0 = pi * (1 + prior_error)  # a heavier machine is consistent too
    bodies = tuple(np.arange(10 * k, 10 * k + 10) for k in range(nv))
    lower = np.concatenate([np.full(len(index), -np.inf), np.zeros(nv)])
    fit = linear(problem, Options(lower=lower))
    return fit, Bodies(P, pi0, bodies, np.arange(10 * nv, 11 * nv)), np.arange(len(index)), pi


def smallest(pi, bodies):
    return min(np.linalg.eigvalsh(pseudo_inertia(pi[i]))[0] for i in bodies.bodies)


def test_pseudo_inertia_is_pinocchios():
    inertia = pin.Inertia.Random()
    assert_allclose(
        pseudo_inertia(inertia.toDynamicParameters()),
        pin.PseudoInertia.FromInertia(inertia).toMatrix(),
        atol=1e-12,
    )


@pytest.mark.parametrize("seed", range(4))
def test_feasible_base_parameters_are_left_alone(seed):
    fit, bodies, beta, truth = fitted(seed, noise=1e-4)
    out = consistent(Evidence.of(fit, beta), bodies)
    assert not out.moved
    assert out.cost_ratio == 1.0
    assert_allclose(out.theta, fit.theta, rtol=0, atol=0)
    assert_allclose(bodies.P @ out.pi, fit.theta[beta], rtol=1e-9, atol=1e-12)
    assert smallest(out.pi, bodies) > 0
    assert (out.pi[bodies.rotors] >= 0).all()
    # Nearest the prior: no further from it than the truth is, in the same units.
    size = np.maximum(np.abs(bodies.pi0), 1e-3)
    assert np.linalg.norm((out.pi - bodies.pi0) / size) < 30 * np.linalg.norm((truth - bodies.pi0) / size)


def test_unconstrained_distance_is_the_minimum_norm():
    fit, bodies, beta, _ = fitted(0, noise=1e-6, prior_error=1e-3)
    from pinotwin.solve.pseudoinertia import sizes

    out = consistent(Evidence.of(fit, beta), bodies)
    unit = np.concatenate([s.units() for s in sizes(bodies.pi0, bodies.bodies)])
    unit = np.concatenate([unit, bodies.pi0[bodies.rotors]])
    gap = fit.theta[beta] - bodies.P @ bodies.pi0
    free = np.linalg.norm(bodies.P, axis=0) > 0
    free[:30] |= np.repeat(free[:30].reshape(3, 10).any(axis=1), 10)
    d = np.linalg.pinv(bodies.P * (unit * free)) @ gap
    assert smallest(bodies.pi0 + unit * d, bodies) > 1e-5  # the cone does not bind here
    assert_allclose(out.pi, bodies.pi0 + unit * d, atol=1e-6)


def test_infeasible_base_parameters_move_at_a_stated_cost():
    fit, bodies, beta, _ = fitted(1, noise=3.0, n=30)
    evidence = Evidence.of(fit, beta)
    out = consistent(evidence, bodies)
    assert out.moved
    assert out.cost_ratio > 1
    assert_allclose(bodies.P @ out.pi, out.theta[beta], rtol=1e-9, atol=1e-12)
    assert smallest(out.pi, bodies) > -1e-9
    assert (out.pi[bodies.rotors] > -1e-9).all()
    assert (out.theta[len(beta) :] >= 0).all()
    weight = 1 / fit.sigma[fit.problem.axis_place]
    costs = [np.sum((weight * (fit.problem.y - fit.problem.W @ t)) ** 2) for t in (out.theta, fit.theta)]
    assert_allclose(out.cost_ratio, costs[0] / costs[1], rtol=1e-6)


def test_optimum_beats_every_consistent_neighbour():
    fit, bodies, beta, truth = fitted(1, noise=3.0, n=30)
    evidence = Evidence.of(fit, beta)
    out = consistent(evidence, bodies)

    def cost(theta):
        return np.sum((fit.factor @ theta - fit.right) ** 2)

    others = fit.theta[len(beta) :]
    rng = np.random.default_rng(5)
    for _ in range(200):
        # Convex combinations of consistent parameters are consistent.
        other = truth * rng.uniform(0.7, 1.3)
        share = 10 ** rng.uniform(-4, 0)
        pi = (1 - share) * out.pi + share * other
        phi = (1 - share) * out.theta[len(beta) :] + share * np.maximum(others, 0)
        assert cost(np.concatenate([bodies.P @ pi, phi])) > cost(out.theta) - 1e-5


def test_bodies_that_are_not_seen_keep_the_prior():
    fit, bodies, beta, _ = fitted(2, noise=1e-4)
    P = np.column_stack([bodies.P, np.zeros((len(bodies.P), 10))])
    pi0 = np.concatenate([bodies.pi0, np.zeros(10)])  # a massless link, hidden behind the rest
    more = Bodies(P, pi0, (*bodies.bodies, np.arange(33, 43)), bodies.rotors)
    out = consistent(Evidence.of(fit, beta), more)
    assert not out.moved
    assert_allclose(out.pi[33:], 0, atol=0)


def test_shapes_that_do_not_fit_are_refused():
    fit, bodies, beta, _ = fitted(0, noise=1e-4)
    with pytest.raises(DataError, match="beta names"):
        consistent(Evidence.of(fit, beta[1:]), bodies)
    with pytest.raises(DataError, match="ten parameters"):
        consistent(Evidence.of(fit, beta), Bodies(bodies.P, bodies.pi0, (np.arange(9),)))


@pytest.mark.parametrize("stalls", [False, True])
def test_a_compromise_with_thousands_of_deviations_to_close_is_found(monkeypatch, stalls):
    """A rotor inertia a little below zero, thousands of standard deviations: with hum Clarabel stalled."""
    if stalls:
        plain = consistency.best
        monkeypatch.setattr(
            consistency, "best", lambda *a, unit=1.0: None if unit == 1.0 else plain(*a, unit=unit)
        )
    rng = np.random.default_rng(3)
    pi0 = np.zeros(22)
    for body, mass in ((0, 224.0), (10, 135.0)):
        pi0[body : body + 10] = [mass, 1.37, 3.16, -2.35, 3.6, 0.0, 4.8, 0.0, 0.0, 5.4]
    P = np.zeros((4, 22))
    P[[0, 1, 2, 3], [20, 0, 21, 10]] = 1.0
    sizes = np.array([0.6, 5.25, 35.0, 345.0, 0.1, 0.5, 0.4, 0.4, 6.9, 35.0, 26.5, 23.0])
    factor = np.linalg.qr(rng.standard_normal((12, 12)))[0] * sizes
    theta = np.array([-3.33, 224.7, 0.115, 122.3, 413.0, 96.2, -63.9, 46.2, 168.6, 58.2, 26.1, -26.0])
    lower = np.full(12, -np.inf)
    lower[[4, 5, 8, 9]] = 0.0
    bodies = Bodies(P, pi0, (np.arange(10), np.arange(10, 20)), np.array([20, 21]))
    out = consistent(Evidence(factor, factor @ theta, theta, np.arange(4), lower, 12653.0), bodies)
    assert out.moved
    assert 0.0 <= out.pi[20] < 1e-3
    assert_allclose(out.theta[1:], theta[1:], rtol=0.05)
    unseen = np.r_[1:10, 11:20]
    assert_allclose(out.pi[unseen], pi0[unseen], atol=1e-6 if stalls else 1e-4)
