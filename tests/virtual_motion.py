"""The virtual machines' rigid-body code on a motion, one sample at a time, to be held against other codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.virtual.mass import invert, mass_matrix
from pinotwin.virtual.recording import SealedTruth
from pinotwin.virtual.rigid import (
    Pose,
    Tree,
    body_forces,
    empty_pose,
    joint_efforts,
    move,
    place,
    place_in_world,
)


@dataclass(frozen=True)
class LinkMotion:
    """True motion of a link, world axes; ``n`` samples.

    Attributes:
        t: time [s], shape (n,).
        rotation: link frame in the world, shape (n, 3, 3).
        position: origin of the link frame [m], shape (n, 3).
        angular_velocity: [rad/s], shape (n, 3).
        angular_acceleration: [rad/s²], shape (n, 3).
        acceleration: of the frame's origin, gravity not included [m/s²], shape (n, 3).
    """

    t: Floats
    rotation: Floats
    position: Floats
    angular_velocity: Floats
    angular_acceleration: Floats
    acceleration: Floats


def link_motion(truth: SealedTruth, link: str) -> LinkMotion:
    """Return the true motion of a link of the URDF, sample by sample."""
    joint, rotation, offset = truth.links[link]
    n, tree, pose = len(truth.t), truth.tree, empty_pose(len(truth.joints))
    R, p, w, dw, a = (np.zeros((n, *s)) for s in ((3, 3), (3,), (3,), (3,), (3,)))
    for k in range(n):
        place(tree, truth.q[k], pose)
        place_in_world(tree, pose)
        move(tree, truth.v[k], truth.a[k], pose)
        body = pose.R[joint]
        R[k] = body @ rotation
        p[k] = body @ offset + sum(
            (_turn(pose, tree, j) @ pose.r[j] for j in _path(tree, joint)), np.zeros(3)
        )
        w[k], dw[k] = body @ pose.w[joint], body @ pose.dw[joint]
        arm = body @ offset
        a[k] = body @ pose.a[joint] + tree.gravity
        a[k] += np.cross(dw[k], arm) + np.cross(w[k], np.cross(w[k], arm))
    return LinkMotion(truth.t, R, p, w, dw, a)


def _path(tree: Tree, joint: int) -> list[int]:
    """The joints from a body down to the ground."""
    return [] if joint < 0 else [joint, *_path(tree, int(tree.parent[joint]))]


def _turn(pose: Pose, tree: Tree, joint: int) -> Floats:
    """The rotation of a joint's parent in the world."""
    parent = int(tree.parent[joint])
    return np.eye(3) if parent < 0 else pose.R[parent]


def inverse_dynamics(truth: SealedTruth) -> Floats:
    """Return the rigid-body efforts of the true motion, shape (m, nv), armature left out."""
    out, pose = np.zeros_like(truth.q), empty_pose(len(truth.joints))
    for k in range(len(truth.t)):
        place(truth.tree, truth.q[k], pose)
        move(truth.tree, truth.v[k], truth.a[k], pose)
        body_forces(truth.tree, pose)
        joint_efforts(truth.tree, pose, out[k])
    return out


def forward_dynamics(tree: Tree, q: Floats, v: Floats, tau: Floats) -> Floats:
    """Return the accelerations, shape (nv,), for positions, velocities and efforts."""
    nv = len(q)
    pose = empty_pose(nv)
    h = np.zeros(nv)
    M = np.zeros((nv, nv))
    inverse = np.zeros((nv, nv))
    place(tree, q, pose)
    move(tree, v, np.zeros(nv), pose)
    body_forces(tree, pose)
    joint_efforts(tree, pose, h)
    mass_matrix(tree, pose, M)
    invert(M, inverse)
    return inverse @ (tau - h)
