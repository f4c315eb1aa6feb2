"""How an IMU sits: proper rotations between frames, with standard errors, for any chain.

R_G/M turns a vector of the machine into the IMU's earth frame (thesis Eq. 6.12-6.19), R_S/T one of the link (table)
into the sensor; the latter from rates, without integration. Both use Kabsch's determinant correction, for Eq. 6.19
and 6.25 can return a reflection. Two axes that turn fix a rotation, or one and gravity unless it is parallel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot
from pinotwin.solve.sandwich import sandwich


@dataclass(frozen=True)
class RotationFit:
    """A rotation y = R x and how well it is known."""

    R: Floats  # the rotation, (3, 3), determinant +1
    cov: Floats  # covariance of the small rotation vector e in R_true = exp(e) R [rad²], (3, 3)
    gravity: bool = False  # whether gravity had to serve as a second direction


def fit_rotation(x: Floats, y: Floats, gravity: tuple[Floats, Floats] | None = None) -> RotationFit:
    """Return the proper rotation with y = R x in the least-squares sense (Wahba's problem), for vectors (n, 3) each.

    ``gravity`` is a direction in both frames, (n, 3) or (3,), used where ``x`` spans only one. DataError if that is not
    enough to fix it.
    """
    # The RMS that counts as excitation, in the unit of x; the least ratio of the second to the first singular value;
    # the samples over which residuals are correlated.
    minimum, spread, lag = 0.02, 0.05, 100
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if x.shape != y.shape or x.ndim != 2 or x.shape[1] != 3:
        raise DataError(f"an alignment needs vectors of equal shape (n, 3), not {x.shape}, {y.shape}")
    values = np.linalg.svd(x, compute_uv=False) / np.sqrt(len(x))
    if values[0] < minimum:
        raise DataError(
            f"the link turns with {np.degrees(values[0]):.2g} deg/s RMS only: too little to align "
            "an IMU; move a rotary axis in the log"
        )
    helped = bool(values[1] / values[0] < spread)
    if helped:
        x, y = _with_gravity(x, y, gravity, spread)
    R = Rotation.align_vectors(y, x)[0].as_matrix()
    turned = x @ R.T
    e = y - turned
    J = rot.skew(turned)  # d y / d e = -[R x]; rows of every sample
    information = np.einsum("nki,nkj->ij", J, J)
    cov = sandwich(-np.einsum("nki,nk->ni", J, e), information, lag)
    return RotationFit(R, cov, helped)


def _with_gravity(
    x: Floats, y: Floats, gravity: tuple[Floats, Floats] | None, spread: float
) -> tuple[Floats, Floats]:
    message = "only one rotation axis (or parallel ones) turns in this log"
    if gravity is None:
        raise DataError(f"{message}; move a second, non-parallel axis or give gravity directions")
    size = np.sqrt(np.mean(np.sum(x**2, axis=1)))
    gx, gy = (np.broadcast_to(np.asarray(g, dtype=float), x.shape) for g in gravity)
    gx, gy = (size * g / np.linalg.norm(g, axis=1, keepdims=True) for g in (gx, gy))
    both = np.vstack([x, gx])
    values = np.linalg.svd(both, compute_uv=False)
    if values[1] < spread * values[0]:
        raise DataError(
            f"{message} and gravity is parallel to it, so the turn around it cannot be found; "
            "move a second, non-parallel axis"
        )
    return both, np.vstack([y, gy])


def mounting_from_rates(
    w_link: Floats, gyr: Floats, gravity: tuple[Floats, Floats] | None = None
) -> RotationFit:
    """Return R = R_S/T from rates (n, 3) [rad/s]: gyr = (I + diag(s)) exp(e) R w_link + b, s and b estimated too."""
    still = np.linalg.norm(w_link, axis=1) < 1e-3
    centred = gyr - np.median(gyr[still], axis=0) if still.any() else gyr
    fit = fit_rotation(w_link, centred, gravity)
    if fit.gravity:
        return fit
    R, s, b = fit.R, np.zeros(3), np.zeros(3)
    for _ in range(4):
        turned = w_link @ R.T
        e = gyr - (1.0 + s) * turned - b
        turn, stretch = -(1.0 + s)[:, None] * rot.skew(turned), turned[:, :, None] * np.eye(3)
        J = np.concatenate([turn, stretch, np.broadcast_to(np.eye(3), stretch.shape)], axis=2)
        noise = np.mean(e**2)
        # standard deviations of the gyro's scale errors [-] and biases [rad/s]
        prior = noise * np.repeat([0.0, 5e-3**-2, 0.02**-2], 3)
        A = np.einsum("nki,nkj->ij", J, J) + np.diag(prior)
        dx = np.linalg.solve(A, np.einsum("nki,nk->i", J, e) - prior * np.r_[np.zeros(3), s, b])
        R, s, b = rot.to_matrix(rot.exp(dx[:3])) @ R, s + dx[3:6], b + dx[6:]
    cov = sandwich(np.einsum("nki,nk->ni", J, e), A, 100)[:3, :3]
    return RotationFit(R, cov)
