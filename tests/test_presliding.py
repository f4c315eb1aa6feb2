"""Friction before it slips: closed forms, and how near it comes to the virtual machines' own law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

import pinotwin as pt
from pinotwin.effects.presliding import EXPONENTIAL, Presliding, contact, yields
from pinotwin.motion import AxisMotion
from pinotwin.signals import roughness
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.slide import slide

STEP = 1e-3
X_S = 1e-5


def moved(q: np.ndarray, step: float = STEP) -> AxisMotion:
    v = np.gradient(q, step)
    t = step * np.arange(len(q))
    return AxisMotion("Y", 0, False, t, q, v, np.gradient(v, step), (slice(0, len(q)),), step)


def there_and_back(*turns: float) -> np.ndarray:
    return np.concatenate([np.linspace(a, b, 400) for a, b in zip((0.0, *turns), turns, strict=False)])


def test_a_term_is_there_once_whatever_its_switch_says():
    motion = moved(there_and_back(X_S))
    for switches in ({"stribeck": 2}, {"bristle": 2}):
        effect, usual = Presliding("Y", **switches), Presliding("Y")
        assert effect.coefficients() == usual.coefficients()
        np.testing.assert_array_equal(effect.axis_columns(motion), usual.axis_columns(motion))


class TestClosedForms:
    def test_the_first_slide_from_rest_is_exponential(self):
        q = np.concatenate([np.zeros(3), np.linspace(0.0, 6.0 * X_S, 2000)])  # from rest
        z, y, _ = contact(moved(q), X_S).T
        expected = 1.0 - np.exp(-q / X_S)
        np.testing.assert_allclose(y, expected, atol=1e-12)
        np.testing.assert_allclose(z, expected, atol=0.1)  # six elements: a polygon

    def test_elements_close_a_small_loop_and_a_bristle_does_not(self):
        q = there_and_back(2.0 * X_S, 1.5 * X_S, 2.0 * X_S)
        z, y, _ = contact(moved(q), X_S).T
        assert z[-1] == pytest.approx(z[399], abs=1e-12)
        assert y[399] - y[-1] > 0.05

    def test_the_rate_of_the_bristle_is_its_derivative(self):
        t = STEP * 0.01 * np.arange(4000)
        q = 5.0 * X_S * np.sin(2 * np.pi * 20.0 * t)
        _, y, rate = contact(moved(q, STEP * 0.01), X_S).T
        inside = slice(10, -10)
        error = rate - np.gradient(y, STEP * 0.01)
        assert np.max(np.abs(error[inside])) < 0.01 * np.max(np.abs(rate))

    def test_both_further_terms_vanish_once_the_axis_slides(self):
        q = np.linspace(0.0, 100.0 * X_S, 2000)
        W = Presliding("Y", x_s=X_S, stribeck=0).axis_columns(moved(q))
        np.testing.assert_allclose(W[-1], [1.0, 0.0, 0.0], atol=1e-9)


class TestSpread:
    @pytest.mark.parametrize("spread", [0.1, 0.3, EXPONENTIAL])
    def test_distances_have_the_mean_and_about_the_spread_that_are_stated(self, spread):
        found = yields(spread)
        assert found.mean() == pytest.approx(2.0, rel=0.05)
        assert found.std() / found.mean() == pytest.approx(spread, rel=0.2)  # six medians of equal parts

    def test_elements_that_slip_as_one_are_a_spring_that_lets_go(self):
        q = np.concatenate([np.zeros(3), np.linspace(0.0, 4.0 * X_S, 2000)])
        z = contact(moved(q), X_S, spread=0.1)[:, 0]
        np.testing.assert_allclose(z[q < 1.6 * X_S], q[q < 1.6 * X_S] / (2.0 * X_S), rtol=0.02, atol=1e-12)
        np.testing.assert_allclose(z[q > 2.4 * X_S], 1.0)

    @pytest.mark.parametrize(("law", "found"), [("elastoplastic", True), ("lugre", False)])
    def test_it_is_searched_where_the_log_asks_for_it(self, tmp_path, law, found):
        folder = slide(tmp_path, law=law)
        virtual = VirtualMachine.load(folder)
        path = random_trajectory(virtual, 4.0, 1, dwell=(0.0, 0.1))
        log = virtual.record(path, seed=1, noise=False).to_log()
        twin = pt.identify(pt.Machine.load(folder), log, loop=False)
        rows = {row.name: row.value for row in twin.parameters}
        assert ("X.presliding.spread" in rows) == found
        assert rows.get("X.presliding.spread", 0.0) < 0.3

    def test_a_spread_of_next_to_nothing_is_the_least(self):
        np.testing.assert_array_equal(yields(1e-9), yields(0.1))


class TestEncoderNoise:
    def test_play_keeps_a_standing_bristle_from_creeping(self):
        rng = np.random.default_rng(1)
        q = np.concatenate([np.linspace(0.0, 5.0 * X_S, 500), np.full(3000, 5.0 * X_S)])
        noisy = q + rng.normal(0.0, 2e-8, len(q))
        noise = roughness(moved(noisy).q[s] for s in moved(noisy).segments)
        assert noise == pytest.approx(2e-8, rel=0.1)
        assert contact(moved(noisy), X_S)[-1, 1] < 0.5  # crept
        assert contact(moved(noisy), X_S, 3.0 * noise)[-1, 1] > 0.95


@pytest.mark.parametrize(("law", "left", "closer"), [("lugre", 0.04, 0.35), ("gms", 0.03, 0.5)])
def test_a_law_outside_the_class_is_met_closer_than_by_elements_alone(tmp_path, law, left, closer):
    """LuGre forgets all, four uneven elements that slip late nothing: neither these elements nor this bristle."""
    machine = VirtualMachine.load(slide(tmp_path, law=law))
    path = random_trajectory(machine, 6.0, 1, dwell=(0.0, 0.1))
    truth = machine.record(path, seed=1, noise=False).truth
    q, v, a = truth.joint("X")
    step = float(truth.t[1] - truth.t[0])
    motion = AxisMotion("X", 0, False, truth.t, q, v, a, (slice(0, len(q)),), step)
    force = truth.friction[:, 0]

    def best(bristle: int) -> float:
        found = []
        for x_s in np.geomspace(1e-6, 3e-5, 20):
            law = Presliding("X", x_s=x_s, v_s=0.006, bristle=bristle, exponent=2.0)
            W = np.column_stack([v, law.axis_columns(motion)])
            found.append(nnls(W, force)[1])
        return min(found) / float(np.linalg.norm(force))

    assert best(1) < left
    assert best(1) < closer * best(0)
