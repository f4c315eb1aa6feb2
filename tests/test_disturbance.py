"""The split of effort into linear terms and the generalised disturbance, against Pinocchio."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
import scipy

from pinotwin.analysis.disturbance import (
    CAUSES,
    causes,
    diagonal,
    generalised_disturbance,
    linear,
    split,
)
from pinotwin.dynamics.parameters import with_parameters
from pinotwin.effects import EFFECTS
from pinotwin.errors import DataError
from pinotwin.machine import Machine, machines
from tests.motions import multisine
from tests.simulated import known_twin, nominal_twin, plain_machine

NAMES = ("laser_driller", "trunnion", "flexure_rig", "emps", "tx40")


def motion_of(machine: Machine, n: int = 400):
    motion = multisine(machine.names, machine.rotary, n=n, seed=4)
    rng = np.random.default_rng(5)
    return dataclasses.replace(motion, external=rng.normal(size=motion.q.shape))


def random_twin(name: str):
    """A bundled machine as described, every coefficient random."""
    machine = Machine.load(name)
    motion = motion_of(machine)
    effects = {a: tuple(e.fitted_to(motion) for e in axis.effects) for a, axis in machine.axes.items()}
    for axis, own in effects.items():
        machine = machine.with_effects(axis, own)
    twin = nominal_twin(machine)
    theta = twin.theta + 0.3 * np.random.default_rng(6).normal(size=len(twin.theta))
    twin = dataclasses.replace(twin, theta=theta)
    return dataclasses.replace(twin, diagonal=diagonal(twin, motion)), motion


@pytest.mark.parametrize("name", NAMES)
class TestEveryMachine:
    def test_the_parts_sum_to_the_effort_of_the_motion(self, name):
        twin, motion = random_twin(name)
        parts = split(twin, motion)
        size = np.abs(twin.effort(motion)).max(axis=0)
        d = np.sum(list(parts.values()), axis=0)
        terms = np.sum(list(linear(motion, twin.diagonal).values()), axis=0)
        assert np.all(np.abs(terms + d - twin.effort(motion)) <= 1e-12 * size)
        assert np.all(np.abs(generalised_disturbance(twin, motion, twin.diagonal) - d) <= 1e-12 * size)
        assert set(parts) <= set(CAUSES)

    def test_the_diagonal_is_the_same_in_every_run(self, name):
        twin, motion = random_twin(name)
        again = diagonal(twin, motion)
        assert all(np.array_equal(twin.diagonal[k], again[k]) for k in twin.diagonal)


def test_every_bundled_machine_is_tested():
    assert set(machines()) <= set(NAMES)


@pytest.fixture(scope="module")
def case():
    twin = known_twin(plain_machine("laser_driller"))
    motion = motion_of(twin.machine)
    return twin, motion, split(twin, motion), with_parameters(twin.machine.model, twin.pi)


class TestAgainstPinocchio:
    def test_gravity(self, case):
        _, motion, parts, model = case
        data = model.createData()
        g = np.array([pin.computeGeneralizedGravity(model, data, q) for q in motion.q])
        assert np.allclose(parts["gravity"], g, atol=1e-10 * np.abs(g).max())

    def test_coriolis_and_centrifugal(self, case):
        _, motion, parts, model = case
        data = model.createData()
        rows = zip(motion.q, motion.v, strict=True)
        c = np.array(
            [
                pin.nonLinearEffects(model, data, q, v) - pin.computeGeneralizedGravity(model, data, q)
                for q, v in rows
            ]
        )
        assert np.allclose(parts["coriolis_centrifugal"], c, atol=1e-10 * np.abs(c).max())

    def test_inertial_coupling_is_what_the_diagonal_leaves_of_the_mass_matrix(self, case):
        twin, motion, parts, model = case
        data = model.createData()
        M = np.array([pin.crba(model, data, q) for q in motion.q])
        rest = np.einsum("nij,nj->ni", M, motion.a) - twin.diagonal["inertia"] * motion.a
        assert np.allclose(parts["inertial_coupling"], rest, atol=1e-10 * np.abs(rest).max())

    def test_inertia_of_the_diagonal_is_the_mean_over_the_postures_of_the_travel(self, case):
        twin, motion, _, model = case
        data = model.createData()
        low, high = motion.q.min(axis=0), motion.q.max(axis=0)
        points = scipy.stats.qmc.Halton(len(low), scramble=False).fast_forward(1).random(64)
        postures = low + points * (high - low)
        mean = np.mean([np.diag(pin.crba(model, data, q)) for q in postures], axis=0)
        assert np.allclose(diagonal(twin, motion)["inertia"], mean, rtol=1e-10)

    def test_friction_and_ripple_are_the_effects_own_efforts(self, case):
        twin, motion, parts, _ = case
        own = twin.parts(motion)
        friction = sum(own[k] for k in own if k.endswith(("coulomb", "stribeck")))
        assert np.allclose(parts["friction"], friction, atol=1e-12)
        assert np.allclose(parts["position"], sum(own[k] for k in own if "ripple" in k), atol=1e-12)
        assert np.allclose(
            linear(motion, twin.diagonal)["viscous"], sum(own[k] for k in own if "viscous" in k), atol=1e-12
        )
        assert np.array_equal(parts["external"], -motion.external)


class TestTrunnion:
    def test_coupling_is_eq_4_27(self):
        """d_Y holds x (cos(q_A) a_A - sin(q_A) v_A²), d_A holds x cos(q_A) a_Y and g x sin(q_A)."""
        twin = known_twin(plain_machine("trunnion"), scale=0.0)
        motion = dataclasses.replace(motion_of(twin.machine), external=None)
        q, v, a = motion.q, motion.v, motion.a
        still = dataclasses.replace(motion, q=q * [1, 1, 0], v=v * [1, 1, 0], a=a * [1, 1, 0])
        parts = split(twin, still)
        model = with_parameters(twin.machine.model, twin.pi)
        M = pin.crba(model, model.createData(), np.zeros(3))
        x = M[0, 1]
        A = q[:, 1]
        assert np.allclose(parts["coriolis_centrifugal"][:, 0], -x * np.sin(A) * v[:, 1] ** 2, atol=1e-10)
        own = M[1, 1] - twin.diagonal["inertia"][1]
        coupling = x * np.cos(A) * a[:, 0] + own * a[:, 1]
        assert np.allclose(parts["inertial_coupling"][:, 1], coupling, atol=1e-10)
        assert np.allclose(np.abs(parts["gravity"][:, 1]), np.abs(9.81 * x * np.sin(A)), atol=1e-9)


def test_flexibility_is_what_the_passive_joint_adds():
    twin = known_twin(plain_machine("flexure_rig"))
    motion = motion_of(twin.machine)
    i = twin.machine.names.index("delta")
    moving = np.arange(twin.machine.nv) != i
    rigid = dataclasses.replace(motion, q=motion.q * moving, v=motion.v * moving, a=motion.a * moving)
    a, b = split(twin, motion), split(twin, rigid)
    assert np.abs(b["flexibility"]).max() < 1e-12
    for cause in ("gravity", "inertial_coupling", "coriolis_centrifugal", "friction"):
        assert np.array_equal(a[cause], b[cause])
    assert np.abs(a["flexibility"][:, 0]).max() > 1.0


def test_a_twin_without_diagonal_is_refused():
    twin = dataclasses.replace(known_twin(plain_machine("trunnion")), diagonal={})
    with pytest.raises(DataError, match="holds no diagonal"):
        split(twin, motion_of(twin.machine))


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_says_what_its_effort_counts_as(name):
    effect = EFFECTS[name]
    if name == "rigid_body":  # it is told apart by its motion
        return
    assert set(effect.causes) <= {"stiffness", "viscous", *CAUSES}
    if effect.family.acts in ("effort", "states") and name != "geometric_error":
        assert effect.causes != ("other",)


def test_causes_are_one_for_each_coefficient():
    twin, _ = random_twin("tx40")
    for effect in twin.effects:
        assert len(causes(effect)) == len(effect.coefficients())
