"""What every effect must satisfy; a new effect inherits the whole battery by being in the table."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import yaml

from pinotwin.effects import EFFECTS
from pinotwin.machine.yaml_file import effect_spec, make_effects, settings_of
from pinotwin.motion import Motion
from tests.motions import multisine

NEEDS = {"wrist_coupling": {"with": "A"}}
AXES = [("Y", False), ("A", True)]
CASES = [
    pytest.param(name, axis, rotary, id=f"{name}-{axis}")
    for name in EFFECTS
    for axis, rotary in AXES
    if not (name == "wrist_coupling" and axis == "A")
]


def build(name: str, axis: str, rotary: bool, motion: Motion):
    spec = {name: NEEDS[name]} if name in NEEDS else name
    (effect,) = make_effects([spec], axis, rotary, "effects")
    return effect.fitted_to(motion)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return multisine()


@pytest.mark.parametrize(("name", "axis", "rotary"), CASES)
class TestEveryEffect:
    def test_columns_have_one_row_a_sample_and_one_column_a_coefficient(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        columns = effect.columns(motion)
        expected = (len(motion), len(columns.joints), len(effect.coefficients()))
        assert columns.values.shape == expected
        assert np.isfinite(columns.values).all()
        assert motion.index(axis) in columns.joints

    def test_coefficients_are_recovered_from_noisy_effort(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        rng = np.random.default_rng(5)
        columns = effect.columns(motion)
        w = columns.values.reshape(-1, columns.values.shape[-1])
        seen = np.linalg.norm(w, axis=0) > 0  # knots of a table that the motion never passes
        w = w[:, seen]
        truth = rng.uniform(0.5, 2.0, w.shape[1])
        sigma = 0.01
        y = w @ truth + sigma * rng.standard_normal(len(w))
        found = np.linalg.lstsq(w, y, rcond=None)[0]
        error = sigma * np.sqrt(np.diag(np.linalg.inv(w.T @ w)))
        # 5 sigma: a table has hundreds of coefficients, and all of them must pass.
        assert np.all(np.abs(found - truth) < 5.0 * error)

    def test_effort_is_columns_times_coefficients(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        columns = effect.columns(motion)
        theta = np.linspace(1.0, 2.0, columns.values.shape[-1])
        effort = columns.effort(theta, 2)
        for at, joint in enumerate(columns.joints):
            np.testing.assert_allclose(effort[:, joint], columns.values[:, at] @ theta)
        others = [j for j in range(2) if j not in columns.joints]
        assert not effort[:, others].any()

    def test_a_run_in_two_halves_is_the_whole_run_when_it_rests_at_the_cut(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        n = len(motion)
        # Fast motion on both sides of the cut, where the memory of the direction is saturated.
        speed = np.abs(motion.v[:, motion.index(axis)])
        cut = int(np.argmax(speed[n // 4 : 3 * n // 4])) + n // 4
        whole = effect.columns(motion).values
        halves = [effect.columns(motion.cut(0, cut)), effect.columns(motion.cut(cut, n))]
        np.testing.assert_allclose(np.concatenate([h.values for h in halves]), whole, rtol=1e-9, atol=1e-9)

    def test_yaml_round_trip(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        text = yaml.safe_dump([effect_spec(effect)])
        (again,) = make_effects(yaml.safe_load(text), axis, rotary, "effects")
        assert again.fitted_to(motion) == effect

    def test_shape_values_go_in_and_come_out(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        for shape in effect.shapes():
            assert shape.lower < shape.upper
            assert shape.unit
        values = [0.5 * (s.lower + s.upper) for s in effect.shapes()]
        assert effect.shaped(values).shape_values() == tuple(values)
        for shape, grid in zip(effect.shapes(), effect.grid(motion), strict=True):
            assert grid.min() >= shape.lower - 1e-12
            assert grid.max() <= shape.upper + 1e-12

    def test_coefficients_have_units(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        for coefficient in effect.coefficients():
            assert ("N·m" in coefficient.unit) == rotary or name == "wrist_coupling"

    def test_docstring_states_the_equation(self, name, axis, rotary, motion):
        text = (type(build(name, axis, rotary, motion)).__doc__ or "") + (
            __import__(type(build(name, axis, rotary, motion)).__module__, fromlist=["x"]).__doc__ or ""
        )
        assert "tau" in text or "gets" in text

    def test_it_is_frozen_and_its_settings_are_known(self, name, axis, rotary, motion):
        effect = build(name, axis, rotary, motion)
        with pytest.raises(dataclasses.FrozenInstanceError):
            effect.axis = "other"
        assert "axis" not in settings_of(type(effect))


DISSIPATIVE = ["viscous", "viscous_asymmetric", "coulomb", "coulomb_asymmetric", "quadratic_drag"]


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_friction_only_takes_energy(name, motion):
    effect = build(name, "Y", False, motion)
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
    d = build("coulomb", "Y", False, motion).columns(motion).values[:, 0, 0]
    assert np.all(d[50:2999] > 0.99)  # held through the stop at t = 1 s to 2 s
    assert np.abs(d).max() <= 1.0


def test_position_table_weighs_the_nearer_knot_more():
    """Eq. 3.11 as corrected in the errata: the example of Fig. 3-4 swaps its weights."""
    motion = multisine()
    (table,) = make_effects(
        [{"position_table": {"spacing": 0.1, "start": 0.0, "stop": 1.0}}], "Y", False, "effects"
    )
    q = np.array([0.34, 0.34])
    still = dataclasses.replace(motion.cut(0, 2), q=np.stack([q, q], axis=1))
    row = table.columns(still).values[0, 0]
    np.testing.assert_allclose(row[3:5], [0.6, 0.4])
    assert row.sum() == pytest.approx(1.0)


def test_ripple_modulated_contains_equation_3_10():
    motion = multisine()
    R, alpha, eps, period, phi = 0.7, 0.4, 0.3, 0.25, 1.1
    q = motion.q[:, 1]
    tau = R * (1 + alpha * np.abs(np.sin(q + eps))) * np.sin(2 * np.pi * q / period + phi)
    (ripple,) = make_effects([{"ripple_modulated": {"period": period, "eps": eps}}], "A", True, "effects")
    theta = R * np.array([np.sin(phi), np.cos(phi), alpha * np.sin(phi), alpha * np.cos(phi)])
    np.testing.assert_allclose(ripple.columns(motion).effort(theta, 2)[:, 1], tau, atol=1e-12)
