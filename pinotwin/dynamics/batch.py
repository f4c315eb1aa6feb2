"""Rigid-body dynamics of whole logs: M(q) a + c(q, v) + g(q) = tau = W(q, v, a) pi, rotor inertia on M's diagonal.

Arrays (n, nv), SI; by Pinocchio (Carpentier et al. 2019, doi:10.1109/SII.2019.8700380) on one thread: reproducible.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.parameters import as_log, body_count, parameter_count, require_depth_first
from pinotwin.errors import DataError


def inverse(model: pin.Model, q: Floats, v: Floats, a: Floats) -> Floats:
    """Return the joint effort that a motion needs [N or N·m], shape (n, nv)."""
    q, v, a = as_log(model, q=q, v=v, a=a)
    tau = np.empty((model.nv, len(q)), order="F")
    if len(q):
        pin.rneaInParallel(1, pin.ModelPool(model, 1), q.T, v.T, a.T, tau)
    return tau.T


def mass_matrix(model: pin.Model, q: Floats) -> Floats:
    """Return M(q) with rotor inertia, shape (n, nv, nv); MachineError unless joints are depth first, as in a URDF."""
    (q,) = as_log(model, q=q)
    require_depth_first(model)
    data = model.createData()
    M = np.empty((len(q), model.nv, model.nv))
    for k, qk in enumerate(q):
        M[k] = pin.crba(model, data, qk)
    return M


def regressor(model: pin.Model, q: Floats, v: Floats, a: Floats, columns: Ints | None = None) -> Floats:
    """Return W with W @ pi = joint effort, shape (n, nv, p), or some ``columns``; ``q``, ``v``, ``a`` (n, nv), SI."""
    q, v, a = as_log(model, q=q, v=v, a=a)
    p, bodies = parameter_count(model), 10 * body_count(model)
    wanted = np.arange(p) if columns is None else np.asarray(columns, dtype=np.intp)
    if wanted.ndim != 1 or np.any((wanted < 0) | (wanted >= p)):
        raise DataError(f"columns must be indices from 0 to {p - 1}, got {wanted.tolist()}")
    link, rotor = np.flatnonzero(wanted < bodies), np.flatnonzero(wanted >= bodies)
    joints = wanted[rotor] - bodies
    W = np.zeros((len(q), model.nv, len(wanted)))
    W[:, joints, rotor] = a[:, joints]
    block = 1024  # samples whose full rows are held at once: 3 MB for six joints, within a cache
    full = np.empty((min(block, len(q)), model.nv, bodies))
    data = model.createData()
    for first in range(0, len(q), block):
        rows = slice(first, min(first + block, len(q)))
        for k, state in enumerate(zip(q[rows], v[rows], a[rows], strict=True)):
            row = pin.computeJointTorqueRegressor(model, data, *state)
            full[k] = row.reshape(model.nv, bodies)  # Pinocchio drops an axis if nv is 1
        W[rows, :, link] = full[: rows.stop - first, :, wanted[link]]
    return W
