"""Rigid-body dynamics of the virtual machines, compiled, for any tree of joints of one degree of freedom.

    M(q) a + h(q, v) = tau + J^T f_ext

``h`` by recursive Newton-Euler and ``M`` by composite rigid bodies (Featherstone 2008,
doi:10.1007/978-1-4899-7560-7, chapters 5 and 6), in body coordinates, every inertia about the joint's
origin. A call of Pinocchio from Python costs twice what a whole control period takes here (3.8 against
1.8 microseconds on three axes); the tests hold both equal. Nothing is shared with the identification.
Vectors are tuples, so that no function makes an array.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual.jit import kernel


class Tree(NamedTuple):
    """A tree of joints; joint ``i`` has its parent before it."""

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
    """Room for the results of one evaluation."""

    E: Floats  # rotation of every body in its parent, shape (nv, 3, 3)
    r: Floats  # its origin there [m], (nv, 3)
    R: Floats  # rotation of every body in the world, shape (nv, 3, 3)
    w: Floats  # angular velocity, body axes [rad/s], shape (nv, 3)
    dw: Floats  # its derivative [rad/s²]
    a: Floats  # acceleration of the origin, body axes, gravity included [m/s²], shape (nv, 3)
    f: Floats  # force on every body [N], shape (nv, 3)
    n: Floats  # moment about its origin [N·m]
    cm: Floats  # mass of everything that a joint carries [kg], shape (nv,)
    ch: Floats  # its first moment, (nv, 3)
    cI: Floats  # its inertia [kg·m²], shape (nv, 3, 3)


def empty_pose(nv: int) -> Pose:
    """Return room for a tree of ``nv`` joints."""
    shapes = {"E": (nv, 3, 3), "R": (nv, 3, 3), "cI": (nv, 3, 3), "cm": (nv,)}
    return Pose(*(np.zeros(shapes.get(name, (nv, 3))) for name in Pose._fields))


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
def out_of(E, i, a):  # type: ignore[no-untyped-def]
    """Return E[i] a: a vector of a body in the axes of its parent."""
    return dot(row(E[i], 0), a), dot(row(E[i], 1), a), dot(row(E[i], 2), a)


@kernel
def into(E, i, a):  # type: ignore[no-untyped-def]
    """Return E[i]^T a: a vector of the parent in the axes of a body."""
    return plus(plus(times(a[0], row(E[i], 0)), times(a[1], row(E[i], 1))), times(a[2], row(E[i], 2)))


@kernel
def along(tree, i, f, n):  # type: ignore[no-untyped-def]
    """Return the part of a force and a moment that joint ``i`` has to give."""
    return dot(row(tree.axis, i), n) if tree.rotary[i] == 1 else dot(row(tree.axis, i), f)


@kernel
def handed_on(pose, i, f, n):  # type: ignore[no-untyped-def]
    """Return force and moment of a body as its parent feels them."""
    g = out_of(pose.E, i, f)
    return g, plus(out_of(pose.E, i, n), cross(row(pose.r, i), g))


@kernel
def place(tree, q, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.E`` and ``pose.r`` for the positions ``q``, shape (nv,)."""
    P, E = tree.placement, pose.E
    for i in range(len(q)):
        x, y, z = row(tree.axis, i)
        c, s, slide = 1.0, 0.0, q[i]
        if tree.rotary[i] == 1:
            c, s, slide = np.cos(q[i]), np.sin(q[i]), 0.0
        d = 1.0 - c
        for k in range(3):
            p = row(P[i], k)
            E[i, k, 0] = dot(p, (c + d * x * x, d * x * y + s * z, d * x * z - s * y))
            E[i, k, 1] = dot(p, (d * x * y - s * z, c + d * y * y, d * y * z + s * x))
            E[i, k, 2] = dot(p, (d * x * z + s * y, d * y * z - s * x, c + d * z * z))
            pose.r[i, k] = tree.offset[i, k] + dot(p, (x, y, z)) * slide


@kernel
def place_in_world(tree, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.R`` from ``pose.E``."""
    E, R = pose.E, pose.R
    for i in range(len(tree.parent)):
        j = tree.parent[i]
        for k in range(3):
            at = E[i, 0, k], E[i, 1, k], E[i, 2, k]
            R[i, 0, k], R[i, 1, k], R[i, 2, k] = at if j < 0 else out_of(R, j, at)


@kernel
def move(tree, v, acc, pose):  # type: ignore[no-untyped-def]
    """Fill velocities and accelerations of the bodies; gravity enters as -g at the base."""
    E, g = pose.E, tree.gravity
    for i in range(len(v)):
        j, s = tree.parent[i], row(tree.axis, i)
        w = dw = (0.0, 0.0, 0.0)
        a = (-g[0], -g[1], -g[2])
        if j >= 0:
            w, dw, r = row(pose.w, j), row(pose.dw, j), row(pose.r, i)
            a = plus(row(pose.a, j), plus(cross(dw, r), cross(w, cross(w, r))))
        w, dw, a = into(E, i, w), into(E, i, dw), into(E, i, a)
        if tree.rotary[i] == 1:
            dw = plus(dw, plus(times(v[i], cross(w, s)), times(acc[i], s)))
            w = plus(w, times(v[i], s))
        else:
            a = plus(a, plus(times(2.0 * v[i], cross(w, s)), times(acc[i], s)))
        put(pose.w, i, w)
        put(pose.dw, i, dw)
        put(pose.a, i, a)


@kernel
def body_forces(tree, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.f`` and ``pose.n`` with what the motion of each body asks for."""
    for i in range(len(tree.mass)):
        h, w, dw, a = row(tree.moment, i), row(pose.w, i), row(pose.dw, i), row(pose.a, i)
        put(pose.f, i, plus(times(tree.mass[i], a), plus(cross(dw, h), cross(w, cross(w, h)))))
        spin = cross(w, out_of(tree.inertia, i, w))
        put(pose.n, i, plus(out_of(tree.inertia, i, dw), plus(spin, cross(h, a))))


@kernel
def apply_load(pose, body, point, load):  # type: ignore[no-untyped-def]
    """Subtract an external load from one body; needs ``pose.R``.

    Args:
        pose: the evaluation.
        body: index of the body.
        point: where the load acts, body axes [m], shape (3,).
        load: force and moment in world axes [N, N·m], shape (6,).
    """
    f = into(pose.R, body, (-load[0], -load[1], -load[2]))
    n = into(pose.R, body, (-load[3], -load[4], -load[5]))
    put(pose.f, body, plus(row(pose.f, body), f))
    put(pose.n, body, plus(row(pose.n, body), plus(n, cross((point[0], point[1], point[2]), f))))


@kernel
def joint_efforts(tree, pose, tau):  # type: ignore[no-untyped-def]
    """Fold the body forces towards the ground; fills ``tau``, shape (nv,), armature left out."""
    for i in range(len(tree.parent) - 1, -1, -1):
        f, n = row(pose.f, i), row(pose.n, i)
        tau[i] = along(tree, i, f, n)
        j = tree.parent[i]
        if j >= 0:
            f, n = handed_on(pose, i, f, n)
            put(pose.f, j, plus(row(pose.f, j), f))
            put(pose.n, j, plus(row(pose.n, j), n))
