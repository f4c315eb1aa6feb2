"""What every effect must satisfy; a new effect inherits the whole battery by being in the table."""

from __future__ import annotations

import dataclasses
import re
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
import scipy
import yaml
from scipy.linalg import qr

from pinotwin.dynamics.base import base_parameters
from pinotwin.dynamics.parameters import parameters
from pinotwin.effects import (
    EFFECTS,
    FAMILIES,
    LISTED,
    Coulomb,
    Effect,
    RigidBody,
    Tree,
    Viscous,
)
from pinotwin.effects import with_model_effort as told_by
from pinotwin.effects.family import FRICTION, POSITION
from pinotwin.errors import MachineError
from pinotwin.machine.effect_list import effect_spec, make_effects, settings_of
from pinotwin.motion import Motion
from tests.motions import multisine

AXES = [("Y", False), ("A", True)]
NEVER_FORGET = {"viscous_thermal", "loop_gain"}
SETTINGS = {
    "wrist_coupling": {"partner": {"Y": "A", "A": "Y"}},
    "inertial_coupling": {"partner": {"Y": "A", "A": "Y"}},
    "saturation": {"limit": {"Y": 20.0, "A": 2.0}},
    "external_force": {"starts": {"Y": (1.0, 2.5), "A": (1.0, 2.5)}},
}
"""Settings without which an effect is empty."""
OF_AN_AXIS = [name for name in EFFECTS if name != "rigid_body"]
CASES = [
    pytest.param(name, axis, rotary, id=f"{name}-{axis}") for name in OF_AN_AXIS for axis, rotary in AXES
]
LISTABLE = [case for case in CASES if case.values[0] in LISTED]


@cache
def tree() -> Tree:
    """A slide that carries a rotation whose body hangs beside its axis: the two are coupled."""
    model = pin.Model()
    model.name = "slide and rotation"
    slide = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), "Y")
    model.appendBodyToJoint(slide, pin.Inertia(8.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    turn = model.addJoint(slide, pin.JointModelRX(), pin.SE3.Identity(), "A")
    body = pin.Inertia(3.0, np.array([0.05, 0.02, -0.15]), np.diag([0.05, 0.04, 0.03]))
    model.appendBodyToJoint(turn, body, pin.SE3.Identity())
    model.lowerPositionLimit = np.array([-1.0, -1e9])
    model.upperPositionLimit = np.array([1.0, 1e9])
    return Tree(model, ("Y", "A"), (False, True))


def build(name: str, axis: str, motion: Motion) -> Effect:
    settings = {key: values[axis] for key, values in SETTINGS.get(name, {}).items()}
    return dataclasses.replace(EFFECTS[name].on(tree(), axis), **settings).fitted_to(motion)


def told(motion: Motion) -> Motion:
    """Return a motion with a command and the effort of a model."""
    model = tree().model
    effects = [RigidBody(model, base_parameters(model)), Viscous("Y"), Coulomb("A", rotary=True)]
    beta = effects[0].base.from_standard(parameters(model))
    lag = 0.004 * motion.v
    with_command = dataclasses.replace(motion, qr=motion.q + lag, vr=motion.v, ar=motion.a)
    return told_by(with_command, effects, np.concatenate([beta, [12.0, 0.3]]))


@pytest.fixture(scope="module")
def motion() -> Motion:
    return told(multisine(n=8000))  # longer than any drive rings


@pytest.mark.parametrize(("name", "axis", "rotary"), CASES)
class TestEveryEffect:
    def test_columns_have_one_row_a_sample_and_one_column_a_coefficient(self, name, axis, rotary, motion):
        effect = build(name, axis, motion)
        columns = effect.columns(motion)
        expected = (len(motion), len(columns.joints), len(effect.coefficients()))
        assert columns.values.shape == expected
        assert np.isfinite(columns.values).all()
        assert motion.index(axis) in columns.joints
        assert np.abs(columns.values).max() > 0.0

    def test_coefficients_are_recovered_from_noisy_effort(self, name, axis, rotary, motion):
        effect = build(name, axis, motion)
        rng = np.random.default_rng(5)
        columns = effect.columns(motion)
        w = columns.values.reshape(-1, columns.values.shape[-1])
        # Knots of a table that the motion never passes, parameters of a body that nothing excites.
        w = w[:, independent(w)]
        truth = rng.uniform(0.5, 2.0, w.shape[1])
        sigma = 0.01 * np.abs(w).max()
        y = w @ truth + sigma * rng.standard_normal(len(w))
        found = np.linalg.lstsq(w, y, rcond=None)[0]
        error = sigma * np.sqrt(np.diag(np.linalg.inv(w.T @ w)))
        # 5 sigma: a table has hundreds of coefficients, and all of them must pass.
        assert np.all(np.abs(found - truth) < 5.0 * error)

    def test_effort_is_columns_times_coefficients(self, name, axis, rotary, motion):
        effect = build(name, axis, motion)
        columns = effect.columns(motion)
        theta = np.linspace(1.0, 2.0, columns.values.shape[-1])
        effort = columns.effort(theta, 2)
        for at, joint in enumerate(columns.joints):
            np.testing.assert_allclose(effort[:, joint], columns.values[:, at] @ theta)
        others = [j for j in range(2) if j not in columns.joints]
        assert not effort[:, others].any()

    def test_a_run_in_two_halves_is_the_whole_run_when_it_moves_at_the_cut(self, name, axis, rotary, motion):
        """What a stretch remembers of the time before it is gone at its end, unless it never forgets."""
        effect = build(name, axis, motion)
        n = len(motion)
        # Fast motion on both sides of the cut, where the memory of the direction is saturated.
        speed = np.abs(motion.v[:, motion.index(axis)])
        cut = int(np.argmax(speed[n // 4 : n // 2])) + n // 4
        whole = effect.columns(motion).values
        first, second = motion.cut(0, cut), motion.cut(cut, n)
        near = {"rtol": 1e-9, "atol": 1e-9 * np.abs(whole).max()}
        np.testing.assert_allclose(effect.columns(first).values[:-1], whole[: cut - 1], **near)
        ends = effect.columns(second).values[-100:], whole[-100:]
        if name in NEVER_FORGET:
            assert np.abs(ends[0] - ends[1]).max() > near["atol"]
        else:
            np.testing.assert_allclose(*ends, **near)

    def test_shape_values_go_in_and_come_out(self, name, axis, rotary, motion):
        effect = build(name, axis, motion)
        for shape in effect.shapes():
            assert shape.lower < shape.upper
            assert shape.unit
        values = [0.5 * (s.lower + s.upper) for s in effect.shapes()]
        assert effect.shaped(values).shape_values() == tuple(values)
        for shape, grid in zip(effect.shapes(), effect.grid(motion), strict=True):
            assert grid.min() >= shape.lower - 1e-12
            assert grid.max() <= shape.upper + 1e-12

    def test_coefficients_have_units(self, name, axis, rotary, motion):
        effect = build(name, axis, motion)
        for coefficient in effect.coefficients():
            assert coefficient.unit
            if effect.family in (FRICTION, POSITION) and coefficient.unit != "-":
                assert ("N·m" in coefficient.unit) == rotary

    def test_docstring_states_the_equation_with_its_coefficients(self, name, axis, rotary, motion):
        stated = equation(type(build(name, axis, motion)))
        for coefficient in build(name, axis, motion).coefficients():
            stem = re.match(r"[A-Za-z]+", coefficient.name)
            assert re.search(rf"(?<![A-Za-z]){stem[0]}(?![a-z])", stated), f"{coefficient.name}: {stated!r}"

    def test_it_says_what_it_is(self, name, axis, rotary, motion):
        cls = EFFECTS[name]
        assert cls.family in FAMILIES
        assert re.fullmatch("#[0-9a-f]{6}", cls.colour)
        for text in (cls.title, cls.words, cls.remedy):
            assert len(text) > 4
            assert not text.endswith(".")
        assert cls.words[0].islower()
        for other in (*cls.contains, *cls.imitates, *cls.inseparable):
            assert other in EFFECTS
            assert other != name
        for other in cls.inseparable:
            assert name in EFFECTS[other].inseparable

    def test_it_is_frozen_and_its_settings_are_known(self, name, axis, rotary, motion):
        effect = build(name, axis, motion)
        with pytest.raises(dataclasses.FrozenInstanceError):
            effect.axis = "other"
        assert "axis" not in settings_of(type(effect))

    def test_candidates_keep_their_shapes_within_the_bounds(self, name, axis, rotary, motion):
        found = EFFECTS[name].candidates(tree(), axis, motion)
        assert len(set(map(repr, found))) == len(found)
        for candidate in found:
            assert candidate.name == name
            for shape, value in zip(candidate.shapes(), candidate.shape_values(), strict=True):
                assert shape.lower <= value <= shape.upper
        if len(found) > 1 and not hasattr(found[0], "partner"):
            assert EFFECTS[name].searched > 0, "several instances were tried: that has a price"


@pytest.mark.parametrize(("name", "axis", "rotary"), LISTABLE)
def test_yaml_round_trip(name, axis, rotary, motion):
    effect = build(name, axis, motion)
    text = yaml.safe_dump([effect_spec(effect)])
    (again,) = make_effects(yaml.safe_load(text), axis, rotary, "effects")
    assert again.fitted_to(motion) == effect


@pytest.mark.parametrize("name", sorted(set(EFFECTS) - set(LISTED)))
def test_a_name_that_cannot_be_listed_says_why_in_one_line(name):
    with pytest.raises(MachineError, match=name) as caught:
        make_effects([name], "Y", False, "axes.Y.effects")
    assert "\n" not in str(caught.value)
    assert EFFECTS[name].unlisted in str(caught.value)


def equation(cls: type[Effect]) -> str:
    """Return the equations in the class's own docstring: its lines and sentences that hold ``=``."""
    text = vars(cls)["__doc__"].split("Attributes:")[0]
    assert re.search(r"tau\w* = ", text), f"{cls.__name__}: no equation `tau = ...` in its docstring"
    return " ".join(line for line in re.split(r"\n\s*\n", text) if " = " in line)


def independent(w: np.ndarray) -> np.ndarray:
    """Return which columns a least-squares problem can tell apart."""
    size = np.linalg.norm(w, axis=0)
    alive = np.flatnonzero(size > 0.0)
    _, r, order = qr(w[:, alive] / size[alive], mode="economic", pivoting=True)
    return np.sort(alive[order[np.abs(np.diag(r)) > 1e-6]])


DISSIPATIVE = ["viscous", "viscous_asymmetric", "coulomb", "coulomb_asymmetric", "quadratic_drag"]


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_friction_only_takes_energy(name, motion):
    effect = build(name, "Y", motion)
    theta = np.ones(len(effect.coefficients()))
    power = effect.columns(motion).effort(theta, 2)[:, 0] * motion.v[:, 0]
    # The direction with memory may hold its sign for the instant of the reversal itself.
    assert power[np.abs(motion.v[:, 0]) > 5e-3].min() >= 0.0


def test_direction_holds_through_a_stop_and_turns_with_the_motion():
    """Eq. 3.9: an axis that stops and goes on the same way keeps its friction."""
    t = np.arange(3000) * 1e-3
    v = np.where(t < 1, np.sin(np.pi * t), np.where(t < 2, 0.0, np.sin(np.pi * (t - 2))))
    motion = dataclasses.replace(
        multisine(n=3000),
        v=np.stack([v, -v], axis=1),
        a=np.stack([np.gradient(v, 1e-3), -np.gradient(v, 1e-3)], axis=1),
    )
    d = build("coulomb", "Y", motion).columns(motion).values[:, 0, 0]
    assert np.all(d[50:2999] > 0.99)  # held through the stop at t = 1 s to 2 s
    assert np.abs(d).max() <= 1.0


def test_position_table_weighs_the_nearer_knot_more():
    """As Eq. 3.11 is corrected in the errata; the weights are those of a cubic B-spline (de Boor 1978)."""
    motion = multisine()
    (table,) = make_effects(
        [{"position_table": {"spacing": 0.1, "start": 0.0, "stop": 1.0}}], "Y", False, "effects"
    )
    q = np.array([0.34, 0.34])
    still = dataclasses.replace(motion.cut(0, 2), q=np.stack([q, q], axis=1))
    row = table.columns(still).values[0, 0]
    spline = scipy.interpolate.BSpline.basis_element(np.arange(-2.0, 3.0), extrapolate=False)
    near = spline(0.34 / 0.1 - np.arange(2, 6))
    np.testing.assert_allclose(row[2:6], near, atol=1e-12)
    assert row[3] > row[4]
    assert row.sum() == pytest.approx(1.0)


def test_ripple_modulated_contains_equation_3_10():
    motion = multisine()
    R, alpha, eps, period, phi = 0.7, 0.4, 0.3, 0.25, 1.1
    q = motion.q[:, 1]
    tau = R * (1 + alpha * np.abs(np.sin(q + eps))) * np.sin(2 * np.pi * q / period + phi)
    (ripple,) = make_effects([{"ripple_modulated": {"period": period, "eps": eps}}], "A", True, "effects")
    theta = R * np.array([np.sin(phi), np.cos(phi), alpha * np.sin(phi), alpha * np.cos(phi)])
    np.testing.assert_allclose(ripple.columns(motion).effort(theta, 2)[:, 1], tau, atol=1e-12)
