r"""The joint-torque regressor of a tree, compiled with numba.

Newton-Euler for body i about its joint frame, with the classical acceleration ``c`` of the frame's
origin less gravity, all in the body's axes:

    f = m c + B h,   n = h × c + I dw + w × I w,   B = skew(dw) + w w^T - |w|² 1,   h = (mx, my, mz)

The effort at joint j is alpha·n + beta·f, where [beta; alpha] is column j of the body's Jacobian in
the body's axes. So an entry of the regressor is one short sum of products, and only the entries
that are not zero for every motion are computed. Khalil, Dombre 2002, ISBN 978-1-903996-66-9;
Featherstone 2008, doi:10.1007/978-1-4899-7560-7.

Samples are worked on in blocks: every quantity is a row of ``BLOCK`` consecutive samples, so that
the innermost loops are plain array loops that the compiler turns into vector instructions. Each
function reads and writes few arrays, because the compiler must prove that they do not overlap.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pinotwin.arrays import Floats, Ints

BLOCK = 128
N = BLOCK  # short, for the index arithmetic below

_jit = njit(cache=True, fastmath={"contract"}, error_model="numpy")


@_jit
def _load(q: Floats, v: Floats, a: Floats, first: int, joint: int, turns: bool, x: Floats) -> None:
    """Fill ``x`` = rows q, v, a, cos q, sin q of one joint; zeros past the end of the log."""
    count = min(N, len(q) - first)
    for s in range(count):
        x[s] = q[first + s, joint]
        x[N + s] = v[first + s, joint]
        x[2 * N + s] = a[first + s, joint]
    for s in range(count, N):
        x[s] = x[N + s] = x[2 * N + s] = 0.0
    if turns:
        for s in range(N):
            x[3 * N + s] = math.cos(x[s])
            x[4 * N + s] = math.sin(x[s])


@_jit
def _place(
    still: Floats, cosine: Floats, sine: Floats, origin: Floats, slide: Floats, x: Floats, g: Floats
) -> None:
    """Fill ``g`` = rows R (9) and p (3), the placement of a joint in its parent."""
    for k in range(9):
        r, c, d = still[k], cosine[k], sine[k]
        for s in range(N):
            g[k * N + s] = r + c * x[3 * N + s] + d * x[4 * N + s]
    for k in range(3):
        o, d = origin[k], slide[k]
        for s in range(N):
            g[(9 + k) * N + s] = o + d * x[s]


@_jit
def _turn(g: Floats, y: Floats, at: int) -> None:
    """Replace the three rows of ``y`` from ``at`` by R^T times them."""
    for s in range(N):
        x0, x1, x2 = y[at * N + s], y[(at + 1) * N + s], y[(at + 2) * N + s]
        y[at * N + s] = g[s] * x0 + g[3 * N + s] * x1 + g[6 * N + s] * x2
        y[(at + 1) * N + s] = g[N + s] * x0 + g[4 * N + s] * x1 + g[7 * N + s] * x2
        y[(at + 2) * N + s] = g[2 * N + s] * x0 + g[5 * N + s] * x1 + g[8 * N + s] * x2


@_jit
def _advance(g: Floats, up: Floats, x: Floats, axis: Floats, turns: float, y: Floats) -> None:
    """Fill ``y`` = rows w (3), dw (3), c (3), B (9) of a body from those of its parent ``up``."""
    for s in range(N):
        p0, p1, p2 = g[9 * N + s], g[10 * N + s], g[11 * N + s]
        for k in range(6):
            y[k * N + s] = up[k * N + s]
        y[6 * N + s] = up[6 * N + s] + up[9 * N + s] * p0 + up[10 * N + s] * p1 + up[11 * N + s] * p2
        y[7 * N + s] = up[7 * N + s] + up[12 * N + s] * p0 + up[13 * N + s] * p1 + up[14 * N + s] * p2
        y[8 * N + s] = up[8 * N + s] + up[15 * N + s] * p0 + up[16 * N + s] * p1 + up[17 * N + s] * p2
    _turn(g, y, 0)
    _turn(g, y, 3)
    _turn(g, y, 6)
    _drive(x, axis, turns, y)
    _quadratic(y)


@_jit
def _drive(x: Floats, axis: Floats, turns: float, y: Floats) -> None:
    """Add the joint's own motion to ``y``: rates, and the Coriolis terms of the moving axis."""
    e0, e1, e2 = axis[0], axis[1], axis[2]
    slides = 1.0 - turns
    for s in range(N):
        v, a = x[N + s], x[2 * N + s]
        w0, w1, w2 = y[s], y[N + s], y[2 * N + s]
        # w × axis, with the parent's w: the joint's own part is along the axis
        r0, r1, r2 = w1 * e2 - w2 * e1, w2 * e0 - w0 * e2, w0 * e1 - w1 * e0
        vr, ar, vp, ap = turns * v, turns * a, 2.0 * slides * v, slides * a
        y[s] = w0 + e0 * vr
        y[N + s] = w1 + e1 * vr
        y[2 * N + s] = w2 + e2 * vr
        y[3 * N + s] += e0 * ar + r0 * vr
        y[4 * N + s] += e1 * ar + r1 * vr
        y[5 * N + s] += e2 * ar + r2 * vr
        y[6 * N + s] += e0 * ap + r0 * vp
        y[7 * N + s] += e1 * ap + r1 * vp
        y[8 * N + s] += e2 * ap + r2 * vp


@_jit
def _quadratic(y: Floats) -> None:
    """Fill the rows B of ``y`` from its rows w and dw."""
    for s in range(N):
        w0, w1, w2 = y[s], y[N + s], y[2 * N + s]
        d0, d1, d2 = y[3 * N + s], y[4 * N + s], y[5 * N + s]
        y[9 * N + s] = -w1 * w1 - w2 * w2
        y[10 * N + s] = w0 * w1 - d2
        y[11 * N + s] = w0 * w2 + d1
        y[12 * N + s] = w0 * w1 + d2
        y[13 * N + s] = -w0 * w0 - w2 * w2
        y[14 * N + s] = w1 * w2 - d0
        y[15 * N + s] = w0 * w2 - d1
        y[16 * N + s] = w1 * w2 + d0
        y[17 * N + s] = -w0 * w0 - w1 * w1


@_jit
def _carry(g: Floats, up: Floats, j: Floats) -> None:
    """Fill ``j`` = rows alpha (3), beta (3): a Jacobian column, moved from the parent's frame."""
    for s in range(N):
        a0, a1, a2 = up[s], up[N + s], up[2 * N + s]
        p0, p1, p2 = g[9 * N + s], g[10 * N + s], g[11 * N + s]
        j[s] = a0
        j[N + s] = a1
        j[2 * N + s] = a2
        j[3 * N + s] = up[3 * N + s] + a1 * p2 - a2 * p1
        j[4 * N + s] = up[4 * N + s] + a2 * p0 - a0 * p2
        j[5 * N + s] = up[5 * N + s] + a0 * p1 - a1 * p0
    _turn(g, j, 0)
    _turn(g, j, 3)


@_jit
def _swirl(y: Floats, j: Floats) -> None:
    """Fill the rows gamma = alpha × w (3) of ``j`` from its rows alpha and the rows w of ``y``."""
    for s in range(N):
        a0, a1, a2 = j[s], j[N + s], j[2 * N + s]
        w0, w1, w2 = y[s], y[N + s], y[2 * N + s]
        j[6 * N + s] = a1 * w2 - a2 * w1
        j[7 * N + s] = a2 * w0 - a0 * w2
        j[8 * N + s] = a0 * w1 - a1 * w0


@_jit
def _mass(j: Floats, y: Floats, e: Floats) -> None:
    """Mass: beta·c."""
    for s in range(N):
        e[s] = j[3 * N + s] * y[6 * N + s] + j[4 * N + s] * y[7 * N + s] + j[5 * N + s] * y[8 * N + s]


@_jit
def _moment(k: int, j: Floats, y: Floats, e: Floats) -> None:
    """First moment k: (B^T beta)_k + (c × alpha)_k."""
    l, m = (k + 1) % 3, (k + 2) % 3
    b = y[(9 + k) * N :]
    for s in range(N):
        e[s] = b[s] * j[3 * N + s] + b[3 * N + s] * j[4 * N + s] + b[6 * N + s] * j[5 * N + s]
    al, am = j[l * N : (l + 1) * N], j[m * N : (m + 1) * N]
    cl, cm = y[(6 + l) * N : (7 + l) * N], y[(6 + m) * N : (7 + m) * N]
    for s in range(N):
        e[s] += cl[s] * am[s] - cm[s] * al[s]


@_jit
def _tensor(k: int, l: int, j: Floats, y: Floats, e: Floats) -> None:
    """Tensor element kl and its mirror image: alpha^T I dw + gamma^T I w."""
    ak, dl = j[k * N : (k + 1) * N], y[(3 + l) * N : (4 + l) * N]
    ck, wl = j[(6 + k) * N : (7 + k) * N], y[l * N : (l + 1) * N]
    for s in range(N):
        e[s] = ak[s] * dl[s] + ck[s] * wl[s]
    if k != l:
        al, dk = j[l * N : (l + 1) * N], y[(3 + k) * N : (4 + k) * N]
        cl, wk = j[(6 + l) * N : (7 + l) * N], y[k * N : (k + 1) * N]
        for s in range(N):
            e[s] += al[s] * dk[s] + cl[s] * wk[s]


@_jit
def _entry(part: int, j: Floats, y: Floats, e: Floats) -> None:
    """Fill ``e`` = the entry of parameter ``part`` (0..9: m, h, I) of a body at one joint."""
    if part == 0:
        _mass(j, y, e)
    elif part <= 3:
        _moment(part - 1, j, y, e)
    else:  # Ixx Ixy Iyy Ixz Iyz Izz
        _tensor((0, 0, 1, 0, 1, 2)[part - 4], (0, 1, 1, 2, 2, 2)[part - 4], j, y, e)


@_jit
def _own_axes(pairs: Ints, revolute: Floats, axis: Floats, jac: Floats) -> None:
    """Fill the Jacobian columns of joints in the frame of the body they move: constant."""
    for r in range(len(pairs)):
        if pairs[r, 2] < 0:
            i = pairs[r, 0] - 1
            at = 0 if revolute[i] > 0.5 else 3
            for k in range(3):
                jac[r, (at + k) * N : (at + k + 1) * N] = axis[i, k]


@_jit
def fill(
    geometry: tuple[Floats, ...], plan: tuple[Ints, ...], q: Floats, v: Floats, a: Floats, W: Floats
) -> None:
    """Write the planned entries of the regressor into ``W``; see the module.

    Args:
        geometry: revolute, axis, still, cosine, sine, origin, slide, gravity of a ``Tree``.
        plan: bodies (k, 2): number and parent's; pairs (k, 3): body, joint, pair it is carried from
            or -1; entries (k, 4): joint, column, pair or -1 for a rotor inertia, part.
        q: positions, shape (n, nv).
        v: velocities, shape (n, nv).
        a: accelerations, shape (n, nv).
        W: the result, shape (n, nv, columns); entries that are not planned are left alone.
    """
    revolute, axis, still, cosine, sine, origin, slide, gravity = geometry
    bodies, pairs, entries = plan
    nb = len(revolute)
    x, g = np.zeros((nb, 5 * N)), np.zeros((nb, 12 * N))
    y, jac = np.zeros((nb + 1, 18 * N)), np.zeros((len(pairs), 9 * N))
    E = np.zeros((len(entries), N))
    for k in range(3):
        y[0, (6 + k) * N : (7 + k) * N] = -gravity[k]
    _own_axes(pairs, revolute, axis, jac)
    for first in range(0, len(q), N):
        for i in range(nb):
            _load(q, v, a, first, i, revolute[i] > 0.5, x[i])
        for r in range(len(bodies)):
            i = bodies[r, 0] - 1
            _place(still[i], cosine[i], sine[i], origin[i], slide[i], x[i], g[i])
            _advance(g[i], y[bodies[r, 1]], x[i], axis[i], revolute[i], y[i + 1])
        for r in range(len(pairs)):
            if pairs[r, 2] >= 0:
                _carry(g[pairs[r, 0] - 1], jac[pairs[r, 2]], jac[r])
            _swirl(y[pairs[r, 0]], jac[r])
        for r in range(len(entries)):
            if entries[r, 2] >= 0:
                _entry(entries[r, 3], jac[entries[r, 2]], y[pairs[entries[r, 2], 0]], E[r])
            else:
                E[r] = x[entries[r, 0], 2 * N : 3 * N]
        _scatter(entries, E, first, W)


@_jit
def _scatter(entries: Ints, E: Floats, first: int, W: Floats) -> None:
    """Write a block of entries to its samples, eight samples at a time: a cache line of ``E``."""
    count = min(N, len(W) - first)
    for t in range(0, count, 8):
        for r in range(len(entries)):
            row, column = entries[r, 0], entries[r, 1]
            for s in range(t, min(t + 8, count)):
                W[first + s, row, column] = E[r, s]
