"""One axis alone under its controller, the scheme of :mod:`pinotwin.simulation.coupled_kernel` in scalars.

The search for a controller simulates an axis a thousand times; with scalars a step costs a tenth of the
general kernel's. The general kernel is the reference: a test holds both to the same numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.stepping import leaf


class Axis(NamedTuple):
    """What one axis is made of.

    Attributes:
        inertia: M [kg or kg·m²].
        viscous: C.
        gains: of the law, shape (6,); see :mod:`pinotwin.loop.servo`.
        see: what the velocity filter moves in a step.
        lag: what the current loop moves in a step.
        notched: 1 where there is a notch.
        notch: its b0, b1, b2, a1, a2, shape (5,).
        whole: dead time in whole steps.
        part: and the rest of it.
        limit: largest effort.
        offset: what the integrator begins with; NaN for what the effort at the start asks for.
        tick: step of the encoder by which the law is closed; 0 for none.
        origin: of its steps.
    """

    inertia: float
    viscous: float
    gains: Floats
    see: float
    lag: float
    notched: int
    notch: Floats
    whole: int
    part: float
    limit: float
    offset: float
    tick: float
    origin: float


class Course(NamedTuple):
    """What is asked of the axis, one row a sample: shapes (n,).

    Attributes:
        qr: command.
        vr: its velocity.
        load: effort that helps the motor.
        step: sampling interval [s].
        substeps: internal steps a sample.
        error: tracking error at which the run is stopped.
    """

    qr: Floats
    vr: Floats
    load: Floats
    step: float
    substeps: int
    error: float


class Memory(NamedTuple):
    """Room for what friction and the dead time remember.

    Attributes:
        late: efforts of the last steps, shape (whole + 2,).
        bend: of presliding elements, shape (m, 7).
        where: their positions, shape (m,).
        one: effort, damping and stiffness of the element last moved, shape (3,).
        x: position, velocity, velocity seen, integral, effort, two of the notch, the
            velocity before, shape (8,).
        c: command and its two derivatives, shape (3,).
        at: place of the present effort in ``late``, shape (1,).
    """

    late: Floats
    bend: Floats
    where: Floats
    one: Floats
    x: Floats
    c: Floats
    at: Ints


Q, V, SEEN, WOUND, OUT, FIRST, SECOND, BEFORE = range(8)
"""Places in ``Memory.x``."""


@leaf
def level_at(table, k, side, pace):  # type: ignore[no-untyped-def]
    """Return table [k, side] at a place between 0 and its last index."""
    i = int(pace)
    if i > table.shape[2] - 2:
        i = table.shape[2] - 2
    low = table[k, side, i]
    return low + (pace - i) * (table[k, side, i + 1] - low)


@leaf
def shown(q, tick, origin):  # type: ignore[no-untyped-def]
    """Return the position that an encoder shows."""
    return q if tick == 0.0 else origin + tick * np.floor((q - origin) / tick + 0.5)


@leaf
def bend(tables, k, q, v, pace, memory):  # type: ignore[no-untyped-def]
    """Move one presliding element to q; fill its effort, its damping and its stiffness into ``one``."""
    m = tables.give.shape[1]
    dq, play = q - memory.where[k], tables.memory[k, 1]
    dq = dq - play if dq > play else (dq + play if dq < -play else 0.0)
    memory.where[k] += dq
    z, stiff = 0.0, 0.0
    for i in range(m):
        x = memory.bend[k, i] + dq * tables.give[k, i]
        x = 1.0 if x > 1.0 else (-1.0 if x < -1.0 else x)
        memory.bend[k, i] = x
        z += x
        if not (x >= 1.0 and v > 0.0) and not (x <= -1.0 and v < 0.0):
            stiff += tables.give[k, i]
    z, stiff = z / m, stiff / m
    y, rate = memory.bend[k, m], tables.memory[k, 0]
    if dq != 0.0 and rate > 0.0:
        side = 1.0 if dq > 0.0 else -1.0
        y = side + (y - side) * np.exp(-abs(dq) * rate)
        memory.bend[k, m] = y
    level = level_at(tables.slip, k, 0, pace)
    damp = tables.memory[k, 3] * rate * (1.0 - y * (1.0 if v >= 0.0 else -1.0))
    memory.one[0] = z * level + tables.memory[k, 2] * (y - z) + damp * v
    memory.one[1], memory.one[2] = damp, stiff * level


@leaf
def _law(axis, h, c, memory):  # type: ignore[no-untyped-def]
    """Step the controller; return the effort that acts."""
    x, g = memory.x, axis.gains
    e = c[0] - shown(x[Q], axis.tick, axis.origin)
    v = 1.5 * x[V] - 0.5 * x[BEFORE]  # the velocity of the scheme is half a step late
    x[BEFORE] = x[V]
    x[SEEN] += axis.see * (v - x[SEEN])
    u = g[0] * e + x[WOUND] - g[2] * x[SEEN] + g[3] * c[1] + g[5] * c[2]
    if axis.notched == 1:
        b = axis.notch
        y = b[0] * u + x[FIRST]
        x[FIRST] = b[1] * u - b[3] * y + x[SECOND]
        x[SECOND] = b[2] * u - b[4] * y
        u = y
    if abs(u) <= axis.limit:
        x[WOUND] += h * (g[1] * e + g[4] * c[1])
    else:
        u = axis.limit if u > 0.0 else -axis.limit
    x[OUT] += axis.lag * (u - x[OUT])
    late, size = memory.late, len(memory.late)
    at = memory.at[0] + 1
    if at == size:
        at = 0
    memory.at[0] = at
    late[at] = x[OUT]
    i = at - axis.whole
    if i < 0:
        i += size
    return late[i] + axis.part * (late[i - 1 if i > 0 else size - 1] - late[i])


@leaf
def _move(axis, tables, h, force, memory):  # type: ignore[no-untyped-def]
    """Move the axis over a step under a force, less its friction."""
    x = memory.x
    v, top = x[V], float(tables.velocity.shape[2] - 1)
    force -= axis.viscous * v
    A = axis.inertia + h * axis.viscous
    share = abs(v) * tables.slowness[0]
    pace = top * np.sqrt(share) if share < 1.0 else top
    for k in range(len(tables.speeds)):
        effort = level_at(tables.velocity, k, 0 if v >= 0.0 else 1, pace)
        force -= effort
        if abs(v) > 1e-12:
            A += h * max(effort / v, 0.0)
    for k in range(len(tables.slips)):
        bend(tables, k, x[Q], v, pace, memory)
        force -= memory.one[0] + h * memory.one[2] * v
        A += h * (memory.one[1] + h * memory.one[2])
    w = v + h * force / A
    low, high = 0.0, 0.0
    for k in range(len(tables.dry)):
        low += level_at(tables.dry, k, 1, pace)
        high += level_at(tables.dry, k, 0, pace)
    if low > high:
        low = high = 0.5 * (low + high)
    stop = w * A / h
    stop = high if stop > high else (low if stop < low else stop)
    x[V] = w - h * stop / A
    x[Q] += h * x[V]


@leaf
def _begin(axis, c, start, memory):  # type: ignore[no-untyped-def]
    """Begin at position, velocity and effort ``start``."""
    x, g, b = memory.x, axis.gains, axis.notch
    q, v, u = start[0], start[1], start[2]
    law = g[0] * (c[0] - shown(q, axis.tick, axis.origin)) - g[2] * v + g[3] * c[1] + g[5] * c[2]
    x[Q], x[V], x[SEEN], x[OUT], x[BEFORE] = q, v, v, u, v
    x[WOUND] = u - law if np.isnan(axis.offset) else axis.offset
    x[FIRST], x[SECOND] = u * (1.0 - b[0]), u * (b[2] - b[4])
    for k in range(len(memory.late)):
        memory.late[k] = u
    for k in range(len(memory.where)):
        memory.where[k] = q


@leaf
def run(axis, tables, course, memory, start, out):  # type: ignore[no-untyped-def]
    """Step through a command from position, velocity and effort ``start``; fill e and u, (n, 2).

    Returns:
        Row at which the tracking error exceeded its limit, or -1.
    """
    n, sub, step = len(course.qr), course.substeps, course.step
    h, x, c = step / sub, memory.x, memory.c
    qr, vr, load = course.qr, course.vr, course.load
    for row in range(n - 1):
        dq, c1, v1 = qr[row + 1] - qr[row], step * vr[row], step * vr[row + 1]
        c2, c3 = 3.0 * dq - 2.0 * c1 - v1, c1 + v1 - 2.0 * dq
        for k in range(sub):
            s = k / sub
            c[0] = qr[row] + s * (c1 + s * (c2 + s * c3))
            c[1] = (c1 + s * (2.0 * c2 + s * 3.0 * c3)) / step
            c[2] = (2.0 * c2 + 6.0 * s * c3) / (step * step)
            if row == 0 and k == 0:
                _begin(axis, c, start, memory)
            e = c[0] - x[Q]
            act = _law(axis, h, c, memory)
            if k == 0:
                out[row, 0], out[row, 1] = e, x[OUT]
                if not abs(e) <= course.error:
                    return row
            _move(axis, tables, h, act + load[row] + s * (load[row + 1] - load[row]), memory)
    out[n - 1, 0], out[n - 1, 1] = qr[n - 1] - x[Q], x[OUT]
    return -1


def room(whole: int, slips: int, elements: int) -> Memory:
    """Return fresh memory."""
    z = np.zeros
    at = np.zeros(1, dtype=np.intp)
    return Memory(z(whole + 2), z((slips, elements + 1)), z(slips), z(3), z(8), z(3), at)
