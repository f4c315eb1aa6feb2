"""Rigid-body dynamics of the virtual machines: their own numba code, for any tree of joints.

    M(q) a + h(q, v) = tau + J^T f_ext

``h`` by the recursive Newton-Euler algorithm and ``M`` by composite rigid bodies (Featherstone
2008, doi:10.1007/978-1-4899-7560-7, chapters 5 and 6), in body coordinates, every inertia about
the joint's origin. Written apart from the identification side, so that an error there cannot hide
here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual.jit import kernel


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


@kernel
def place(tree, q, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.E`` and ``pose.r`` for the positions ``q``, shape (nv,)."""
    P, E, r, axis, offset, rotary = (
        tree.placement,
        pose.E,
        pose.r,
        tree.axis,
        tree.offset,
        tree.rotary,
    )
    for i in range(len(q)):
        x, y, z = axis[i, 0], axis[i, 1], axis[i, 2]
        if rotary[i] == 1:
            c, s = np.cos(q[i]), np.sin(q[i])
            d = 1.0 - c
            a00, a01, a02 = c + d * x * x, d * x * y - s * z, d * x * z + s * y
            a10, a11, a12 = d * x * y + s * z, c + d * y * y, d * y * z - s * x
            a20, a21, a22 = d * x * z - s * y, d * y * z + s * x, c + d * z * z
            for k in range(3):
                p0, p1, p2 = P[i, k, 0], P[i, k, 1], P[i, k, 2]
                E[i, k, 0] = p0 * a00 + p1 * a10 + p2 * a20
                E[i, k, 1] = p0 * a01 + p1 * a11 + p2 * a21
                E[i, k, 2] = p0 * a02 + p1 * a12 + p2 * a22
                r[i, k] = offset[i, k]
        else:
            for k in range(3):
                p0, p1, p2 = P[i, k, 0], P[i, k, 1], P[i, k, 2]
                E[i, k, 0], E[i, k, 1], E[i, k, 2] = p0, p1, p2
                r[i, k] = offset[i, k] + (p0 * x + p1 * y + p2 * z) * q[i]


@kernel
def place_in_world(tree, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.R`` and ``pose.p`` from ``pose.E`` and ``pose.r``."""
    E, r, R, p, parent = pose.E, pose.r, pose.R, pose.p, tree.parent
    for i in range(len(parent)):
        j = parent[i]
        for k in range(3):
            if j < 0:
                p[i, k] = r[i, k]
                for m in range(3):
                    R[i, k, m] = E[i, k, m]
                continue
            R0, R1, R2 = R[j, k, 0], R[j, k, 1], R[j, k, 2]
            p[i, k] = p[j, k] + R0 * r[i, 0] + R1 * r[i, 1] + R2 * r[i, 2]
            for m in range(3):
                R[i, k, m] = R0 * E[i, 0, m] + R1 * E[i, 1, m] + R2 * E[i, 2, m]


@kernel
def move(tree, v, acc, pose):  # type: ignore[no-untyped-def]
    """Fill velocities and accelerations of the bodies; gravity enters as -g at the base."""
    E, r, w, dw, a = pose.E, pose.r, pose.w, pose.dw, pose.a
    parent, rotary, axis, g = tree.parent, tree.rotary, tree.axis, tree.gravity
    for i in range(len(v)):
        j = parent[i]
        wx = wy = wz = ex = ey = ez = 0.0
        bx, by, bz = -g[0], -g[1], -g[2]
        if j >= 0:
            wx, wy, wz = w[j, 0], w[j, 1], w[j, 2]
            ex, ey, ez = dw[j, 0], dw[j, 1], dw[j, 2]
            rx, ry, rz = r[i, 0], r[i, 1], r[i, 2]
            tx, ty, tz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
            bx = a[j, 0] + ey * rz - ez * ry + wy * tz - wz * ty
            by = a[j, 1] + ez * rx - ex * rz + wz * tx - wx * tz
            bz = a[j, 2] + ex * ry - ey * rx + wx * ty - wy * tx
        for k in range(3):
            e0, e1, e2 = E[i, 0, k], E[i, 1, k], E[i, 2, k]
            w[i, k] = e0 * wx + e1 * wy + e2 * wz
            dw[i, k] = e0 * ex + e1 * ey + e2 * ez
            a[i, k] = e0 * bx + e1 * by + e2 * bz
        sx, sy, sz = axis[i, 0], axis[i, 1], axis[i, 2]
        wx, wy, wz = w[i, 0], w[i, 1], w[i, 2]
        tx, ty, tz = wy * sz - wz * sy, wz * sx - wx * sz, wx * sy - wy * sx
        if rotary[i] == 1:
            dw[i, 0] += tx * v[i] + sx * acc[i]
            dw[i, 1] += ty * v[i] + sy * acc[i]
            dw[i, 2] += tz * v[i] + sz * acc[i]
            w[i, 0], w[i, 1], w[i, 2] = wx + sx * v[i], wy + sy * v[i], wz + sz * v[i]
        else:
            a[i, 0] += 2.0 * tx * v[i] + sx * acc[i]
            a[i, 1] += 2.0 * ty * v[i] + sy * acc[i]
            a[i, 2] += 2.0 * tz * v[i] + sz * acc[i]


@kernel
def body_forces(tree, pose):  # type: ignore[no-untyped-def]
    """Fill ``pose.f`` and ``pose.n`` with what the motion of each body asks for."""
    w, dw, a, f, n = pose.w, pose.dw, pose.a, pose.f, pose.n
    mass, moment, inertia = tree.mass, tree.moment, tree.inertia
    for i in range(len(mass)):
        hx, hy, hz = moment[i, 0], moment[i, 1], moment[i, 2]
        wx, wy, wz = w[i, 0], w[i, 1], w[i, 2]
        ex, ey, ez = dw[i, 0], dw[i, 1], dw[i, 2]
        ax, ay, az = a[i, 0], a[i, 1], a[i, 2]
        tx, ty, tz = wy * hz - wz * hy, wz * hx - wx * hz, wx * hy - wy * hx
        f[i, 0] = mass[i] * ax + ey * hz - ez * hy + wy * tz - wz * ty
        f[i, 1] = mass[i] * ay + ez * hx - ex * hz + wz * tx - wx * tz
        f[i, 2] = mass[i] * az + ex * hy - ey * hx + wx * ty - wy * tx
        lx = inertia[i, 0, 0] * wx + inertia[i, 0, 1] * wy + inertia[i, 0, 2] * wz
        ly = inertia[i, 1, 0] * wx + inertia[i, 1, 1] * wy + inertia[i, 1, 2] * wz
        lz = inertia[i, 2, 0] * wx + inertia[i, 2, 1] * wy + inertia[i, 2, 2] * wz
        for k in range(3):
            n[i, k] = inertia[i, k, 0] * ex + inertia[i, k, 1] * ey + inertia[i, k, 2] * ez
        n[i, 0] += wy * lz - wz * ly + hy * az - hz * ay
        n[i, 1] += wz * lx - wx * lz + hz * ax - hx * az
        n[i, 2] += wx * ly - wy * lx + hx * ay - hy * ax


@kernel
def apply_load(pose, body, point, load, at):  # type: ignore[no-untyped-def]
    """Subtract an external load from one body; needs ``pose.R``.

    Args:
        pose: the evaluation.
        body: index of the body.
        point: where the loads act, body axes [m], shape (nl, 3).
        load: forces and moments in world axes [N, N·m], shape (n, nl, 6).
        at: row and number of the load.
    """
    k, m = at
    R, f, n = pose.R, pose.f, pose.n
    fx, fy, fz, nx, ny, nz = (
        load[k, m, 0],
        load[k, m, 1],
        load[k, m, 2],
        load[k, m, 3],
        load[k, m, 4],
        load[k, m, 5],
    )
    b0 = R[body, 0, 0] * fx + R[body, 1, 0] * fy + R[body, 2, 0] * fz
    b1 = R[body, 0, 1] * fx + R[body, 1, 1] * fy + R[body, 2, 1] * fz
    b2 = R[body, 0, 2] * fx + R[body, 1, 2] * fy + R[body, 2, 2] * fz
    for i in range(3):
        n[body, i] -= R[body, 0, i] * nx + R[body, 1, i] * ny + R[body, 2, i] * nz
    f[body, 0] -= b0
    f[body, 1] -= b1
    f[body, 2] -= b2
    n[body, 0] -= point[m, 1] * b2 - point[m, 2] * b1
    n[body, 1] -= point[m, 2] * b0 - point[m, 0] * b2
    n[body, 2] -= point[m, 0] * b1 - point[m, 1] * b0


@kernel
def joint_efforts(tree, pose, tau):  # type: ignore[no-untyped-def]
    """Fold the body forces towards the ground; fills ``tau``, shape (nv,), armature left out."""
    E, r, f, n = pose.E, pose.r, pose.f, pose.n
    parent, rotary, axis = tree.parent, tree.rotary, tree.axis
    for i in range(len(parent) - 1, -1, -1):
        fx, fy, fz, nx, ny, nz = f[i, 0], f[i, 1], f[i, 2], n[i, 0], n[i, 1], n[i, 2]
        if rotary[i] == 1:
            tau[i] = axis[i, 0] * nx + axis[i, 1] * ny + axis[i, 2] * nz
        else:
            tau[i] = axis[i, 0] * fx + axis[i, 1] * fy + axis[i, 2] * fz
        j = parent[i]
        if j < 0:
            continue
        gx = E[i, 0, 0] * fx + E[i, 0, 1] * fy + E[i, 0, 2] * fz
        gy = E[i, 1, 0] * fx + E[i, 1, 1] * fy + E[i, 1, 2] * fz
        gz = E[i, 2, 0] * fx + E[i, 2, 1] * fy + E[i, 2, 2] * fz
        f[j, 0] += gx
        f[j, 1] += gy
        f[j, 2] += gz
        for k in range(3):
            n[j, k] += E[i, k, 0] * nx + E[i, k, 1] * ny + E[i, k, 2] * nz
        n[j, 0] += r[i, 1] * gz - r[i, 2] * gy
        n[j, 1] += r[i, 2] * gx - r[i, 0] * gz
        n[j, 2] += r[i, 0] * gy - r[i, 1] * gx
