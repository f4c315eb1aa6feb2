"""What the compiled loops share: command between samples, tape, friction of :mod:`pinotwin.effects.presliding`."""

from __future__ import annotations

import numpy as np

from pinotwin.dynamics.stepping import gather, inlined, leaf, replay


@inlined
def hermite(q0, q1, v0, v1, interval, share):  # type: ignore[no-untyped-def]
    """Return a cubic and two derivatives at a share of an interval (length and inverse), from values and slopes."""
    step, rate = interval
    dq, c1, v1 = q1 - q0, step * v0, step * v1
    c2, c3 = 3.0 * dq - 2.0 * c1 - v1, c1 + v1 - 2.0 * dq
    q = q0 + share * (c1 + share * (c2 + share * c3))
    v = (c1 + share * (2.0 * c2 + share * 3.0 * c3)) * rate
    return q, v, (2.0 * c2 + 6.0 * share * c3) * (rate * rate)


@leaf
def command_at(command, interval, row, share, c):  # type: ignore[no-untyped-def]
    """Fill c with all commands and their two derivatives at a share of the way from a row to the next."""
    for j in range(c.shape[1]):
        c[0, j], c[1, j], c[2, j] = hermite(
            command.qr[row, j],
            command.qr[row + 1, j],
            command.vr[row, j],
            command.vr[row + 1, j],
            interval,
            share,
        )


@leaf
def load_at(command, row, share, j):  # type: ignore[no-untyped-def]
    """Return the load that helps a motor at a share of the way from a row to the next."""
    if len(command.load) == 1:
        return command.load[0, j]
    load = command.load[row, j]
    return load + share * (command.load[row + 1, j] - load) if share > 0.0 else load


@leaf
def dynamics(plant, s):  # type: ignore[no-untyped-def]
    """Fill M and h at the present q and v."""
    replay(plant.revolute, plant.ops, plant.sign, s.q, s.v, s.t)
    gather(plant.mass, plant.bias, s.t, s.M, s.h)


@leaf
def invert(A, X):  # type: ignore[no-untyped-def]
    """Fill X with the inverse of A by Gauss and Jordan with row pivots; A is used up."""
    n = len(A)
    for i in range(n):
        for k in range(n):
            X[i, k] = 1.0 if i == k else 0.0
    for i in range(n):
        _pivot(A, X, i)
        p = 1.0 / A[i, i]
        for k in range(n):
            A[i, k] *= p
            X[i, k] *= p
        for z in range(n):
            if z != i and A[z, i] != 0.0:
                f = A[z, i]
                for k in range(n):
                    A[z, k] -= f * A[i, k]
                    X[z, k] -= f * X[i, k]


@leaf
def _pivot(A, X, i):  # type: ignore[no-untyped-def]
    """Bring the row with the largest entry of column i to row i, of those below."""
    best = i
    for k in range(i + 1, len(A)):
        if abs(A[k, i]) > abs(A[best, i]):
            best = k
    if best != i:
        for k in range(len(A)):
            A[i, k], A[best, k] = A[best, k], A[i, k]
            X[i, k], X[best, k] = X[best, k], X[i, k]


@leaf
def level_at(table, k, side, place):  # type: ignore[no-untyped-def]
    """Return table [k, side] at a place between 0 and its last index: a view would cost more than the look-up."""
    i = int(place)
    if i > table.shape[2] - 2:
        i = table.shape[2] - 2
    low = table[k, side, i]
    return low + (place - i) * (table[k, side, i + 1] - low)


@leaf
def along(tables, j, q):  # type: ignore[no-untyped-def]
    """Return the effort of position of joint j; its last value beyond the travel."""
    start, n = tables.place[j, 0], tables.place[j, 1]
    if n < 2:
        return 0.0
    place = (q - tables.grid[j, 0]) * tables.grid[j, 1]
    place = min(max(place, 0.0), n - 1.0)
    i = min(int(place), n - 2)
    low = tables.position[start + i]
    return low + (place - i) * (tables.position[start + i + 1] - low)


@inlined
def pace_of(tables, j, v):  # type: ignore[no-untyped-def]
    """Return the place of a velocity in the tables of joint j."""
    top, share = float(tables.velocity.shape[2] - 1), abs(v) * tables.slowness[j]
    return top * np.sqrt(share) if share < 1.0 else top


@inlined
def clip(x):  # type: ignore[no-untyped-def]
    """Return x within [-1, 1]."""
    return 1.0 if x > 1.0 else (-1.0 if x < -1.0 else x)


@inlined
def bend(tables, k, q, v, pace, s):  # type: ignore[no-untyped-def]
    """Move one presliding element to q; fill its effort, its damping and its stiffness into ``one``."""
    m = tables.give.shape[1]
    dq, play = q - s.where[k], tables.memory[k, 1]
    dq = dq - play if dq > play else (dq + play if dq < -play else 0.0)
    s.where[k] += dq
    z, stiff = 0.0, 0.0
    for i in range(m):
        x = clip(s.bend[k, i] + dq * tables.give[k, i])
        s.bend[k, i] = x
        z += x
        if not (x >= 1.0 and v > 0.0) and not (x <= -1.0 and v < 0.0):
            stiff += tables.give[k, i]
    z, stiff = z / m, stiff / m
    y, rate = s.bend[k, m], tables.memory[k, 0]
    if dq != 0.0 and rate > 0.0:
        side = 1.0 if dq > 0.0 else -1.0
        y = side + (y - side) * np.exp(-abs(dq) * rate)
        s.bend[k, m] = y
    level = level_at(tables.slip, k, 0, pace)
    damp = tables.memory[k, 3] * rate * (1.0 - y * (1.0 if v >= 0.0 else -1.0))
    s.one[0] = z * level + tables.memory[k, 2] * (y - z) + damp * v
    s.one[1], s.one[2] = damp, stiff * level


@inlined
def further(tables, j, h, q, v, pace, s):  # type: ignore[no-untyped-def]
    """Return effort and damping over a step of joint j's friction of velocity and presliding elements; move these."""
    effort, damping = 0.0, 0.0
    for k in range(len(tables.speeds)):
        if tables.speeds[k] == j:
            slows = level_at(tables.velocity, k, 0 if v >= 0.0 else 1, pace)
            effort += slows
            if abs(v) > 1e-12:
                damping += max(slows / v, 0.0)
    for k in range(len(tables.slips)):
        if tables.slips[k] == j:
            bend(tables, k, q, v, pace, s)
            effort += s.one[0] + h * s.one[2] * v
            damping += s.one[1] + h * s.one[2]
    return effort, damping


@leaf
def friction(tables, s):  # type: ignore[no-untyped-def]
    """Add the efforts of velocity, direction (:mod:`pinotwin.effects.friction`) and displacement to r; move memory."""
    for j in range(len(s.v)):
        s.pace[j] = pace_of(tables, j, s.v[j])
        s.r[j] += further(tables, j, 0.0, s.q[j], s.v[j], s.pace[j], s)[0]
    for k in range(len(tables.directions)):
        j, partner = tables.directions[k, 0], tables.directions[k, 1]
        v, before = s.v[j], s.before[j]
        if partner >= 0:
            v, before = v + s.v[partner], before + s.before[partner]
        if v * (v - before) > 0.0:
            s.turn[k] = clip(s.turn[k] + (v - before) * tables.slope[k])
        turn = s.turn[k]
        effort = abs(turn) * level_at(tables.dry, k, 0 if turn >= 0.0 else 1, s.pace[j])
        s.r[j] += effort
        if partner >= 0:
            s.r[partner] += effort
    for j in range(len(s.v)):
        s.before[j] = s.v[j]
