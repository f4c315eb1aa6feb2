"""One axis alone under its controller, the scheme of :mod:`pinotwin.simulation.coupled_kernel` in scalars.

The search for a controller simulates an axis a thousand times; with scalars a step costs a tenth of the
general kernel's. The general kernel is the reference: a test holds both to the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.stepping import entry, inlined, leaf
from pinotwin.simulation.lookup import level_at
from pinotwin.simulation.state import Lookup


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
    """

    late: Floats
    bend: Floats
    where: Floats
    one: Floats


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


@inlined
def command(course, rate, row, s):  # type: ignore[no-untyped-def]
    """Return the command and its two derivatives at a share ``s`` of the way from a row to the next.

    ``rate`` is that of the log: a division costs as much as the rest.
    """
    step, begun = course.step, course.qr[row]
    dq, c1, v1 = course.qr[row + 1] - begun, step * course.vr[row], step * course.vr[row + 1]
    c2, c3 = 3.0 * dq - 2.0 * c1 - v1, c1 + v1 - 2.0 * dq
    q = begun + s * (c1 + s * (c2 + s * c3))
    return q, (c1 + s * (2.0 * c2 + s * 3.0 * c3)) * rate, (2.0 * c2 + 6.0 * s * c3) * (rate * rate)


@inlined
def asked(axis, h, c, q, v, law):  # type: ignore[no-untyped-def]
    """Step the law; return its state: velocity seen, integral, effort after the current loop, two of the notch."""
    g = axis.gains
    seen, wound, out, first, second = law
    e = c[0] - shown(q, axis.tick, axis.origin)
    seen += axis.see * (v - seen)
    u = g[0] * e + wound - g[2] * seen + g[3] * c[1] + g[5] * c[2]
    if axis.notched == 1:
        b = axis.notch
        y = b[0] * u + first
        first = b[1] * u - b[3] * y + second
        second = b[2] * u - b[4] * y
        u = y
    if abs(u) <= axis.limit:
        wound += h * (g[1] * e + g[4] * c[1])
    else:
        u = axis.limit if u > 0.0 else -axis.limit
    return seen, wound, out + axis.lag * (u - out), first, second


@inlined
def acts(axis, late, at, out):  # type: ignore[no-untyped-def]
    """Put an effort in its place ``at``; return the one that acts after the dead time."""
    late[at] = out
    i = at - axis.whole
    if i < 0:
        i += len(late)
    return late[i] + axis.part * (late[i - 1 if i > 0 else len(late) - 1] - late[i])


@inlined
def dry(tables, pace):  # type: ignore[no-untyped-def]
    """Return the least and the largest effort of dry friction."""
    low, high = 0.0, 0.0
    for k in range(len(tables.dry)):
        low += level_at(tables.dry, k, 1, pace)
        high += level_at(tables.dry, k, 0, pace)
    return (low, high) if low <= high else (0.5 * (low + high), 0.5 * (low + high))


@inlined
def _nothing(tables, h, q, v, pace, memory):  # type: ignore[no-untyped-def]
    """Return effort and damping where friction is viscous and dry alone."""
    return 0.0, 0.0


@inlined
def _further(tables, h, q, v, pace, memory):  # type: ignore[no-untyped-def]
    """Return effort and damping over a step of friction of the velocity and of presliding elements; move these."""
    effort, damping = 0.0, 0.0
    for k in range(len(tables.speeds)):
        slows = level_at(tables.velocity, k, 0 if v >= 0.0 else 1, pace)
        effort += slows
        if abs(v) > 1e-12:
            damping += max(slows / v, 0.0)
    for k in range(len(tables.slips)):
        bend(tables, k, q, v, pace, memory)
        effort += memory.one[0] + h * memory.one[2] * v
        damping += memory.one[1] + h * memory.one[2]
    return effort, damping


@inlined
def pace_of(tables, v):  # type: ignore[no-untyped-def]
    """Return the place of a velocity in the tables."""
    top, share = float(tables.velocity.shape[2] - 1), abs(v) * tables.slowness[0]
    return top * np.sqrt(share) if share < 1.0 else top


@inlined
def move(tables, A, h, force, q, v, pace):  # type: ignore[no-untyped-def]
    """Return position and velocity of a mass A after a step under a force less its dry friction."""
    low, high = dry(tables, pace)
    force += v * (A / h)  # what stops the axis within the step
    v = (h / A) * (force - (high if force > high else (low if force < low else force)))
    return q + h * v, v


@inlined
def begin(axis, c, start, memory):  # type: ignore[no-untyped-def]
    """Return the state of the law at position, velocity and effort ``start``; fill the memory likewise."""
    g, b = axis.gains, axis.notch
    q, v, u = start[0], start[1], start[2]
    law = g[0] * (c[0] - shown(q, axis.tick, axis.origin)) - g[2] * v + g[3] * c[1] + g[5] * c[2]
    for k in range(len(memory.late)):
        memory.late[k] = u
    for k in range(len(memory.where)):
        memory.where[k] = q
    return v, u - law if np.isnan(axis.offset) else axis.offset, u, u * (1.0 - b[0]), u * (b[2] - b[4])


def _loop(further: Callable[..., Any]) -> Callable[..., Any]:
    """Return the stepping loop of an axis with a further friction; see :func:`run`."""

    @leaf
    def loop(axis, tables, course, memory, start, out):  # type: ignore[no-untyped-def]
        n, sub, at = len(course.qr), course.substeps, 0
        h, rate = course.step / sub, 1.0 / course.step
        q, v, before = start[0], start[1], start[1]
        law = begin(axis, command(course, rate, 0, 0.0), start, memory)
        for row in range(n - 1):
            load, rise = course.load[row], course.load[row + 1] - course.load[row]
            for k in range(sub):
                s = k / sub
                c = command(course, rate, row, s)
                e = c[0] - q
                law = asked(axis, h, c, q, 1.5 * v - 0.5 * before, law)  # the scheme's v is half a step late
                at = at + 1 if at + 1 < len(memory.late) else 0
                force = acts(axis, memory.late, at, law[2]) + load + s * rise
                if k == 0:
                    out[row, 0], out[row, 1] = e, law[2]
                    if not abs(e) <= course.error:
                        return row
                pace, before = pace_of(tables, v), v
                effort, damping = further(tables, h, q, v, pace, memory)
                force -= axis.viscous * v + effort
                A = axis.inertia + h * (axis.viscous + damping)
                q, v = move(tables, A, h, force, q, v, pace)
        out[n - 1, 0], out[n - 1, 1] = course.qr[n - 1] - q, law[2]
        return -1

    return entry(loop)


_plain, _whole = _loop(_nothing), _loop(_further)


def run(axis: Axis, tables: Lookup, course: Course, memory: Memory, start: Floats, out: Floats) -> int:
    """Step through a command from position, velocity and effort ``start``; fill e and u, (n, 2).

    The state is handed on as plain numbers, and an axis of viscous and dry friction has a loop of its own: arrays,
    and what is never done, triple the time of a step.

    Returns:
        Row at which the tracking error exceeded its limit, or -1.
    """
    loop = _whole if len(tables.slips) or len(tables.speeds) else _plain
    return int(loop(axis, tables, course, memory, start, out))


def room(whole: int, slips: int, elements: int) -> Memory:
    """Return fresh memory."""
    z = np.zeros
    return Memory(z(whole + 2), z((slips, elements + 1)), z(slips), z(3))
