"""Mass matrix of a tree, its inverse, and forward dynamics; see :mod:`pinotwin.virtual.rigid`."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.virtual.jit import kernel
from pinotwin.virtual.rigid import (
    Tree,
    body_forces,
    empty_pose,
    joint_efforts,
    move,
    place,
)


@kernel
def _composite(tree, pose):  # type: ignore[no-untyped-def]
    """Fill the composite inertia of everything that each joint carries."""
    E, r, cm, ch, cI = pose.E, pose.r, pose.cm, pose.ch, pose.cI
    parent, mass, moment, inertia = tree.parent, tree.mass, tree.moment, tree.inertia
    nv = len(mass)
    for i in range(nv):
        cm[i] = mass[i]
        for k in range(3):
            ch[i, k] = moment[i, k]
            for m in range(3):
                cI[i, k, m] = inertia[i, k, m]
    for i in range(nv - 1, -1, -1):
        j = parent[i]
        if j < 0:
            continue
        m0, rx, ry, rz = cm[i], r[i, 0], r[i, 1], r[i, 2]
        h0, h1, h2 = ch[i, 0], ch[i, 1], ch[i, 2]
        hx = E[i, 0, 0] * h0 + E[i, 0, 1] * h1 + E[i, 0, 2] * h2
        hy = E[i, 1, 0] * h0 + E[i, 1, 1] * h1 + E[i, 1, 2] * h2
        hz = E[i, 2, 0] * h0 + E[i, 2, 1] * h1 + E[i, 2, 2] * h2
        cm[j] += m0
        ch[j, 0] += hx + m0 * rx
        ch[j, 1] += hy + m0 * ry
        ch[j, 2] += hz + m0 * rz
        for k in range(3):
            e0, e1, e2 = E[i, k, 0], E[i, k, 1], E[i, k, 2]
            t0 = e0 * cI[i, 0, 0] + e1 * cI[i, 1, 0] + e2 * cI[i, 2, 0]
            t1 = e0 * cI[i, 0, 1] + e1 * cI[i, 1, 1] + e2 * cI[i, 2, 1]
            t2 = e0 * cI[i, 0, 2] + e1 * cI[i, 1, 2] + e2 * cI[i, 2, 2]
            for m in range(3):
                cI[j, k, m] += t0 * E[i, m, 0] + t1 * E[i, m, 1] + t2 * E[i, m, 2]
        # Parallel axes: the diagonal takes r.(2 h + m r) less its own term.
        cx, cy, cz = 2.0 * hx + m0 * rx, 2.0 * hy + m0 * ry, 2.0 * hz + m0 * rz
        cI[j, 0, 0] += ry * cy + rz * cz
        cI[j, 1, 1] += rx * cx + rz * cz
        cI[j, 2, 2] += rx * cx + ry * cy
        xy = rx * hy + ry * hx + m0 * rx * ry
        xz = rx * hz + rz * hx + m0 * rx * rz
        yz = ry * hz + rz * hy + m0 * ry * rz
        cI[j, 0, 1] -= xy
        cI[j, 1, 0] -= xy
        cI[j, 0, 2] -= xz
        cI[j, 2, 0] -= xz
        cI[j, 1, 2] -= yz
        cI[j, 2, 1] -= yz


@kernel
def mass_matrix(tree, pose, M):  # type: ignore[no-untyped-def]
    """Fill the joint-space mass matrix with armature, shape (nv, nv); needs :func:`place`."""
    _composite(tree, pose)
    E, r, cm, ch, cI = pose.E, pose.r, pose.cm, pose.ch, pose.cI
    parent, rotary, axis, armature = tree.parent, tree.rotary, tree.axis, tree.armature
    nv = len(parent)
    for i in range(nv):
        sx, sy, sz = axis[i, 0], axis[i, 1], axis[i, 2]
        hx, hy, hz = ch[i, 0], ch[i, 1], ch[i, 2]
        if rotary[i] == 1:
            fx, fy, fz = sy * hz - sz * hy, sz * hx - sx * hz, sx * hy - sy * hx
            nx = cI[i, 0, 0] * sx + cI[i, 0, 1] * sy + cI[i, 0, 2] * sz
            ny = cI[i, 1, 0] * sx + cI[i, 1, 1] * sy + cI[i, 1, 2] * sz
            nz = cI[i, 2, 0] * sx + cI[i, 2, 1] * sy + cI[i, 2, 2] * sz
            M[i, i] = sx * nx + sy * ny + sz * nz + armature[i]
        else:
            nx, ny, nz = hy * sz - hz * sy, hz * sx - hx * sz, hx * sy - hy * sx
            fx, fy, fz = cm[i] * sx, cm[i] * sy, cm[i] * sz
            M[i, i] = sx * fx + sy * fy + sz * fz + armature[i]
        for j in range(i):
            M[i, j] = M[j, i] = 0.0
        j = i
        while parent[j] >= 0:
            gx = E[j, 0, 0] * nx + E[j, 0, 1] * ny + E[j, 0, 2] * nz
            gy = E[j, 1, 0] * nx + E[j, 1, 1] * ny + E[j, 1, 2] * nz
            gz = E[j, 2, 0] * nx + E[j, 2, 1] * ny + E[j, 2, 2] * nz
            ux = E[j, 0, 0] * fx + E[j, 0, 1] * fy + E[j, 0, 2] * fz
            uy = E[j, 1, 0] * fx + E[j, 1, 1] * fy + E[j, 1, 2] * fz
            uz = E[j, 2, 0] * fx + E[j, 2, 1] * fy + E[j, 2, 2] * fz
            fx, fy, fz = ux, uy, uz
            nx = gx + r[j, 1] * fz - r[j, 2] * fy
            ny = gy + r[j, 2] * fx - r[j, 0] * fz
            nz = gz + r[j, 0] * fy - r[j, 1] * fx
            j = parent[j]
            if rotary[j] == 1:
                M[i, j] = axis[j, 0] * nx + axis[j, 1] * ny + axis[j, 2] * nz
            else:
                M[i, j] = axis[j, 0] * fx + axis[j, 1] * fy + axis[j, 2] * fz
            M[j, i] = M[i, j]


@kernel
def _cholesky(M, L):  # type: ignore[no-untyped-def]
    """Fill the lower triangle of ``L`` with the Cholesky factor of ``M``."""
    for i in range(len(M)):
        for j in range(i + 1):
            x = M[i, j]
            for k in range(j):
                x -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(x) if i == j else x / L[j, j]


@kernel
def invert(M, W, inverse):  # type: ignore[no-untyped-def]
    """Fill ``inverse`` with M^-1 by Cholesky (``W`` is room), all of shape (nv, nv)."""
    nv = len(M)
    _cholesky(M, W)
    for i in range(nv):  # the inverse of the factor, transposed, in the upper triangle
        inverse[i, i] = 1.0 / W[i, i]
        for j in range(i - 1, -1, -1):
            x = 0.0
            for k in range(j, i):
                x -= W[i, k] * inverse[j, k]
            inverse[j, i] = x / W[i, i]
    for i in range(nv):  # row by row: row i is not read again once its product is known
        for j in range(i, nv):
            x = 0.0
            for k in range(j, nv):
                x += inverse[i, k] * inverse[j, k]
            W[i, j] = x
        for j in range(i, nv):
            inverse[i, j] = W[i, j]
            inverse[j, i] = W[i, j]


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
