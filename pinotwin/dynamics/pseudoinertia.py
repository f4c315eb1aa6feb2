"""The ten parameters of a body, in Pinocchio's order, as its pseudo-inertia, and back.

    J = [[Sigma, h], [h', m]],   Sigma = tr(I)/2 E - I   [kg·m², kg·m; kg·m, kg]

Positive semidefinite exactly when some distribution of mass has them (Wensing, Kim & Slotine 2018,
doi:10.1109/LRA.2017.2729659).
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats

BASIS = np.zeros((10, 4, 4))  # pseudo-inertia of each parameter alone at one
BASIS[0, 3, 3] = 1.0
for _k, (_i, _j) in enumerate([(0, 3), (1, 3), (2, 3)], 1):
    BASIS[_k, _i, _j] = BASIS[_k, _j, _i] = 1.0
for _k, (_i, _j) in {5: (0, 1), 7: (0, 2), 8: (1, 2)}.items():
    BASIS[_k, _i, _j] = BASIS[_k, _j, _i] = -1.0
for _k, _i in {4: 0, 6: 1, 9: 2}.items():
    BASIS[_k, range(3), range(3)] = 0.5
    BASIS[_k, _i, _i] = -0.5


def pseudo_inertia(pi: Floats) -> Floats:
    """Return the pseudo-inertia of ten parameters, (..., 10) to (..., 4, 4)."""
    return np.tensordot(pi, BASIS, 1)


def dynamic_parameters(J: Floats) -> Floats:
    """Return the ten parameters of a pseudo-inertia, (4, 4) to (10,)."""
    xx, yy, zz = np.trace(J[:3, :3]) - np.diag(J[:3, :3])
    return np.array([J[3, 3], *J[:3, 3], xx, -J[0, 1], yy, -J[0, 2], -J[1, 2], zz])
