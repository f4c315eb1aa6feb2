r"""When ten inertial parameters can belong to a body: the pseudo-inertia must be positive definite.

    J(pi) = [[Sigma, h], [h^T, m]],   Sigma = tr(I)/2 1 - I = ∫ r r^T dm,   h = (mx, my, mz)

J is linear in pi; J > 0 is equivalent to positive mass, positive definite rotational inertia about
the centre of mass and the triangle inequalities of its principal moments. Wensing, Kim, Slotine
2018, doi:10.1109/LRA.2017.2729659; Traversaro et al. 2016, doi:10.1109/IROS.2016.7759801.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError


def _basis() -> Floats:
    """Return the pseudo-inertia of every unit parameter, shape (10, 4, 4)."""
    basis = np.zeros((10, 4, 4))
    basis[0, 3, 3] = 1.0
    for k in range(3):
        basis[1 + k, k, 3] = basis[1 + k, 3, k] = 1.0
    for parameter, axis in ((4, 0), (6, 1), (9, 2)):
        basis[parameter, range(3), range(3)] = 0.5
        basis[parameter, axis, axis] = -0.5
    for parameter, (i, j) in ((5, (0, 1)), (7, (0, 2)), (8, (1, 2))):
        basis[parameter, i, j] = basis[parameter, j, i] = -1.0
    basis.flags.writeable = False
    return basis


PSEUDO_INERTIA: Floats = _basis()
"""J(pi) = sum_k pi_k PSEUDO_INERTIA[k], shape (10, 4, 4): the map for matrix inequalities."""


def pseudo_inertia(pi_body: Floats) -> Floats:
    """Return the pseudo-inertia of ten parameters about the joint frame, shape (4, 4)."""
    body = np.asarray(pi_body, dtype=float)
    if body.shape != (10,):
        raise DataError(f"a body has ten inertial parameters, got shape {body.shape}")
    return np.tensordot(body, PSEUDO_INERTIA, axes=1)


def consistent(pi_body: Floats) -> bool:
    """Return whether the parameters can belong to a body: pseudo-inertia positive definite.

    The test is made on the matrix scaled to a unit diagonal, so that it does not depend on units.

    Args:
        pi_body: ten inertial parameters about the joint frame, shape (10,).
    """
    J = pseudo_inertia(pi_body)
    diagonal = np.diag(J)
    if not (np.all(np.isfinite(J)) and np.all(diagonal > 0.0)):
        return False
    scale = 1.0 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(J * np.outer(scale, scale))[0] > 0.0)
