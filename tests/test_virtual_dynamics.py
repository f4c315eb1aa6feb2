"""The virtual machines' rigid-body code against Pinocchio, their friction against its laws."""

import numpy as np
import pinocchio as pin
import pytest

from pinotwin.virtual import columns as c
from pinotwin.virtual.control import control_step
from pinotwin.virtual.friction import friction_force
from pinotwin.virtual.tree import assembled, inertia_at, perturbed, tree_of
from tests.virtual_motion import forward_dynamics


def random_model(seed: int, joints: int = 6) -> pin.Model:
    """A random tree of prismatic, revolute and skew joints."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    line = [0]  # from the ground to the newest joint: parents stay depth first, as Pinocchio asks
    for k in range(joints):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        kinds = [
            pin.JointModelRX(),
            pin.JointModelPY(),
            pin.JointModelRevoluteUnaligned(*axis),
            pin.JointModelPrismaticUnaligned(*axis),
            pin.JointModelRUBZ(),
        ]
        kind = kinds[rng.integers(4 if seed % 2 else 5)]
        line = line[: int(rng.integers(1, len(line) + 1))]
        parent = line[-1]
        joint = model.addJoint(parent, kind, pin.SE3.Random(), f"j{k}")
        body = pin.Inertia.FromEllipsoid(*rng.uniform(0.2, 1.5, 4))
        model.appendBodyToJoint(joint, body, pin.SE3.Random())
        line.append(joint)
    return model


def state_of(model: pin.Model, seed: int):
    """Positions as angles for the tree, and the same as Pinocchio's configuration."""
    rng = np.random.default_rng(seed)
    q, v, tau = rng.standard_normal((3, model.nv))
    return q, v, tau, pin.integrate(model, pin.neutral(model), q)


@pytest.mark.parametrize("seed", range(12))
def test_forward_dynamics_is_pinocchios(seed: int):
    pin.seed(seed)
    model = random_model(seed)
    own = assembled(model, list(model.inertias)[1:])
    q, v, tau, configuration = state_of(model, seed)
    own.armature = model.armature = np.linspace(0.1, 0.6, model.nv) * (seed % 3)
    M = pin.crba(model, model.createData(), configuration)
    np.testing.assert_allclose(inertia_at(own, q), M, rtol=1e-9, atol=1e-12)
    expected = pin.aba(model, model.createData(), configuration, v, tau)
    np.testing.assert_allclose(forward_dynamics(tree_of(own), q, v, tau), expected, rtol=1e-9, atol=1e-9)


def test_perturbed_bodies_stay_possible_and_off_by_what_was_asked():
    pin.seed(5)
    model = random_model(3, joints=8)
    bodies = list(model.inertias)[1:]
    masses = []
    for seed in range(30):
        other = perturbed(model, (0.10, 0.20), np.random.default_rng(seed))
        masses.append([b.mass / a.mass - 1.0 for a, b in zip(bodies, other, strict=True)])
        assert min(np.linalg.eigvalsh(b.toPseudoInertia().toMatrix()).min() for b in other) > 0.0
    size = np.abs(masses)
    assert size.min() >= 0.10 - 1e-12
    assert size.max() <= 0.20 + 1e-12
    same = perturbed(model, (0.0, 0.0), np.random.default_rng(0))
    assert all(a.isApprox(b, 1e-12) for a, b in zip(same, bodies, strict=True))


def test_a_bend_held_still_changes_nothing():
    pin.seed(7)
    model = random_model(1, joints=4)
    bodies = list(model.inertias)[1:]
    bent = assembled(model, bodies, bends={"j1": 0.4})
    assert list(bent.names)[1:] == ["j0", "j1", "j1~", "j2", "j3"]
    q = np.random.default_rng(0).standard_normal(4)
    M = inertia_at(bent, np.insert(q, 2, 0.0))
    keep = np.ix_([0, 1, 3, 4], [0, 1, 3, 4])
    np.testing.assert_allclose(M[keep], inertia_at(assembled(model, bodies), q), rtol=1e-10, atol=1e-12)


def friction_row(law: int) -> np.ndarray:
    P = np.zeros((1, c.N_COLUMNS))
    P[0, c.LAW], P[0, c.BRISTLE], P[0, c.BRISTLE_DAMPER] = law, 1e6, 3000.0
    P[0, c.LEVEL_P], P[0, c.LEVEL_N] = 12.0, 8.0
    P[0, c.STATIC], P[0, c.STRIBECK], P[0, c.VISCOUS] = 1.5, 0.01, 20.0
    return P


@pytest.mark.parametrize("law", [c.LUGRE, c.GMS, c.ELASTOPLASTIC])
def test_friction_reaches_its_steady_curve(law: int):
    P, extra = friction_row(law), np.zeros((2, 1))
    for v in (0.001, 0.01, 0.2, -0.001, -0.2):
        z = np.zeros((1, c.N_STATES))
        for _ in range(12000):
            force = friction_force(P, 0, 0.0, v, z, 0.0, extra, 5e-5)
        level = (12.0 if v > 0 else 8.0) * (1.0 + 0.5 * np.exp(-((v / 0.01) ** 2)))
        assert force == pytest.approx(np.sign(v) * level + 20.0 * v, rel=1e-6)


@pytest.mark.parametrize("law", [c.LUGRE, c.GMS, c.ELASTOPLASTIC])
def test_friction_takes_energy_over_every_cycle(law: int):
    P, extra, z, dt = friction_row(law), np.zeros((2, 1)), np.zeros((1, c.N_STATES)), 5e-5
    t = np.arange(0.0, 4.0, dt)
    for stroke in (2e-6, 2e-5, 1e-3):
        v = stroke * 2 * np.pi * np.cos(2 * np.pi * t)
        work = [friction_force(P, 0, 0.0, x, z, 0.0, extra, dt) * x * dt for x in v]
        cycles = np.sum(np.reshape(work, (4, -1)), axis=1)
        assert np.all(cycles[1:] > 0.0)


@pytest.mark.parametrize("law", [c.LUGRE, c.GMS, c.ELASTOPLASTIC])
def test_a_mass_under_a_load_below_breakaway_sticks(law: int):
    P, extra, z, dt = friction_row(law), np.zeros((2, 1)), np.zeros((1, c.N_STATES)), 5e-5
    q = v = 0.0
    places = []
    for k in range(40000):
        f = friction_force(P, 0, q, v, z, 0.0, extra, dt)
        v += dt * (6.0 - f) / 10.0
        q += dt * v
        if k in (20000, 39999):
            places.append(q)
    assert abs(places[1] - places[0]) < 1e-12
    assert abs(v) < 1e-12
    assert 0.0 < q < 1e-4


def test_lugre_alone_creeps_under_vibration():
    drift = []
    for law in (c.LUGRE, c.GMS, c.ELASTOPLASTIC):
        P, extra, z, dt = friction_row(law), np.zeros((2, 1)), np.zeros((1, c.N_STATES)), 5e-5
        P[0, c.LEVEL_N] = 12.0
        q, v, marks = 0.0, 0.0, []
        for k in range(80000):
            f = friction_force(P, 0, q, v, z, 0.0, extra, dt)
            v += dt * (8.0 + 6.0 * np.sin(2 * np.pi * 5.0 * k * dt) - f) / 10.0
            q += dt * v
            if k in (20000, 76000):
                marks.append(q)
        drift.append(abs(marks[1] - marks[0]))
    assert max(drift[1:]) < 1e-9 < drift[0]


def test_the_integral_part_does_not_wind_up():
    P = np.zeros((1, c.N_COLUMNS))
    P[0, [c.KP, c.KV, c.KI, c.V_ALPHA]] = 20.0, 100.0, 1000.0, 1.0
    P[0, [c.I_LIMIT, c.U_LIMIT]] = 50.0, 30.0
    s = np.zeros((1, 3))
    for _ in range(4000):
        u = control_step(P, 0, s, (1.0, 0.0, 0.0), 0.0, 2.5e-4)
    assert u == 30.0
    assert abs(s[0, 0]) <= 50.0
    steps = 0
    while control_step(P, 0, s, (-0.01, 0.0, 0.0), 0.0, 2.5e-4) > 0.0:
        steps += 1
    assert steps < 5
