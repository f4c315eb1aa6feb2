"""The joint-torque regressor of whole logs: W(q, v, a) @ pi == inverse(q, v, a).

``pi`` is that of :mod:`pinotwin.dynamics.parameters`. Pinocchio computes the part of the ten inertial
parameters of every body, sample by sample (``computeJointTorqueRegressor``, Carpentier et al. 2019,
doi:10.1109/SII.2019.8700380); the rotor inertias, which it has no columns for, follow from the
accelerations.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.checks import as_log
from pinotwin.dynamics.parameters import body_count, parameter_count
from pinotwin.errors import DataError

_BLOCK = 1024  # samples whose full rows are held at once: 3 MB for six joints, within a cache


def regressor(model: pin.Model, q: Floats, v: Floats, a: Floats, columns: Ints | None = None) -> Floats:
    """Return W with W @ pi = joint effort, shape (n, nv, p), or only some of its columns.

    Args:
        model: the machine.
        q: positions [m or rad], shape (n, nv).
        v: velocities, shape (n, nv).
        a: accelerations, shape (n, nv).
        columns: indices into ``pi``; None for all.
    """
    q, v, a = as_log(model, q=q, v=v, a=a)
    wanted = _wanted(model, columns)
    bodies = 10 * body_count(model)
    link, rotor = np.flatnonzero(wanted < bodies), np.flatnonzero(wanted >= bodies)
    joints = wanted[rotor] - bodies
    W = np.zeros((len(q), model.nv, len(wanted)))
    W[:, joints, rotor] = a[:, joints]
    full = np.empty((min(_BLOCK, len(q)), model.nv, bodies))
    data = model.createData()
    for first in range(0, len(q), _BLOCK):
        rows = slice(first, min(first + _BLOCK, len(q)))
        for k, state in enumerate(zip(q[rows], v[rows], a[rows], strict=True)):
            row = pin.computeJointTorqueRegressor(model, data, *state)
            full[k] = row.reshape(model.nv, bodies)  # Pinocchio drops an axis if nv is 1
        W[rows, :, link] = full[: rows.stop - first, :, wanted[link]]
    return W


def _wanted(model: pin.Model, columns: Ints | None) -> Ints:
    p = parameter_count(model)
    if columns is None:
        return np.arange(p, dtype=np.intp)
    wanted = np.asarray(columns, dtype=np.intp)
    if wanted.ndim != 1 or np.any((wanted < 0) | (wanted >= p)):
        raise DataError(f"columns must be indices from 0 to {p - 1}, got {wanted.tolist()}")
    return wanted
