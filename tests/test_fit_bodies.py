"""Bodies near the URDF's: the optimum, its limits where data tell all or nothing, whose a mass is, and dummies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import scipy
from numpy.testing import assert_allclose

from pinotwin.dynamics.parameters import dynamic_parameters, parameters, pseudo_inertia
from pinotwin.dynamics.plausible import plausible
from pinotwin.solve.bodies import Bodies, Evidence, near


def cloud(rng, mass=1.0):
    """Ten parameters of ten random points."""
    x = np.column_stack([rng.standard_normal((10, 3)), np.ones(10)])
    return dynamic_parameters((x.T * rng.uniform(0.1, 0.3, 10)) @ x) * mass


def chain(masses=(3.0, 2.0, 1.0), tensor=None):
    """Three turning joints, 0.4 m apart along x."""
    model = pin.Model()
    for k, mass in enumerate(masses):
        place = pin.SE3(np.eye(3), np.array([0.4 if k else 0.0, 0.0, 0.0]))
        joint = model.addJoint(k, (pin.JointModelRZ(), pin.JointModelRY())[k % 2], place, f"j{k}")
        own = mass * np.diag([0.01, 0.03, 0.03]) if tensor is None else tensor
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([0.2, 0.0, 0.0]), own), pin.SE3.Identity())
    return model


def problem(seed=0, size=10.0, rows=60):
    """Two bodies and two rotors of which ten sums are seen, three further coefficients that are not negative."""
    rng = np.random.default_rng(seed)
    pi0 = np.concatenate([cloud(rng), cloud(rng), [0.02, 0.02]])
    truth = np.concatenate([1.2 * pi0[:20], [0.1, 0.0]])
    P = rng.standard_normal((10, 22))
    theta = np.concatenate([P @ truth, [0.5, 1.0, 2.0]])
    factor = size * rng.standard_normal((rows, 13))
    right = factor @ theta + rng.standard_normal(rows)
    lower = np.concatenate([np.full(10, -np.inf), np.zeros(3)])
    found = np.linalg.lstsq(factor, right, rcond=None)[0]
    evidence = Evidence(factor, right, found, np.arange(10), lower, np.full(13, np.inf))
    return evidence, Bodies(P, pi0, 2), truth


def objective(x, evidence, bodies, weight):
    """The function as it is written down, of pi and the other coefficients; infinite outside the cone."""
    pi, others = x[: len(bodies.pi0)], x[len(bodies.pi0) :]
    left = evidence.factor @ np.concatenate([bodies.P @ pi, others]) - evidence.right
    total = 0.5 * left @ left
    for k in range(0, 10 * bodies.count, 10):
        J, J0 = pseudo_inertia(pi[k : k + 10]), pseudo_inertia(bodies.pi0[k : k + 10])
        if np.linalg.eigvalsh(J)[0] <= 0.0:
            return np.inf
        S = np.linalg.solve(J0, J)
        total += weight * (0.5 * np.trace(S @ S) - np.linalg.slogdet(S)[1])
    return total


UNIT = [pseudo_inertia(row) for row in np.eye(10)]


def slope(x, evidence, bodies, weight):
    """The gradient of the objective; zero outside the cone."""
    pi, others = x[: len(bodies.pi0)], x[len(bodies.pi0) :]
    left = evidence.factor.T @ (evidence.factor @ np.concatenate([bodies.P @ pi, others]) - evidence.right)
    out = np.concatenate([bodies.P.T @ left[:10], left[10:]])
    for k in range(0, 10 * bodies.count, 10):
        J, J0 = pseudo_inertia(pi[k : k + 10]), pseudo_inertia(bodies.pi0[k : k + 10])
        if np.linalg.eigvalsh(J)[0] <= 0.0:
            return np.zeros(len(x))
        G = weight * (np.linalg.solve(J0, J) @ np.linalg.inv(J0) - np.linalg.inv(J))
        out[k : k + 10] += [np.sum(G * E) for E in UNIT]
    return out


def test_pseudo_inertia_is_pinocchios_and_back():
    inertia = pin.Inertia.Random()
    pi = inertia.toDynamicParameters()
    assert_allclose(pseudo_inertia(pi), pin.PseudoInertia.FromInertia(inertia).toMatrix(), atol=1e-12)
    assert_allclose(dynamic_parameters(pseudo_inertia(pi)), pi, atol=1e-12)


@pytest.mark.parametrize("weight", [0.5, 50.0])
def test_the_optimum_is_that_of_a_general_minimiser(weight):
    evidence, bodies, _ = problem()
    out = near(evidence, bodies, weight)
    x = np.concatenate([out.pi, out.theta[10:]])
    scale = np.maximum(np.abs(np.concatenate([bodies.pi0, evidence.theta[10:]])), 1e-2)
    start = np.concatenate([bodies.pi0, np.maximum(evidence.theta[10:], 0.0)]) / scale
    bounds = [(None, None)] * 20 + [(0.0, None)] * 5
    for _ in range(4):  # again from where it stopped: its curvature starts anew
        found = scipy.optimize.minimize(
            lambda y: min(objective(y * scale, evidence, bodies, weight), 1e12),
            start,
            jac=lambda y: slope(y * scale, evidence, bodies, weight) * scale,
            bounds=bounds,
            method="L-BFGS-B",
            options={"maxiter": 5000, "maxfun": 500_000, "ftol": 1e-15, "gtol": 1e-9},
        )
        start = found.x
    own = objective(x, evidence, bodies, weight)
    assert own <= found.fun + 1e-6 * abs(found.fun)
    assert_allclose(own, found.fun, rtol=1e-3)
    assert_allclose(bodies.P @ out.pi, out.theta[:10], rtol=1e-12)
    rng = np.random.default_rng(1)
    for _ in range(300):
        step = rng.standard_normal(len(x)) * np.maximum(np.abs(x), 1e-3) * 10.0 ** rng.uniform(-6, -1)
        step[20:] = np.maximum(step[20:], -x[20:])
        assert objective(x + step, evidence, bodies, weight) > own - 1e-7


def test_data_of_no_noise_decide_all_that_they_see():
    """A body of the truth is there, so nothing but what the data leave open follows the URDF."""
    evidence, bodies, truth = problem(size=1e8)
    exact = np.concatenate([bodies.P @ truth, [0.5, 1.0, 2.0]])
    out = near(replace(evidence, right=evidence.factor @ exact, theta=exact), bodies, 5.0)
    assert_allclose(out.theta, exact, rtol=1e-9)
    assert np.linalg.eigvalsh(pseudo_inertia(out.pi[:20].reshape(2, 10)))[:, 0].min() > 0.0


def test_without_data_the_urdf_stays():
    evidence, bodies, _ = problem()
    blind = replace(evidence, factor=evidence.factor * np.append(np.zeros(10), np.ones(3)))
    out = near(blind, bodies, 5.0)
    assert_allclose(out.pi, bodies.pi0)
    assert (out.share == 1.0).all()
    assert np.isinf(out.error).all()
    faint = near(replace(evidence, factor=1e-6 * evidence.factor, right=1e-6 * evidence.right), bodies, 5.0)
    assert_allclose(faint.pi[:20], bodies.pi0[:20], rtol=1e-6, atol=1e-6)
    assert_allclose(faint.share, 1.0, atol=1e-6)


def test_impossible_data_end_inside_the_cone_and_friction_at_its_bound():
    evidence, bodies, truth = problem()
    wrong = np.concatenate([bodies.P @ (-truth), [-0.5, 1.0, 2.0]])
    out = near(replace(evidence, right=evidence.factor @ wrong, theta=wrong), bodies, 5.0)
    assert np.linalg.eigvalsh(pseudo_inertia(out.pi[:20].reshape(2, 10)))[:, 0].min() > 0.0
    assert (out.pi[20:] >= 0.0).all()
    assert out.theta[10] == 0.0
    assert (out.theta[10:] >= 0.0).all()


def test_share_and_error_are_those_of_the_mass():
    evidence, bodies, _ = problem()
    out = near(evidence, bodies, 5.0)
    more = bodies.pi0.copy()
    more[:10] *= 1.0001
    other = near(evidence, replace(bodies, pi0=more), 5.0)
    assert_allclose(np.log(other.pi[0] / out.pi[0]) / np.log(1.0001), out.share[0], rtol=1e-3)
    rng = np.random.default_rng(2)
    every = replace(bodies, P=rng.standard_normal((22, 22)))
    free = np.full(22, np.inf)
    seen = Evidence(
        100.0 * rng.standard_normal((60, 22)), np.zeros(60), np.zeros(22), np.arange(22), -free, free
    )
    exact = seen.factor @ (every.P @ np.append(1.1 * bodies.pi0[:20], [1.0, 1.0]))
    masses = [near(replace(seen, right=exact + e), every, 0.01).pi[0] for e in rng.standard_normal((200, 60))]
    assert_allclose(np.std(masses), near(replace(seen, right=exact), every, 0.01).error[0], rtol=0.2)


def test_a_start_elsewhere_ends_at_the_same_place():
    evidence, bodies, _ = problem()
    there = near(evidence, bodies, 5.0, near(evidence, bodies, 500.0))
    assert_allclose(there.pi, near(evidence, bodies, 5.0).pi, rtol=1e-4, atol=1e-5)


def test_the_bodies_of_a_good_urdf_are_taken_as_they_are():
    pi, dummy = plausible(chain(), np.ones(3, bool))
    assert_allclose(pi, parameters(chain()))
    assert not dummy.any()


@pytest.mark.parametrize("masses", [(1.0, 1.0, 1.0), (0.3, 0.3, 0.3), (3.0, 0.0, 1.0)])
def test_dummies_are_rods_along_the_kinematics(masses):
    tensor = 1e-3 * np.eye(3)
    pi, dummy = plausible(chain(masses, tensor), np.ones(3, bool))
    assert dummy.tolist() == ([False, True, False] if 0.0 in masses else [True, True, True])
    rod = pi[10:20]
    assert_allclose(rod[0], 1000.0 * np.pi * 0.06**2 * 0.4)
    assert_allclose(rod[1:4] / rod[0], [0.2, 0.0, 0.0], atol=1e-12)
    assert np.linalg.eigvalsh(pseudo_inertia(rod))[0] > 0.0


def test_impossible_bodies_are_made_possible_where_they_act():
    flat = 3.0 * np.diag([0.01, 0.01, 0.03])  # violates the triangle inequality
    model = chain((3.0, 2.0, 1.0), flat)
    pi, dummy = plausible(model, np.array([True, True, False]))
    assert not dummy.any()
    assert_allclose(pi[20:], parameters(model)[20:])
    assert_allclose(pi[[0, 1, 10, 11]], parameters(model)[[0, 1, 10, 11]])
    assert np.linalg.eigvalsh(pseudo_inertia(pi[:20].reshape(2, 10)))[:, 0].min() > 0.0
    point, _ = plausible(chain(tensor=np.zeros((3, 3))), np.ones(3, bool))
    assert np.linalg.eigvalsh(pseudo_inertia(point[:30].reshape(3, 10)))[:, 0].min() > 0.0
