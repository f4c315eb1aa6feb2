"""Rotations against closed forms and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from pinotwin.imu import rotation as rot
from pinotwin.imu.align import fit_rotation
from pinotwin.imu.ekf import ekf


def coning(t: np.ndarray, half_angle: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Orientation and body rate of a coning motion: q = (cos, sin cos wt, sin sin wt, 0)."""
    c, s = np.cos(half_angle / 2), np.sin(half_angle / 2)
    q = np.stack([np.full_like(t, c), s * np.cos(rate * t), s * np.sin(rate * t), 0 * t], 1)
    w = rate * np.stack(
        [
            -np.sin(half_angle) * np.sin(rate * t),
            np.sin(half_angle) * np.cos(rate * t),
            np.full_like(t, -2 * s**2),
        ],
        1,
    )
    return q, w


def coning_error(rule: str, h: float) -> float:
    t = np.arange(0.0, 2.0, h)
    q, w = coning(t, 0.1, 2 * np.pi * 10)
    plain = {"hold": w[:-1] * h, "trapezoid": 0.5 * h * (w[:-1] + w[1:])}
    estimate = rot.chain(plain[rule] if rule in plain else rot.increments(w, h, "coning"), q[0])
    return float(np.linalg.norm(rot.log(rot.multiply(estimate, rot.conjugate(q))), axis=1)[-1])


def test_strapdown_follows_the_closed_form_coning_motion_to_fourth_order() -> None:
    errors = [coning_error("coning", h) for h in (2.5e-3, 1.25e-3)]
    assert errors[0] < 3e-4
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.2)
    assert coning_error("trapezoid", 2.5e-3) > 20 * errors[0]
    assert coning_error("hold", 2.5e-3) > 20 * errors[0]


def test_constant_rate_is_integrated_exactly() -> None:
    w = np.array([1.0, -2.0, 3.0])
    q = rot.chain(rot.increments(np.tile(w, (1001, 1)), 0.01))
    truth = Rotation.from_rotvec(w * 10.0).as_matrix()
    np.testing.assert_allclose(rot.to_matrix(q[-1]), truth, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(arrays(float, 3, elements=st.floats(-1.8, 1.8)), st.floats(1e-9, 1.0))
def test_exp_and_log_are_inverse_and_agree_with_scipy(v: np.ndarray, scale: float) -> None:
    phi = v * scale
    q = rot.exp(phi)
    np.testing.assert_allclose(rot.to_matrix(q), Rotation.from_rotvec(phi).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rot.log(q), phi, atol=1e-9)


def test_products_and_rotations_agree_with_matrices(rng: np.random.Generator) -> None:
    p, q = rng.normal(size=(2, 20, 4))
    p, q = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (p, q))
    v = rng.normal(size=(20, 3))
    P, Q = rot.to_matrix(p), rot.to_matrix(q)
    np.testing.assert_allclose(rot.to_matrix(rot.multiply(p, q)), P @ Q, atol=1e-14)
    np.testing.assert_allclose(rot.rotate(q, v), np.einsum("nij,nj->ni", Q, v), atol=1e-14)
    np.testing.assert_allclose(rot.skew(v[0]) @ v[1], np.cross(v[0], v[1]), atol=1e-15)


def test_an_alignment_is_proper_where_the_source_gives_a_reflection() -> None:
    x = np.eye(3)
    y = np.diag([1.0, 1.0, -0.1])
    U, _, Vt = np.linalg.svd(y.T @ x)
    assert np.linalg.det(U @ Vt) < 0  # Eq. 6.19 and 6.25 as printed
    assert np.linalg.det(fit_rotation(x, y).R) == pytest.approx(1.0)


@pytest.mark.parametrize("force", [[0, 0, 9.81], [0, 0, -9.81], [3.0, -2.0, 8.0], [1, 0, -9.0]])
def test_a_filter_starts_with_the_force_upwards(force: list[float]) -> None:
    acc = np.tile(np.array(force, dtype=float), (2, 1))
    up = rot.rotate(ekf(np.zeros((2, 3)), acc, 100.0)[0][0], acc[0] / np.linalg.norm(force))
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-12)


def test_inclination_error_ignores_heading() -> None:
    tilt, heading = rot.exp(np.array([[0.02, 0.0, 0.0]])), rot.exp(np.array([[0.0, 0.0, 1.0]]))
    identity = np.array([[1.0, 0, 0, 0]])
    assert rot.inclination_error(rot.multiply(heading, tilt), identity)[0] == pytest.approx(0.02)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)
