"""Mass matrix of a tree, its inverse, and what gravity asks for; see :mod:`pinotwin.virtual.rigid`."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.virtual.jit import kernel
from pinotwin.virtual.rigid import (
    Tree,
    along,
    body_forces,
    cross,
    dot,
    empty_pose,
    handed_on,
    joint_efforts,
    move,
    out_of,
    place,
    plus,
    put,
    row,
    times,
)


@kernel
def _composite(tree, pose):  # type: ignore[no-untyped-def]
    """Fill mass, first moment and inertia of everything that each joint carries."""
    E, cm, ch, cI = pose.E, pose.cm, pose.ch, pose.cI
    for i in range(len(cm)):
        cm[i] = tree.mass[i]
        put(ch, i, row(tree.moment, i))
        for k in range(3):
            put(cI[i], k, row(tree.inertia[i], k))
    for i in range(len(cm) - 1, -1, -1):
        j = tree.parent[i]
        if j < 0:
            continue
        r, h = row(pose.r, i), out_of(E, i, row(ch, i))
        far = plus(times(2.0, h), times(cm[i], r))
        cm[j] += cm[i]
        put(ch, j, plus(row(ch, j), plus(h, times(cm[i], r))))
        for k in range(3):
            # Row k of E I E^T, and by parallel axes of r.(2 h + m r) 1 - r h^T - h r^T - m r r^T.
            turned = out_of(E, i, out_of(cI, i, row(E[i], k)))
            shift = plus(times(-r[k], plus(h, times(cm[i], r))), times(-h[k], r))
            put(cI[j], k, plus(row(cI[j], k), plus(turned, shift)))
            cI[j, k, k] += dot(r, far)


@kernel
def mass_matrix(tree, pose, M):  # type: ignore[no-untyped-def]
    """Fill the joint-space mass matrix with armature, shape (nv, nv); needs :func:`place`."""
    _composite(tree, pose)
    for i in range(len(M)):
        s, h = row(tree.axis, i), row(pose.ch, i)
        f, n = times(pose.cm[i], s), cross(h, s)
        if tree.rotary[i] == 1:
            f, n = cross(s, h), out_of(pose.cI, i, s)
        M[i, i] = along(tree, i, f, n) + tree.armature[i]
        for j in range(i):
            M[i, j] = M[j, i] = 0.0
        j = i
        while tree.parent[j] >= 0:
            f, n = handed_on(pose, j, f, n)
            j = tree.parent[j]
            M[i, j] = M[j, i] = along(tree, j, f, n)


@kernel
def invert(M, inverse):  # type: ignore[no-untyped-def]
    """Fill ``inverse`` with M^-1 by Gauss and Jordan; no pivots are needed, M is positive definite."""
    nv = len(M)
    for i in range(nv):
        for j in range(nv):
            inverse[i, j] = M[i, j]
    for k in range(nv):
        pivot = 1.0 / inverse[k, k]
        inverse[k, k] = 1.0
        for j in range(nv):
            inverse[k, j] *= pivot
        for i in range(nv):
            if i != k:
                factor = inverse[i, k]
                inverse[i, k] = 0.0
                for j in range(nv):
                    inverse[i, j] -= factor * inverse[k, j]


def inertia_at(tree: Tree, q: Floats) -> Floats:
    """Return the mass matrix at a position, shape (nv, nv)."""
    pose = empty_pose(len(q))
    M = np.zeros((len(q), len(q)))
    place(tree, q, pose)
    mass_matrix(tree, pose, M)
    return M


def gravity_at(tree: Tree, q: Floats) -> Floats:
    """Return the efforts that hold the machine still, shape (nv,)."""
    pose, still, tau = empty_pose(len(q)), np.zeros(len(q)), np.zeros(len(q))
    place(tree, q, pose)
    move(tree, still, still, pose)
    body_forces(tree, pose)
    joint_efforts(tree, pose, tau)
    return tau
