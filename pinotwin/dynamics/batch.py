"""Rigid-body dynamics of whole logs: M(q) a + c(q, v) + g(q) = tau, rotor inertia on M's diagonal.

All arrays have one row per sample and one column per joint, shape (n, nv), SI. The work is done by
Pinocchio (Carpentier et al. 2019, doi:10.1109/SII.2019.8700380); one thread, so that the result
does not depend on the machine it runs on.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.checks import as_log, require_depth_first


def inverse(model: pin.Model, q: Floats, v: Floats, a: Floats) -> Floats:
    """Return the joint effort that a motion needs [N or N·m], shape (n, nv)."""
    q, v, a = as_log(model, q=q, v=v, a=a)
    tau = np.empty((model.nv, len(q)), order="F")
    if len(q):
        pin.rneaInParallel(1, pin.ModelPool(model, 1), q.T, v.T, a.T, tau)
    return tau.T


def mass_matrix(model: pin.Model, q: Floats) -> Floats:
    """Return the joint-space mass matrix M(q) with rotor inertia, shape (n, nv, nv).

    Raises:
        MachineError: the joints are not in depth-first order (as those of a URDF always are).
    """
    (q,) = as_log(model, q=q)
    require_depth_first(model)
    data = model.createData()
    M = np.empty((len(q), model.nv, model.nv))
    for k, qk in enumerate(q):
        M[k] = pin.crba(model, data, qk)
    return M
