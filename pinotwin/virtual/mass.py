"""Mass matrix of a tree, its inverse, and forward dynamics; see :mod:`pinotwin.virtual.rigid`."""

from __future__ import annotations

import numpy as np
from numba import njit

from pinotwin.arrays import Floats
from pinotwin.virtual.rigid import (
    Tree,
    body_forces,
    empty_pose,
    joint_efforts,
    move,
    place,
)


@njit(cache=True)
def _composite(tree, pose):  # type: ignore[no-untyped-def]
    """Fill the composite inertia of everything that each joint carries."""
    nv = len(tree.mass)
    for i in range(nv):
        pose.cm[i] = tree.mass[i]
        for k in range(3):
            pose.ch[i, k] = tree.moment[i, k]
            for m in range(3):
                pose.cI[i, k, m] = tree.inertia[i, k, m]
    h = np.empty(3)
    T = np.empty((3, 3))
    for i in range(nv - 1, -1, -1):
        j = tree.parent[i]
        if j < 0:
            continue
        E, r, m0, I = pose.E[i], pose.r[i], pose.cm[i], pose.cI[i]
        for k in range(3):
            h[k] = E[k, 0] * pose.ch[i, 0] + E[k, 1] * pose.ch[i, 1] + E[k, 2] * pose.ch[i, 2]
            for m in range(3):
                T[k, m] = E[k, 0] * I[0, m] + E[k, 1] * I[1, m] + E[k, 2] * I[2, m]
        trace = 2.0 * (r[0] * h[0] + r[1] * h[1] + r[2] * h[2])
        trace += m0 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        pose.cm[j] += m0
        for k in range(3):
            pose.ch[j, k] += h[k] + m0 * r[k]
            for m in range(3):
                turned = T[k, 0] * E[m, 0] + T[k, 1] * E[m, 1] + T[k, 2] * E[m, 2]
                shift = -r[k] * h[m] - h[k] * r[m] - m0 * r[k] * r[m]
                if k == m:
                    shift += trace
                pose.cI[j, k, m] += turned + shift


@njit(cache=True)
def mass_matrix(tree, pose, M):  # type: ignore[no-untyped-def]
    """Fill the joint-space mass matrix with armature, shape (nv, nv); needs :func:`place`."""
    _composite(tree, pose)
    nv = len(tree.mass)
    f = np.empty(3)
    n = np.empty(3)
    g = np.empty(3)
    M[:, :] = 0.0
    for i in range(nv):
        s, h = tree.axis[i], pose.ch[i]
        if tree.rotary[i] == 1:
            f[0], f[1] = s[1] * h[2] - s[2] * h[1], s[2] * h[0] - s[0] * h[2]
            f[2] = s[0] * h[1] - s[1] * h[0]
            for k in range(3):
                I = pose.cI[i, k]
                n[k] = I[0] * s[0] + I[1] * s[1] + I[2] * s[2]
        else:
            n[0], n[1] = h[1] * s[2] - h[2] * s[1], h[2] * s[0] - h[0] * s[2]
            n[2] = h[0] * s[1] - h[1] * s[0]
            for k in range(3):
                f[k] = pose.cm[i] * s[k]
        own = n if tree.rotary[i] == 1 else f
        M[i, i] = s[0] * own[0] + s[1] * own[1] + s[2] * own[2] + tree.armature[i]
        j = i
        while tree.parent[j] >= 0:
            E, r = pose.E[j], pose.r[j]
            for k in range(3):
                g[k] = E[k, 0] * n[0] + E[k, 1] * n[1] + E[k, 2] * n[2]
            for k in range(3):
                n[k] = E[k, 0] * f[0] + E[k, 1] * f[1] + E[k, 2] * f[2]
            for k in range(3):
                f[k] = n[k]
            n[0] = g[0] + r[1] * f[2] - r[2] * f[1]
            n[1] = g[1] + r[2] * f[0] - r[0] * f[2]
            n[2] = g[2] + r[0] * f[1] - r[1] * f[0]
            j = tree.parent[j]
            sj = tree.axis[j]
            load = n if tree.rotary[j] == 1 else f
            M[i, j] = sj[0] * load[0] + sj[1] * load[1] + sj[2] * load[2]
            M[j, i] = M[i, j]


@njit(cache=True)
def invert(M, W, inverse):  # type: ignore[no-untyped-def]
    """Fill ``inverse`` with M^-1 by Cholesky (``W`` is room), all of shape (nv, nv)."""
    nv = len(M)
    for i in range(nv):
        for j in range(i + 1):
            x = M[i, j]
            for k in range(j):
                x -= W[i, k] * W[j, k]
            W[i, j] = np.sqrt(x) if i == j else x / W[j, j]
    for i in range(nv):  # W <- W^-1, kept in the upper triangle of `inverse` for a moment
        inverse[i, i] = 1.0 / W[i, i]
        for j in range(i - 1, -1, -1):
            x = 0.0
            for k in range(j, i):
                x -= W[i, k] * inverse[j, k]
            inverse[j, i] = x / W[i, i]
    for i in range(nv):
        for j in range(i, nv):
            x = 0.0
            for k in range(j, nv):
                x += inverse[i, k] * inverse[j, k]
            W[i, j] = x
    for i in range(nv):
        for j in range(i, nv):
            inverse[i, j] = W[i, j]
            inverse[j, i] = W[i, j]


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
    invert(M, np.zeros((nv, nv)), inverse)
    return inverse @ (tau - h)


def inertia_at(tree: Tree, q: Floats) -> Floats:
    """Return the mass matrix at a position, shape (nv, nv)."""
    pose = empty_pose(len(q))
    M = np.zeros((len(q), len(q)))
    place(tree, q, pose)
    mass_matrix(tree, pose, M)
    return M


def gravity_at(tree: Tree, q: Floats) -> Floats:
    """Return the efforts that hold the machine still, shape (nv,)."""
    nv = len(q)
    pose = empty_pose(nv)
    tau = np.zeros(nv)
    place(tree, q, pose)
    move(tree, np.zeros(nv), np.zeros(nv), pose)
    body_forces(tree, pose)
    joint_efforts(tree, pose, tau)
    return tau
