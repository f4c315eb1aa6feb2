"""Rigid-body dynamics of the virtual machines: their own numba code, for any tree of joints.

    M(q) a + h(q, v) = tau + J^T f_ext

``h`` by the recursive Newton-Euler algorithm and ``M`` by composite rigid bodies (Featherstone 2008,
doi:10.1007/978-1-4899-7560-7, chapters 5 and 6), in body coordinates, every inertia about the joint's
origin. Written apart from the identification side, so that an error there cannot hide here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pinotwin.arrays import Floats, Ints


class Tree(NamedTuple):
    """A tree of one-degree-of-freedom joints; joint ``i`` has its parent before it.

    Attributes:
        parent: index of the parent joint, -1 for the ground, shape (nv,).
        rotary: 1 for a rotation, 0 for a translation, shape (nv,).
        axis: unit joint axis in the joint frame, shape (nv, 3).
        placement: rotation of the joint frame in the parent's at q = 0, shape (nv, 3, 3).
        offset: origin of the joint frame in the parent's [m], shape (nv, 3).
        mass: mass of the body [kg], shape (nv,).
        moment: first moment m c about the joint's origin [kg·m], shape (nv, 3).
        inertia: rotational inertia about the joint's origin [kg·m²], shape (nv, 3, 3).
        armature: reflected rotor inertia [kg or kg·m²], shape (nv,).
        gravity: acceleration of gravity [m/s²], shape (3,).
    """

    parent: Ints
    rotary: Ints
    axis: Floats
    placement: Floats
    offset: Floats
    mass: Floats
    moment: Floats
    inertia: Floats
    armature: Floats
    gravity: Floats


class Pose(NamedTuple):
    """Room for the results of one evaluation.

    Attributes:
        E: rotation of every body in its parent, shape (nv, 3, 3).
        r: origin of every body in its parent [m], shape (nv, 3).
        R: rotation of every body in the world, shape (nv, 3, 3).
        p: origin of every body in the world [m], shape (nv, 3).
        w: angular velocity of every body, body axes [rad/s], shape (nv, 3).
        dw: its derivative [rad/s²], shape (nv, 3).
        a: acceleration of the origin, body axes, gravity included [m/s²], shape (nv, 3).
        f: force on every body [N], shape (nv, 3).
        n: moment about its origin [N·m], shape (nv, 3).
        cm: composite mass [kg], shape (nv,).
        ch: composite first moment [kg·m], shape (nv, 3).
        cI: composite inertia [kg·m²], shape (nv, 3, 3).
    """

    E: Floats
    r: Floats
    R: Floats
    p: Floats
    w: Floats
    dw: Floats
    a: Floats
    f: Floats
    n: Floats
    cm: Floats
    ch: Floats
    cI: Floats


def empty_pose(nv: int) -> Pose:
    """Return room for a tree of ``nv`` joints."""
    m, v = (nv, 3, 3), (nv, 3)
    z = np.zeros
    return Pose(z(m), z(v), z(m), z(v), z(v), z(v), z(v), z(v), z(v), z(nv), z(v), z(m))


@njit(cache=True, inline="always")
def _cross(u, v, out):  # type: ignore[no-untyped-def]
    out[0] = u[1] * v[2] - u[2] * v[1]
    out[1] = u[2] * v[0] - u[0] * v[2]
    out[2] = u[0] * v[1] - u[1] * v[0]


@njit(cache=True)
def place(tree, q, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.E`` and ``pose.r`` for the positions ``q``, shape (nv,)."""
    for i in range(len(q)):
        P, E, s, r = tree.placement[i], pose.E[i], tree.axis[i], pose.r[i]
        if tree.rotary[i] == 1:
            c, sn = np.cos(q[i]), np.sin(q[i])
            d, x, y, z = 1.0 - c, s[0], s[1], s[2]
            a00, a01, a02 = c + d * x * x, d * x * y - sn * z, d * x * z + sn * y
            a10, a11, a12 = d * x * y + sn * z, c + d * y * y, d * y * z - sn * x
            a20, a21, a22 = d * x * z - sn * y, d * y * z + sn * x, c + d * z * z
            for k in range(3):
                E[k, 0] = P[k, 0] * a00 + P[k, 1] * a10 + P[k, 2] * a20
                E[k, 1] = P[k, 0] * a01 + P[k, 1] * a11 + P[k, 2] * a21
                E[k, 2] = P[k, 0] * a02 + P[k, 1] * a12 + P[k, 2] * a22
                r[k] = tree.offset[i, k]
        else:
            for k in range(3):
                E[k, 0], E[k, 1], E[k, 2] = P[k, 0], P[k, 1], P[k, 2]
                along = P[k, 0] * s[0] + P[k, 1] * s[1] + P[k, 2] * s[2]
                r[k] = tree.offset[i, k] + along * q[i]


@njit(cache=True)
def place_in_world(tree, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.R`` and ``pose.p`` from ``pose.E`` and ``pose.r``."""
    for i in range(len(tree.mass)):
        j = tree.parent[i]
        for k in range(3):
            for m in range(3):
                if j < 0:
                    pose.R[i, k, m] = pose.E[i, k, m]
                else:
                    pose.R[i, k, m] = (
                        pose.R[j, k, 0] * pose.E[i, 0, m]
                        + pose.R[j, k, 1] * pose.E[i, 1, m]
                        + pose.R[j, k, 2] * pose.E[i, 2, m]
                    )
            pose.p[i, k] = pose.r[i, k]
            if j >= 0:
                pose.p[i, k] = (
                    pose.p[j, k]
                    + pose.R[j, k, 0] * pose.r[i, 0]
                    + pose.R[j, k, 1] * pose.r[i, 1]
                    + pose.R[j, k, 2] * pose.r[i, 2]
                )


@njit(cache=True)
def move(tree, v, a, pose):  # type: ignore[no-untyped-def]
    """Fill the velocities and accelerations of the bodies in ``pose``; gravity as -g at the base."""
    t = np.empty(3)
    b = np.empty(3)
    x = np.empty(3)
    wp = np.empty(3)
    for i in range(len(v)):
        j, E, r, s = tree.parent[i], pose.E[i], pose.r[i], tree.axis[i]
        for k in range(3):
            b[k] = -tree.gravity[k]
        if j >= 0:
            _cross(pose.w[j], r, t)
            _cross(pose.w[j], t, x)
            _cross(pose.dw[j], r, t)
            for k in range(3):
                b[k] = pose.a[j, k] + t[k] + x[k]
        for k in range(3):
            pose.a[i, k] = E[0, k] * b[0] + E[1, k] * b[1] + E[2, k] * b[2]
            wp[k] = 0.0
            pose.dw[i, k] = 0.0
            if j >= 0:
                wp[k] = E[0, k] * pose.w[j, 0] + E[1, k] * pose.w[j, 1] + E[2, k] * pose.w[j, 2]
                pose.dw[i, k] = (
                    E[0, k] * pose.dw[j, 0] + E[1, k] * pose.dw[j, 1] + E[2, k] * pose.dw[j, 2]
                )
            t[k] = s[k] * v[i]
        _cross(wp, t, x)
        if tree.rotary[i] == 1:
            for k in range(3):
                pose.w[i, k] = wp[k] + t[k]
                pose.dw[i, k] += x[k] + s[k] * a[i]
        else:
            for k in range(3):
                pose.w[i, k] = wp[k]
                pose.a[i, k] += 2.0 * x[k] + s[k] * a[i]


@njit(cache=True)
def body_forces(tree, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.f`` and ``pose.n`` with what the motion of each body asks for."""
    t = np.empty(3)
    x = np.empty(3)
    y = np.empty(3)
    for i in range(len(tree.mass)):
        h, w, dw, a, inertia = tree.moment[i], pose.w[i], pose.dw[i], pose.a[i], tree.inertia[i]
        _cross(dw, h, t)
        _cross(w, h, y)
        _cross(w, y, x)
        for k in range(3):
            pose.f[i, k] = tree.mass[i] * a[k] + t[k] + x[k]
            y[k] = inertia[k, 0] * w[0] + inertia[k, 1] * w[1] + inertia[k, 2] * w[2]
        _cross(w, y, t)
        _cross(h, a, x)
        for k in range(3):
            spin = inertia[k, 0] * dw[0] + inertia[k, 1] * dw[1] + inertia[k, 2] * dw[2]
            pose.n[i, k] = spin + t[k] + x[k]


@njit(cache=True)
def apply_load(pose, body, point, load):  # type: ignore[no-untyped-def]
    """Subtract an external load from one body; needs ``pose.R``.

    Args:
        pose: the evaluation.
        body: index of the body.
        point: where the load acts, body axes [m], shape (3,).
        load: force and moment in world axes [N, N·m], shape (6,).
    """
    f = np.empty(3)
    x = np.empty(3)
    R = pose.R[body]
    for k in range(3):
        f[k] = R[0, k] * load[0] + R[1, k] * load[1] + R[2, k] * load[2]
    _cross(point, f, x)
    for k in range(3):
        pose.f[body, k] -= f[k]
        moment = R[0, k] * load[3] + R[1, k] * load[4] + R[2, k] * load[5]
        pose.n[body, k] -= x[k] + moment


@njit(cache=True)
def joint_efforts(tree, pose, tau):  # type: ignore[no-untyped-def]
    """Fold the body forces towards the ground; fills ``tau``, shape (nv,), armature left out."""
    t = np.empty(3)
    for i in range(len(tree.mass) - 1, -1, -1):
        s, E, j = tree.axis[i], pose.E[i], tree.parent[i]
        load = pose.n[i] if tree.rotary[i] == 1 else pose.f[i]
        tau[i] = s[0] * load[0] + s[1] * load[1] + s[2] * load[2]
        if j >= 0:
            f, n = pose.f[i], pose.n[i]
            for k in range(3):
                t[k] = E[k, 0] * f[0] + E[k, 1] * f[1] + E[k, 2] * f[2]
                pose.f[j, k] += t[k]
                pose.n[j, k] += E[k, 0] * n[0] + E[k, 1] * n[1] + E[k, 2] * n[2]
            r = pose.r[i]
            pose.n[j, 0] += r[1] * t[2] - r[2] * t[1]
            pose.n[j, 1] += r[2] * t[0] - r[0] * t[2]
            pose.n[j, 2] += r[0] * t[1] - r[1] * t[0]
