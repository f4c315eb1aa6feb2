"""The stepping loop: linear blocks of all axes with the full nonlinear disturbance fed back.

One internal step, from t to t + h:

    1  x_p   = A x + B0 w(t) + B1 w(t + h)         exact; w holds vr, and d held at d(t)
    2  e, e', e'' without d, u   from x_p
    3  q = qr - e,   v = vr - e',   a = a0 - K d   (Eq. 4.12; K is the gain of d in e'')
    4  r     = h(q, v) + friction + position + other - external
    5  d(t+h) = (M(q) - M_D) a + r                 a linear system: (I + (M - M_D) K) d = (M - M_D) a0 + r
    6  x     = x_p + B1 (d(t+h) - d(t))            d runs straight between the steps

Step 5 solves the algebraic loop between disturbance and acceleration exactly: nothing is
differentiated numerically and nothing is one step late. With one evaluation of the nonlinear terms a
step, at the predicted state, the scheme is of second order.

Dry friction keeps its direction in memory, as identified (:mod:`pinotwin.effects.direction`): it turns
with slope 1/width while the axis speeds up and holds while it slows down or stands.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.stepping import gather, replay
from pinotwin.simulation.blocks import (
    D_RATE,
    D_RATE2,
    DA_RATE2,
    E_RATE,
    E_RATE2,
    GAIN,
    LOAD_E,
    LOAD_U,
    U_A,
    U_D,
    U_V,
    E,
    U,
)

TINY = 1e-200  # states below it are set to zero: denormal numbers are slow
SETTLE = 30  # passes to find the disturbance at rest


class Parts(NamedTuple):
    """What the disturbance is made of.

    Attributes:
        revolute: of the tape, and so on, see :class:`pinotwin.dynamics.tape.Tape`.
        ops: operations.
        sign: signs.
        mass: entries of M.
        bias: entries of h.
        coupled: joints whose row of M - M_D is not zero, shape (m,).
        inertia: M_D, shape (nv,).
        viscous: C, shape (nv,).
        stiffness: K of the springs, shape (nv,).
    """

    revolute: Ints
    ops: Ints
    sign: Floats
    mass: Ints
    bias: Ints
    coupled: Ints
    inertia: Floats
    viscous: Floats
    stiffness: Floats


class Lookup(NamedTuple):
    """Tables of the effects; see :class:`pinotwin.simulation.tables.Tables`."""

    position: Floats
    place: Ints
    grid: Floats
    slowness: Floats
    speeds: Ints
    velocity: Floats
    directions: Ints
    slope: Floats
    dry: Floats
    slips: Ints
    give: Floats
    slip: Floats


class Command(NamedTuple):
    """What is asked of the machine, one row a sample.

    Attributes:
        qr: command, shape (n, nv).
        vr: its velocity at the samples; between them the command is cubic, shape (n, nv).
        load: effort that helps the motors (external loads less effects without a table), shape (n,
            nv), or (1, nv) if constant.
        step: sampling interval [s].
        substeps: internal steps a sample.
        limit: largest tracking error before the run is stopped, shape (nv,).
    """

    qr: Floats
    vr: Floats
    load: Floats
    step: float
    substeps: int
    limit: Floats


class State(NamedTuple):
    """Where the machine is; changed by :func:`run`.

    Attributes:
        x: states of the blocks, shape (k, 2).
        d: disturbance, shape (nv,).
        q: position, shape (nv,); likewise ``v``, ``a``, ``e``, ``u``.
        v: velocity.
        a: acceleration.
        e: tracking error.
        u: effort.
        c: command now and its two derivatives, shape (3, nv).
        p: its coefficients in the present interval, shape (4, nv).
        pace: place of each joint's speed in the tables over speed, shape (nv,).
        turn: direction of each dry-friction element, shape (k,).
        before: velocity of each element's joint at the last step, shape (k,).
        bend: bend of the slip elements, shape (m, 6).
        where: position of each slip element's joint at the last step, shape (m,).
        t: values of the tape.
        M: mass matrix, shape (nv, nv).
        h: bias effort, shape (nv,).
        r: right side of step 5, shape (nv,).
        S: its matrix, shape (nv, nv + 1).
    """

    x: Floats
    d: Floats
    q: Floats
    v: Floats
    a: Floats
    e: Floats
    u: Floats
    c: Floats
    p: Floats
    pace: Floats
    turn: Floats
    before: Floats
    bend: Floats
    where: Floats
    t: Floats
    M: Floats
    h: Floats
    r: Floats
    S: Floats


class Record(NamedTuple):
    """What is written down, one row a sample; arrays of no rows are not written.

    Attributes:
        q: shape (n, nv); likewise the others.
        e: tracking error.
        u: effort.
        v: velocity.
        a: acceleration.
        d: generalised disturbance.
    """

    q: Floats
    e: Floats
    u: Floats
    v: Floats
    a: Floats
    d: Floats


@njit(cache=True)
def _flush(x):  # type: ignore[no-untyped-def]
    return 0.0 if abs(x) < TINY else x


@njit(cache=True)
def _cubic(command, row, p):  # type: ignore[no-untyped-def]
    """Fill p with the coefficients of the command from a row to the next, in shares of the interval."""
    h = command.step
    for j in range(p.shape[1]):
        q0, v0 = command.qr[row, j], h * command.vr[row, j]
        dq, v1 = command.qr[row + 1, j] - q0, h * command.vr[row + 1, j]
        p[0, j], p[1, j] = q0, v0
        p[2, j], p[3, j] = 3.0 * dq - 2.0 * v0 - v1, v0 + v1 - 2.0 * dq


@njit(cache=True)
def _command(p, rate, s, c):  # type: ignore[no-untyped-def]
    """Fill c with the command and its two derivatives at the share s of an interval."""
    for j in range(c.shape[1]):
        c[0, j] = p[0, j] + s * (p[1, j] + s * (p[2, j] + s * p[3, j]))
        c[1, j] = rate * (p[1, j] + s * (2.0 * p[2, j] + s * 3.0 * p[3, j]))
        c[2, j] = rate * rate * (2.0 * p[2, j] + 6.0 * s * p[3, j])


@njit(cache=True)
def _predict(blocks, c, vr0, s):  # type: ignore[no-untyped-def]
    """Advance the blocks with d held, and fill e, e', e'' without d, u; see steps 1 to 3."""
    x, C, A, B0, B1 = s.x, blocks.C, blocks.A, blocks.B0, blocks.B1
    for j in range(len(s.d)):
        e, e1, e2, u = 0.0, 0.0, 0.0, 0.0
        for b in range(blocks.first[j], blocks.first[j + 1]):
            if blocks.command[b] == 1:
                w0, w1 = vr0[j], c[1, j]
            else:
                w0 = s.d[j]
                w1 = w0
            p, q = x[b, 0], x[b, 1]
            z = _flush(A[b, 0, 0] * p + A[b, 0, 1] * q + B0[b, 0] * w0 + B1[b, 0] * w1)
            y = _flush(A[b, 1, 0] * p + A[b, 1, 1] * q + B0[b, 1] * w0 + B1[b, 1] * w1)
            x[b, 0], x[b, 1] = z, y
            e += C[b, E, 0] * z + C[b, E, 1] * y
            e1 += C[b, E_RATE, 0] * z + C[b, E_RATE, 1] * y
            e2 += C[b, E_RATE2, 0] * z + C[b, E_RATE2, 1] * y
            u += C[b, U, 0] * z + C[b, U, 1] * y
        _outputs(blocks, j, c, s, e, e1, e2, u)


@njit(cache=True)
def _outputs(blocks, j, c, s, e, e1, e2, u):  # type: ignore[no-untyped-def]
    """Fill e, q, v, the acceleration without d, and u of one joint."""
    g = blocks.direct
    s.e[j] = e
    s.q[j] = c[0, j] - e
    s.v[j] = c[1, j] - e1 - g[j, D_RATE] * c[1, j]
    s.a[j] = c[2, j] - e2 - g[j, D_RATE2] * c[1, j] - g[j, DA_RATE2] * c[2, j]
    s.u[j] = u + g[j, U_V] * c[1, j] + g[j, U_A] * c[2, j]


@njit(cache=True)
def _at(table, place):  # type: ignore[no-untyped-def]
    """Return a table at a place between 0 and its last index."""
    k = int(place)
    if k > len(table) - 2:
        k = len(table) - 2
    return table[k] + (place - k) * (table[k + 1] - table[k])


@njit(cache=True)
def _along(tables, j, q):  # type: ignore[no-untyped-def]
    """Return the effort of position of joint j; its last value beyond the travel."""
    start, n = tables.place[j, 0], tables.place[j, 1]
    if n < 2:
        return 0.0
    place = (q - tables.grid[j, 0]) * tables.grid[j, 1]
    if place < 0.0:
        place = 0.0
    if place > n - 1.0:
        place = n - 1.0
    return _at(tables.position[start : start + n], place)


@njit(cache=True)
def _clip(x):  # type: ignore[no-untyped-def]
    """Return x within [-1, 1]."""
    if x > 1.0:
        return 1.0
    return -1.0 if x < -1.0 else x


@njit(cache=True)
def _pace(tables, s):  # type: ignore[no-untyped-def]
    """Fill the place of every joint's speed in the tables over speed."""
    n = float(tables.velocity.shape[2] - 1)
    for j in range(len(s.v)):
        share = abs(s.v[j]) * tables.slowness[j]
        s.pace[j] = n * np.sqrt(share) if share < 1.0 else n


@njit(cache=True)
def _friction(tables, s):  # type: ignore[no-untyped-def]
    """Add the efforts of velocity, direction and displacement to r; move their memory."""
    _pace(tables, s)
    for k in range(len(tables.speeds)):
        j = tables.speeds[k]
        s.r[j] += _at(tables.velocity[k, 0 if s.v[j] >= 0.0 else 1], s.pace[j])
    for k in range(len(tables.directions)):
        j = tables.directions[k]
        v = s.v[j]
        dv = v - s.before[k]
        if v * dv > 0.0:
            s.turn[k] = _clip(s.turn[k] + dv * tables.slope[k])
        s.before[k] = v
        turn = s.turn[k]
        s.r[j] += abs(turn) * _at(tables.dry[k, 0 if turn >= 0.0 else 1], s.pace[j])
    for k in range(len(tables.slips)):
        j = tables.slips[k]
        dq = s.q[j] - s.where[k]
        s.where[k] = s.q[j]
        total, m = 0.0, tables.give.shape[1]
        for i in range(m):
            bend = _clip(s.bend[k, i] + dq * tables.give[k, i])
            s.bend[k, i] = bend
            total += bend
        s.r[j] += total / m * _at(tables.slip[k], s.pace[j])


@njit(cache=True)
def _solve(plant, blocks, s):  # type: ignore[no-untyped-def]
    """Fill d and a: the linear system of step 5 on the coupled joints (Gauss, row pivots)."""
    rows, S, g = plant.coupled, s.S, blocks.direct
    m = len(rows)
    for j in range(len(s.r)):
        s.d[j] = s.r[j]
    for i in range(m):
        total = s.r[rows[i]]
        for k in range(m):
            extra = s.M[rows[i], rows[k]]
            if i == k:
                extra -= plant.inertia[rows[i]]
            total += extra * s.a[rows[k]]
            S[i, k] = extra * g[rows[k], GAIN]
        S[i, i] += 1.0
        S[i, m] = total
    for i in range(m):
        best = i
        for k in range(i + 1, m):
            if abs(S[k, i]) > abs(S[best, i]):
                best = k
        if best != i:
            for k in range(i, m + 1):
                S[i, k], S[best, k] = S[best, k], S[i, k]
        for k in range(i + 1, m):
            f = S[k, i] / S[i, i]
            for z in range(i + 1, m + 1):
                S[k, z] -= f * S[i, z]
    for i in range(m - 1, -1, -1):
        total = S[i, m]
        for k in range(i + 1, m):
            total -= S[i, k] * s.d[rows[k]]
        s.d[rows[i]] = total / S[i, i]
    for j in range(len(s.r)):
        s.a[j] -= g[j, GAIN] * s.d[j]


@njit(cache=True)
def _disturb(plant, tables, blocks, command, row, share, s):  # type: ignore[no-untyped-def]
    """Fill d and a at the present q, v; see steps 4 and 5."""
    replay(plant.revolute, plant.ops, plant.sign, s.q, s.v, s.t)
    gather(plant.mass, plant.bias, s.t, s.M, s.h)
    constant = len(command.load) == 1
    for j in range(len(s.r)):
        if constant:
            load = command.load[0, j]
        else:
            load = command.load[row, j]
            if share > 0.0:
                load += share * (command.load[row + 1, j] - load)
        s.r[j] = s.h[j] - load + _along(tables, j, s.q[j])
    _friction(tables, s)
    _solve(plant, blocks, s)


@njit(cache=True)
def _finish(plant, blocks, old, s):  # type: ignore[no-untyped-def]
    """Let d run straight over the step: correct states, e and u; see step 6."""
    g = blocks.direct
    for j in range(len(s.d)):
        change = s.d[j] - old[j]
        for b in range(blocks.first[j], blocks.first[j + 1]):
            if blocks.command[b] == 0:
                s.x[b, 0] += blocks.B1[b, 0] * change
                s.x[b, 1] += blocks.B1[b, 1] * change
        s.e[j] += g[j, LOAD_E] * change
        s.q[j] -= g[j, LOAD_E] * change
        s.u[j] += g[j, LOAD_U] * change + g[j, U_D] * s.d[j]
        if blocks.ideal[j] == 1:
            s.u[j] = (
                plant.inertia[j] * s.a[j] + plant.viscous[j] * s.v[j]
                + plant.stiffness[j] * s.q[j] + s.d[j]
            )  # fmt: skip


@njit(cache=True)
def _write(record, row, s):  # type: ignore[no-untyped-def]
    for j in range(len(s.q)):
        record.q[row, j], record.e[row, j], record.u[row, j] = s.q[j], s.e[j], s.u[j]
        if len(record.d):
            record.v[row, j], record.a[row, j], record.d[row, j] = s.v[j], s.a[j], s.d[j]


@njit(cache=True)
def settle(plant, tables, blocks, command, s):  # type: ignore[no-untyped-def]
    """Put the loops in equilibrium under the first command: cold start, friction not yet loaded."""
    _cubic(command, 0, s.p)
    _command(s.p, 1.0 / command.step, 0.0, s.c)
    nv = len(s.d)
    for _ in range(SETTLE):
        for j in range(nv):
            e, e1, e2, u = 0.0, 0.0, 0.0, 0.0
            for b in range(blocks.first[j], blocks.first[j + 1]):
                w = s.c[1, j] if blocks.command[b] == 1 else s.d[j]
                s.x[b, 0], s.x[b, 1] = w, 0.0
                C = blocks.C[b]
                e, e1 = e + C[E, 0] * w, e1 + C[E_RATE, 0] * w
                e2, u = e2 + C[E_RATE2, 0] * w, u + C[U, 0] * w
            _outputs(blocks, j, s.c, s, e, e1, e2, u)
        for k in range(len(tables.directions)):
            j = tables.directions[k]
            s.before[k] = s.v[j]
            s.turn[k] = _clip(s.v[j] * tables.slope[k])
        for k in range(len(tables.slips)):
            s.where[k] = s.q[tables.slips[k]]
        _disturb(plant, tables, blocks, command, 0, 0.0, s)
    _finish(plant, blocks, s.d, s)


@njit(cache=True)
def run(plant, tables, blocks, command, s, record):  # type: ignore[no-untyped-def]
    """Step through the whole command from the state ``s``.

    Returns:
        Row and joint at which the tracking error exceeded its limit, or (-1, -1).
    """
    n, nv = command.qr.shape
    old, vr0 = np.zeros(nv), np.zeros(nv)
    rate = 1.0 / command.step
    _write(record, 0, s)
    for row in range(n - 1):
        _cubic(command, row, s.p)
        for k in range(command.substeps):
            share = (k + 1.0) / command.substeps
            for j in range(nv):
                old[j], vr0[j] = s.d[j], s.c[1, j]
            _command(s.p, rate, share, s.c)
            _predict(blocks, s.c, vr0, s)
            _disturb(plant, tables, blocks, command, row, share, s)
            _finish(plant, blocks, old, s)
        for j in range(nv):
            if not abs(s.e[j]) <= command.limit[j]:
                return row + 1, j
        _write(record, row + 1, s)
    return -1, -1
