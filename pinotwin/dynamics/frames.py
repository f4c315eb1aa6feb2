"""Motion of, and loads on, a named frame of the machine, for whole logs.

Six-vectors are Pinocchio's, linear part first; ``LOCAL`` axes are the frame's, ``world`` axes those of the base.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import as_log
from pinotwin.errors import DataError, MachineError, require


def frame_id(model: pin.Model, frame: str) -> int:
    """Return Pinocchio's index of a frame (a link, a joint or an operational frame); unknown ones are refused."""
    names = [f.name for f in model.frames]
    require(frame, names, f"machine {model.name!r}: no frame", MachineError)
    return names.index(frame)


def jacobian(model: pin.Model, frame: str, q: Floats, *, world: bool = False) -> Floats:
    """Return the Jacobian of a frame, [linear; angular] velocity = J v, (n, 6, nv), in its own or the world's axes."""
    (q,) = as_log(model, q=q)
    index, data = frame_id(model, frame), model.createData()
    axes = pin.LOCAL_WORLD_ALIGNED if world else pin.LOCAL
    J = np.empty((len(q), 6, model.nv))
    for k, qk in enumerate(q):
        # Pinocchio drops the last axis if nv is 1
        J[k] = pin.computeFrameJacobian(model, data, qk, index, axes).reshape(6, model.nv)
    return J


def frame_rotation(model: pin.Model, frame: str, q: Floats) -> Floats:
    """Return R_world_frame, whose columns are the frame's axes in the world, shape (n, 3, 3)."""
    return _along(model, frame, (3, 3), lambda d, i: pin.updateFramePlacement(model, d, i).rotation, q=q)


def frame_velocity(model: pin.Model, frame: str, q: Floats, v: Floats) -> Floats:
    """Return the frame's velocity in its own axes [m/s; rad/s], shape (n, 6)."""
    return _along(
        model, frame, (6,), lambda d, i: pin.getFrameVelocity(model, d, i, pin.LOCAL).vector, q=q, v=v
    )


def frame_acceleration(model: pin.Model, frame: str, q: Floats, v: Floats, a: Floats) -> Floats:
    """Return the classical acceleration of a frame, linear, angular, in its axes, no gravity [m/s²; rad/s²], (n, 6)."""
    at = pin.getFrameClassicalAcceleration
    return _along(model, frame, (6,), lambda d, i: at(model, d, i, pin.LOCAL).vector, q=q, v=v, a=a)


def _along(
    model: pin.Model,
    frame: str,
    shape: tuple[int, ...],
    what: Callable[[pin.Data, int], Floats],
    **motion: Floats,
) -> Floats:
    """Return what Pinocchio says of a frame at every sample of a motion, shape (n, *shape)."""
    rows = as_log(model, **motion)
    index, data = frame_id(model, frame), model.createData()
    out = np.empty((len(rows[0]), *shape))
    for k, row in enumerate(zip(*rows, strict=True)):
        pin.forwardKinematics(model, data, *row)
        out[k] = what(data, index)
    return out


def external_effort(model: pin.Model, frame: str, q: Floats, wrench_world: Floats) -> Floats:
    """Return the effort J^T f [N or N·m], (n, nv), of a load (n, 6) [N, N·m] at a frame's origin, in world axes."""
    f = np.asarray(wrench_world, dtype=float)
    J = jacobian(model, frame, q, world=True)
    if f.shape != (len(J), 6):
        raise DataError(f"load on {frame!r} has shape {f.shape}, expected ({len(J)}, 6)")
    return np.einsum("nij,ni->nj", J, f)
