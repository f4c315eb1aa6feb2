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


def forward(model: pin.Model, q: Floats, v: Floats, tau: Floats) -> Floats:
    """Return the acceleration that an effort causes [m/s² or rad/s²], shape (n, nv)."""
    q, v, tau = as_log(model, q=q, v=v, tau=tau)
    a = np.empty((model.nv, len(q)), order="F")
    if len(q):
        pin.abaInParallel(1, pin.ModelPool(model, 1), q.T, v.T, tau.T, a)
    return a.T


def bias(model: pin.Model, q: Floats, v: Floats) -> Floats:
    """Return Coriolis, centrifugal and gravity effort c(q, v) + g(q) [N or N·m], shape (n, nv)."""
    q, v = as_log(model, q=q, v=v)
    return inverse(model, q, v, np.zeros_like(q))


def gravity(model: pin.Model, q: Floats) -> Floats:
    """Return the effort that holds the machine still, g(q) [N or N·m], shape (n, nv)."""
    (q,) = as_log(model, q=q)
    zero = np.zeros_like(q)
    return inverse(model, q, zero, zero)


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
