"""Rigid-body dynamics of the virtual machines, by Pinocchio and by their compiled loop."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.virtual.recording import SealedTruth
from pinotwin.virtual.rigid import Tree, empty_pose, fold, invert, move, place


def inverse_dynamics(truth: SealedTruth) -> Floats:
    """Return the efforts that Pinocchio asks for the true motion, shape (m, nv), armature included."""
    data = truth.model.createData()
    states = zip(truth.q, truth.v, truth.a, strict=True)
    return np.array([pin.rnea(truth.model, data, *state) for state in states])


def forward_dynamics(tree: Tree, q: Floats, v: Floats, tau: Floats) -> Floats:
    """Return the accelerations, shape (nv,), that the compiled loop finds for positions, velocities and efforts."""
    pose, h = empty_pose(tree), np.zeros_like(q)
    M, inverse = np.zeros((2, len(q), len(q)))
    place(tree, q, pose)
    move(tree, v, pose)
    fold(tree, pose, h, M)
    invert(M, inverse)
    return inverse @ (tau - h)
