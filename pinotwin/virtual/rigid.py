"""Rigid-body dynamics of the virtual machines inside the compiled loop: M(q) a + h(q, v) = tau + J^T f_ext.

``h`` by recursive Newton-Euler, ``M`` by composite rigid bodies (Featherstone 2008, doi:10.1007/978-1-4899-7560-7,
chapters 5 and 6), in world axes about the world's origin, where forces and inertias simply add. Pinocchio is as fast,
but leaving the loop for it makes a run three times as long (docs/architecture.md); tests hold both equal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual.columns import kernel


class Tree(NamedTuple):
    """The arrays of a model that the loop reads; joint ``i`` has its parent before it."""

    parent: Ints  # index of the parent joint, -1 for the ground, shape (nv,)
    rotary: Ints  # 1 for a rotation, 0 for a translation, shape (nv,)
    axis: Floats  # unit joint axis in the joint frame, shape (nv, 3)
    placement: Floats  # rotation of the joint frame in the parent's at q = 0, shape (nv, 3, 3)
    offset: Floats  # origin of the joint frame in the parent's [m], shape (nv, 3)
    mass: Floats  # mass of the body [kg], shape (nv,)
    moment: Floats  # first moment m c about the joint's origin [kg·m], shape (nv, 3)
    inertia: Floats  # rotational inertia about the joint's origin [kg·m²], shape (nv, 3, 3)
    armature: Floats  # reflected rotor inertia [kg or kg·m²], shape (nv,)
    gravity: Floats  # acceleration of gravity [m/s²], shape (3,)


class Pose(NamedTuple):
    """Room for one evaluation, about the world's origin in world axes; the last row is the ground."""

    R: Floats  # rotation of every body, shape (nv + 1, 3, 3)
    p: Floats  # its joint's origin [m], shape (nv + 1, 3)
    slide: Floats  # linear part of the joint's axis as a twist, shape (nv + 1, 3)
    turn: Floats  # angular part
    v: Floats  # velocity of the body's point at the world's origin [m/s]
    w: Floats  # angular velocity [rad/s]
    dv: Floats  # derivatives of both without joint accelerations, gravity included [m/s²]
    dw: Floats  # [rad/s²]
    f: Floats  # force on the body [N]
    n: Floats  # moment [N·m]
    m: Floats  # mass, in the end of everything that a joint carries [kg], shape (nv + 1,)
    h: Floats  # first moment [kg·m], shape (nv + 1, 3)
    I: Floats  # inertia [kg·m²], shape (nv + 1, 3, 3)


def empty_pose(tree: Tree) -> Pose:
    """Return room for an evaluation of a tree."""
    rows, shapes = len(tree.mass) + 1, {"R": (3, 3), "I": (3, 3), "m": ()}
    pose = Pose(*(np.zeros((rows, *shapes.get(name, (3,)))) for name in Pose._fields))
    pose.R[-1], pose.dv[-1] = np.eye(3), -tree.gravity
    return pose


@kernel
def row(x, i):  # type: ignore[no-untyped-def]
    """Return row ``i`` of vectors (n, 3) as a tuple."""
    return x[i, 0], x[i, 1], x[i, 2]


@kernel
def put(x, i, a):  # type: ignore[no-untyped-def]
    """Write a tuple into row ``i`` of vectors (n, 3)."""
    x[i, 0], x[i, 1], x[i, 2] = a


@kernel
def plus(a, b):  # type: ignore[no-untyped-def]
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def times(s, a):  # type: ignore[no-untyped-def]
    """Return a number times a vector."""
    return s * a[0], s * a[1], s * a[2]


@kernel
def dot(a, b):  # type: ignore[no-untyped-def]
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):  # type: ignore[no-untyped-def]
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def product(E, i, a):  # type: ignore[no-untyped-def]
    """Return E[i] a, of matrices (n, 3, 3)."""
    return dot(row(E[i], 0), a), dot(row(E[i], 1), a), dot(row(E[i], 2), a)


@kernel
def along(pose, i, f, n):  # type: ignore[no-untyped-def]
    """Return the part of a force and a moment that joint ``i`` has to give."""
    return dot(row(pose.slide, i), f) + dot(row(pose.turn, i), n)


@kernel
def place(tree, q, pose):  # type: ignore[no-untyped-def]
    """Place every body, its joint's axis and its inertia for the positions ``q``, shape (nv,)."""
    R, p = pose.R, pose.p
    for i in range(len(q)):
        j = tree.parent[i]
        x, y, z = row(tree.axis, i)
        c, s, way = 1.0, 0.0, q[i]
        if tree.rotary[i] == 1:
            c, s, way = np.cos(q[i]), np.sin(q[i]), 0.0
        d = 1.0 - c
        columns = (
            (c + d * x * x, d * x * y + s * z, d * x * z - s * y),
            (d * x * y - s * z, c + d * y * y, d * y * z + s * x),
            (d * x * z + s * y, d * y * z - s * x, c + d * z * z),
        )
        for k in range(3):
            R[i, 0, k], R[i, 1, k], R[i, 2, k] = product(R, j, product(tree.placement, i, columns[k]))
        axis = product(R, j, product(tree.placement, i, (x, y, z)))
        put(p, i, plus(row(p, j), plus(product(R, j, row(tree.offset, i)), times(way, axis))))
        if tree.rotary[i] == 1:
            put(pose.slide, i, cross(row(p, i), axis))
            put(pose.turn, i, axis)
        else:
            put(pose.slide, i, axis)
        weigh(tree, i, pose)


@kernel
def weigh(tree, i, pose):  # type: ignore[no-untyped-def]
    """Fill mass, first moment and inertia of body ``i`` about the world's origin."""
    m, R, r = tree.mass[i], pose.R, row(pose.p, i)
    h = product(R, i, row(tree.moment, i))
    whole = plus(h, times(m, r))
    pose.m[i] = m
    put(pose.h, i, whole)
    for k in range(3):
        # Row k of R I R^T, and by parallel axes of r.(2 h + m r) 1 - r (h + m r)^T - h r^T.
        own = product(R, i, product(tree.inertia, i, row(R[i], k)))
        put(pose.I[i], k, plus(own, plus(times(-r[k], whole), times(-h[k], r))))
        pose.I[i, k, k] += dot(r, plus(h, whole))


@kernel
def move(tree, v, pose):  # type: ignore[no-untyped-def]
    """Fill what the speeds ``v``, shape (nv,), and gravity ask of every body; needs :func:`place`."""
    I = pose.I
    for i in range(len(v)):
        j, m, h = tree.parent[i], pose.m[i], row(pose.h, i)
        slide, turn = times(v[i], row(pose.slide, i)), times(v[i], row(pose.turn, i))
        u, w = row(pose.v, j), row(pose.w, j)
        du = plus(row(pose.dv, j), plus(cross(w, slide), cross(u, turn)))
        dw = plus(row(pose.dw, j), cross(w, turn))
        u, w = plus(u, slide), plus(w, turn)
        put(pose.v, i, u)
        put(pose.w, i, w)
        put(pose.dv, i, du)
        put(pose.dw, i, dw)
        linear = plus(times(m, u), cross(w, h))  # momentum
        angular = plus(product(I, i, w), cross(h, u))
        put(pose.f, i, plus(plus(times(m, du), cross(dw, h)), cross(w, linear)))
        rate = plus(cross(w, angular), cross(u, linear))
        put(pose.n, i, plus(plus(product(I, i, dw), cross(h, du)), rate))


@kernel
def apply_load(pose, body, point, load):  # type: ignore[no-untyped-def]
    """Subtract from a body a load in world axes [N, N·m], shape (6,), at a point in body axes [m]; after move."""
    f, n = (-load[0], -load[1], -load[2]), (-load[3], -load[4], -load[5])
    at = plus(row(pose.p, body), product(pose.R, body, (point[0], point[1], point[2])))
    put(pose.f, body, plus(row(pose.f, body), f))
    put(pose.n, body, plus(row(pose.n, body), plus(n, cross(at, f))))


@kernel
def fold(tree, pose, tau, M):  # type: ignore[no-untyped-def]
    """Fill the joint efforts (nv,), without the armature's, and the mass matrix (nv, nv) with it."""
    I = pose.I
    for i in range(len(M) - 1, -1, -1):
        j, m, h = tree.parent[i], pose.m[i], row(pose.h, i)
        f, n = row(pose.f, i), row(pose.n, i)
        tau[i] = along(pose, i, f, n)
        if j >= 0:
            put(pose.f, j, plus(row(pose.f, j), f))
            put(pose.n, j, plus(row(pose.n, j), n))
            put(pose.h, j, plus(row(pose.h, j), h))
            pose.m[j] += m
            for k in range(3):
                put(I[j], k, plus(row(I[j], k), row(I[i], k)))
        slide, turn = row(pose.slide, i), row(pose.turn, i)
        f, n = plus(times(m, slide), cross(turn, h)), plus(product(I, i, turn), cross(h, slide))
        for k in range(i):
            M[i, k] = M[k, i] = 0.0
        k = i
        while k >= 0:
            M[i, k] = M[k, i] = along(pose, k, f, n)
            k = tree.parent[k]
        M[i, i] += tree.armature[i]


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
