"""Look up the effects' tables at the present position and velocity, and move friction's memory.

Dry friction keeps its direction, as identified (:mod:`pinotwin.effects.direction`): it turns with slope
1/width while the axis speeds up and holds while it slows down or stands. Slip elements bend and slip
as in :mod:`pinotwin.effects.presliding`.
"""

from __future__ import annotations

import numpy as np

from pinotwin.dynamics.stepping import leaf


@leaf
def level_at(table, k, side, place):  # type: ignore[no-untyped-def]
    """Return table [k, side] at a place between 0 and its last index.

    Whole arrays are passed and indexed: a view costs more than the look-up, by its reference count.
    """
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
    if place < 0.0:
        place = 0.0
    if place > n - 1.0:
        place = n - 1.0
    i = int(place)
    if i > n - 2:
        i = n - 2
    low = tables.position[start + i]
    return low + (place - i) * (tables.position[start + i + 1] - low)


@leaf
def clip(x):  # type: ignore[no-untyped-def]
    """Return x within [-1, 1]."""
    if x > 1.0:
        return 1.0
    return -1.0 if x < -1.0 else x


@leaf
def _pace(tables, s):  # type: ignore[no-untyped-def]
    """Fill the place of every joint's speed in the tables over speed."""
    n = float(tables.velocity.shape[2] - 1)
    for j in range(len(s.v)):
        share = abs(s.v[j]) * tables.slowness[j]
        s.pace[j] = n * np.sqrt(share) if share < 1.0 else n


@leaf
def _bend(tables, k, q, s):  # type: ignore[no-untyped-def]
    """Move the slip elements and the bristle of an axis to q; return the mean bend of the elements."""
    dq, play = q - s.where[k], tables.memory[k, 1]
    dq = dq - play if dq > play else (dq + play if dq < -play else 0.0)
    s.where[k] += dq
    total, m = 0.0, tables.give.shape[1]
    for i in range(m):
        bend = clip(s.bend[k, i] + dq * tables.give[k, i])
        s.bend[k, i] = bend
        total += bend
    if dq != 0.0 and tables.memory[k, 0] > 0.0:
        side = 1.0 if dq > 0.0 else -1.0
        s.bend[k, m] = side + (s.bend[k, m] - side) * np.exp(-abs(dq) * tables.memory[k, 0])
    return total / m


@leaf
def _bristle(tables, k, z, v, s):  # type: ignore[no-untyped-def]
    """Return what the bristle adds to the elements."""
    y = s.bend[k, tables.give.shape[1]]
    rate = v - abs(v) * y
    return tables.memory[k, 2] * (y - z) + tables.memory[k, 3] * rate * tables.memory[k, 0]


@leaf
def friction(tables, s):  # type: ignore[no-untyped-def]
    """Add the efforts of velocity, direction and displacement to r; move their memory."""
    _pace(tables, s)
    for k in range(len(tables.speeds)):
        j = tables.speeds[k]
        s.r[j] += level_at(tables.velocity, k, 0 if s.v[j] >= 0.0 else 1, s.pace[j])
    for k in range(len(tables.directions)):
        j, partner = tables.directions[k, 0], tables.directions[k, 1]
        v = s.v[j] + (s.v[partner] if partner >= 0 else 0.0)
        dv = v - s.before[k]
        if v * dv > 0.0:
            s.turn[k] = clip(s.turn[k] + dv * tables.slope[k])
        s.before[k] = v
        turn = s.turn[k]
        effort = abs(turn) * level_at(tables.dry, k, 0 if turn >= 0.0 else 1, s.pace[j])
        s.r[j] += effort
        if partner >= 0:
            s.r[partner] += effort
    for k in range(len(tables.slips)):
        j = tables.slips[k]
        z = _bend(tables, k, s.q[j], s)
        s.r[j] += z * level_at(tables.slip, k, 0, s.pace[j]) + _bristle(tables, k, z, s.v[j], s)
