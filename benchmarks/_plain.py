"""The floor: Pinocchio's regressor, viscous and dry friction and an offset an axis, weighted least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import pinotwin as pt
from pinotwin.arrays import Floats
from pinotwin.dynamics.batch import regressor
from pinotwin.motion import Motion


def plain_error(twin: pt.Twin, fitted: Sequence[pt.Log], judged: pt.Log) -> float:
    """Return the floor's unseen error over the torque, on logs prepared as the twin's, fitted to the same ones."""
    machine, parts = twin.machine, [twin.motion(log) for log in fitted]
    use = [(m.use & m.inside[:, None])[:: m.decimation] for m in parts]
    A = np.concatenate([_columns(machine, m)[:: m.decimation][k] for m, k in zip(parts, use, strict=True)])
    u = np.concatenate([m.u[:: m.decimation][k] for m, k in zip(parts, use, strict=True)])
    axis = np.concatenate([np.nonzero(k)[1] for k in use])
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    weight = np.ones(machine.nv)
    for _ in range(20):
        w = weight[axis]
        theta = np.linalg.lstsq(A / size * w[:, None], u * w, rcond=1e-4)[0] / size
        weight = 1.0 / np.sqrt(np.bincount(axis, (A @ theta - u) ** 2) / np.bincount(axis))
    motion = twin.motion(judged)
    return share_of_torque(motion, motion.u - _columns(machine, motion) @ theta)


def share_of_torque(motion: Motion, error: Floats) -> float:
    """Return the norm of an error (n, nv) over that of the measured torque."""
    rows = motion.inside & np.isfinite(motion.u).all(axis=1)
    return float(np.linalg.norm(error[rows]) / np.linalg.norm(motion.u[rows]))


def _columns(machine: pt.Machine, motion: Motion) -> Floats:
    friction = (motion.v, np.sign(motion.v), np.ones_like(motion.v))
    own = [np.einsum("ij,jk->ijk", x, np.eye(machine.nv)) for x in friction]
    return np.concatenate([regressor(machine.model, motion.q, motion.v, motion.a), *own], axis=2)
