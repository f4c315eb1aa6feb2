"""The geometry of a machine as plain arrays, for the compiled kernels.

Only trees of single-axis revolute and prismatic joints, with axes in any direction; that is every
machine tool and nearly every robot. :func:`tree` returns None for anything else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints


@dataclass(frozen=True)
class Tree:
    """Joint i = 1..nb turns about, or slides along, a fixed axis; arrays have one row per joint.

    The placement of joint i in its parent is R = still + cos q cosine + sin q sine (row-major), and
    p = origin + q slide.

    Attributes:
        parent: number of the parent joint, 0 for the base, shape (nb,).
        revolute: 1 for a rotation, 0 for a slide, shape (nb,).
        axis: unit vector in the joint's frame, shape (nb, 3).
        still: constant part of R, shape (nb, 9).
        cosine: part of R that goes with cos q, shape (nb, 9).
        sine: part of R that goes with sin q, shape (nb, 9).
        origin: shape (nb, 3) [m].
        slide: axis in the parent's frame for a slide, zero for a rotation, shape (nb, 3).
        gravity: acceleration of gravity in the world [m/s²], shape (3,).
    """

    parent: Ints
    revolute: Floats
    axis: Floats
    still: Floats
    cosine: Floats
    sine: Floats
    origin: Floats
    slide: Floats
    gravity: Floats

    def chain(self, joint: int) -> list[int]:
        """Return a joint and all joints below it towards the base, nearest first."""
        out = []
        while joint > 0:
            out.append(joint)
            joint = int(self.parent[joint - 1])
        return out


_SINGLE_AXIS = ("JointModelR", "JointModelP")


def _axis(model: pin.Model, data: pin.Data, joint: int) -> Floats | None:
    """Return the joint's motion [linear; angular] per unit speed, or None if it is another kind."""
    j = model.joints[joint]
    if j.nq != 1 or j.nv != 1 or not j.shortname().startswith(_SINGLE_AXIS):
        return None
    J = pin.computeJointJacobian(model, data, pin.neutral(model), joint)
    column = J.reshape(6, model.nv)[:, j.idx_v]  # Pinocchio drops the last axis if nv is 1
    slides, turns = np.linalg.norm(column[:3]), np.linalg.norm(column[3:])
    # Exactly one of the two: a screw joint or an unnormalised axis is left to Pinocchio.
    return column if abs(slides + turns - 1.0) < 1e-14 and min(slides, turns) == 0.0 else None


def tree(model: pin.Model) -> Tree | None:
    """Return the arrays of a model, or None if it has a joint that the kernels do not know."""
    nb = model.njoints - 1
    data = model.createData()
    columns = [_axis(model, data, i) for i in range(1, nb + 1)]
    known = [c for c in columns if c is not None]
    if len(known) != nb or np.any(model.gravity.angular):
        return None
    S = np.array(known).reshape(nb, 6)
    turns = np.any(S[:, 3:], axis=1)
    axis = np.where(turns[:, None], S[:, 3:], S[:, :3])
    R0 = np.array([model.jointPlacements[i].rotation for i in range(1, nb + 1)]).reshape(nb, 3, 3)
    along = np.einsum("bij,bj,bk->bik", R0, axis, axis)  # R0 a a^T
    cross = np.cross(np.eye(3), axis[:, None, :])  # skew(a): row k is e_k x a
    mask = turns[:, None, None]
    return Tree(
        parent=np.array([model.parents[i] for i in range(1, nb + 1)], dtype=np.intp),
        revolute=turns.astype(float),
        axis=np.ascontiguousarray(axis),
        still=np.where(mask, along, R0).reshape(nb, 9),
        cosine=np.where(mask, R0 - along, 0.0).reshape(nb, 9),
        sine=np.where(mask, R0 @ cross, 0.0).reshape(nb, 9),
        origin=np.array([model.jointPlacements[i].translation for i in range(1, nb + 1)]),
        slide=np.where(turns[:, None], 0.0, np.einsum("bij,bj->bi", R0, axis)),
        gravity=np.array(model.gravity.linear, dtype=float),
    )
