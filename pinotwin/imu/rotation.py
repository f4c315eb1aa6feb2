"""Rotations: quaternions, the exponential map, and exact strapdown integration.

A quaternion ``(w, x, y, z)`` turns a vector of the sensor into the earth frame; its matrix is the transpose of the
thesis' R_S/G. The thesis steps R to first order (Eq. 6.8), which leaves SO(3); exact is ``exp(phi)`` with Bortz's
rotation vector (1971, DOI 10.1109/TAES.1971.310252), for rates a and b at the ends of the step h

    phi = integral of w over the step + h^2 / 12 (a x b) + O(h^5),   a x b: coning

The integral is of a cubic through four rates (fourth order): (-w0 + 13 a + 13 b - w3) h / 24.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.system.kernels import compiled

Rule = Literal["mean", "coning"]  # rates are averages that end at the stamp, or instantaneous


def to_matrix(q: Floats) -> Floats:
    """Return the rotation matrices of quaternions, shape (..., 4) -> (..., 3, 3)."""
    return Rotation.from_quat(np.asarray(q, dtype=float), scalar_first=True).as_matrix()


def multiply(p: Floats, q: Floats) -> Floats:
    """Return the product p q (q is applied first), shapes (..., 4) broadcast; NaN where one is, unlike scipy's."""
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    w = p[..., 0] * q[..., 0] - np.sum(p[..., 1:] * q[..., 1:], axis=-1)
    v = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + np.cross(p[..., 1:], q[..., 1:])
    return np.concatenate([w[..., None], v], axis=-1)


def conjugate(q: Floats) -> Floats:
    """Return the inverse of unit quaternions, shape (..., 4)."""
    return np.asarray(q, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(q: Floats, v: Floats) -> Floats:
    """Return vectors (..., 3) turned by quaternions (..., 4): from the sensor to the earth."""
    return Rotation.from_quat(q, scalar_first=True).apply(v)


def exp(phi: Floats) -> Floats:
    """Return the quaternions of rotation vectors [rad], shape (..., 3) -> (..., 4)."""
    return Rotation.from_rotvec(phi).as_quat(scalar_first=True)


def log(q: Floats) -> Floats:
    """Return the rotation vectors [rad] of quaternions, angle in [0, pi], (..., 4) -> (..., 3)."""
    return Rotation.from_quat(np.asarray(q, dtype=float), scalar_first=True).as_rotvec()


def skew(v: Floats) -> Floats:
    """Return the matrices of the cross product v x, shape (..., 3) -> (..., 3, 3)."""
    v = np.asarray(v, dtype=float)
    S = np.zeros((*v.shape, 3))
    S[..., 2, 1], S[..., 0, 2], S[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    return S - np.swapaxes(S, -1, -2)


def inclination_error(q: Floats, reference: Floats) -> Floats:
    """Return the angle between two verticals [rad], (n,), as BROAD (DOI 10.3390/data6070072); NaN without reference."""
    d = multiply(q, conjugate(reference))
    return 2.0 * np.arccos(np.clip(np.hypot(d[..., 0], d[..., 3]), 0.0, 1.0))


def increments(gyr: Floats, step: Floats | float, rule: Rule = "coning") -> Floats:
    """Return rotation vectors [rad], (n - 1, 3), of steps [s] between rates (n, 3) [rad/s], means or instantaneous."""
    a, b = gyr[:-1], gyr[1:]
    h = np.broadcast_to(np.asarray(step, dtype=float), (len(a),))[:, None]
    if rule == "mean":
        return b * h + h**2 / 12.0 * np.cross(a, b)
    phi = 0.5 * h * (a + b)
    if np.ndim(step) == 0 and len(gyr) > 3:
        phi[1:-1] += h[1:-1] / 24.0 * (a[1:-1] + b[1:-1] - a[:-2] - b[2:])
        ends = np.array([9.0, 19.0, -5.0, 1.0]) / 24.0
        phi[0], phi[-1] = h[0] * (ends @ gyr[:4]), h[-1] * (ends[::-1] @ gyr[-4:])
    return phi + h**2 / 12.0 * np.cross(a, b)


def chain(phi: Floats, start: Floats | None = None) -> Floats:
    """Return the quaternions (n, 4) reached by the rotation vectors of steps (n - 1, 3)."""
    first = np.array([1.0, 0.0, 0.0, 0.0]) if start is None else np.asarray(start, dtype=float)
    return _chain(first / np.linalg.norm(first), exp(phi))


@compiled
def _chain(first, steps):  # type: ignore[no-untyped-def]
    n = len(steps)
    q = np.empty((n + 1, 4))
    w, x, y, z = first
    q[0, 0], q[0, 1], q[0, 2], q[0, 3] = w, x, y, z
    for k in range(n):
        a, b, c, d = steps[k]
        w, x, y, z = (
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        )
        scale = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w * scale, x * scale, y * scale, z * scale
        q[k + 1, 0], q[k + 1, 1], q[k + 1, 2], q[k + 1, 3] = w, x, y, z
    return q
