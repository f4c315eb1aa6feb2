"""The joint-torque regressor of whole logs: W(q, v, a) @ pi == inverse(q, v, a).

``pi`` is that of :mod:`pinotwin.dynamics.parameters`, rotor inertia included. Trees of revolute and
prismatic joints go through a compiled kernel that computes only the wanted columns and only entries
that are not zero for every motion; any other model through a loop over Pinocchio.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.checks import as_log
from pinotwin.dynamics.parameters import body_count, parameter_count
from pinotwin.dynamics.plan import plan_columns, run
from pinotwin.dynamics.tree import tree
from pinotwin.errors import DataError


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
    geometry = tree(model)
    if geometry is None:
        return regressor_loop(model, q, v, a, wanted)
    return run(geometry, plan_columns(geometry, wanted), q, v, a)


def regressor_blocks(
    model: pin.Model,
    q: Floats,
    v: Floats,
    a: Floats,
    columns: Ints | None = None,
    block: int = 10_000,
) -> Iterator[tuple[slice, Floats]]:
    """Yield (rows, W of those rows) for a long log, so that W need not be held at once.

    Args:
        model: the machine.
        q: positions [m or rad], shape (n, nv).
        v: velocities, shape (n, nv).
        a: accelerations, shape (n, nv).
        columns: indices into ``pi``; None for all.
        block: rows at a time.
    """
    q, v, a = as_log(model, q=q, v=v, a=a)
    wanted = _wanted(model, columns)
    geometry = tree(model)
    plan = None if geometry is None else plan_columns(geometry, wanted)
    for first in range(0, len(q), block):
        rows = slice(first, min(first + block, len(q)))
        if geometry is None or plan is None:
            yield rows, regressor_loop(model, q[rows], v[rows], a[rows], wanted)
        else:
            yield rows, run(geometry, plan, q[rows], v[rows], a[rows])


def regressor_loop(model: pin.Model, q: Floats, v: Floats, a: Floats, columns: Ints | None = None) -> Floats:
    """Return the same as :func:`regressor`, sample by sample through Pinocchio: slow, any joint."""
    q, v, a = as_log(model, q=q, v=v, a=a)
    wanted = _wanted(model, columns)
    bodies = 10 * body_count(model)
    link, rotor = wanted < bodies, wanted >= bodies
    joints = wanted[rotor] - bodies
    data = model.createData()
    W = np.zeros((len(q), model.nv, len(wanted)))
    for k in range(len(q)):
        row = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
        W[k][:, link] = row.reshape(model.nv, bodies)[:, wanted[link]]  # flat if nv is 1
    W[:, joints, np.flatnonzero(rotor)] = a[:, joints]
    return W


def _wanted(model: pin.Model, columns: Ints | None) -> Ints:
    p = parameter_count(model)
    if columns is None:
        return np.arange(p, dtype=np.intp)
    wanted = np.asarray(columns, dtype=np.intp)
    if wanted.ndim != 1 or np.any((wanted < 0) | (wanted >= p)):
        raise DataError(f"columns must be indices from 0 to {p - 1}, got {wanted.tolist()}")
    return wanted
