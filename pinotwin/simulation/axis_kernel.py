"""One axis alone under its controller, the scheme of :mod:`pinotwin.simulation.coupled_kernel` in scalars.

The search for a controller takes a tenth of the time so. A test holds both kernels to the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.stepping import entry, inlined, leaf
from pinotwin.simulation.law import Law, acts, asked, begun
from pinotwin.simulation.plant_kernel import bend, hermite, level_at, pace_of
from pinotwin.simulation.state import Lookup


class Axis(NamedTuple):
    """What one axis is made of."""

    inertia: float  # M [kg or kg·m²]
    viscous: float  # C
    law: Law  # its controller at the internal step


class Course(NamedTuple):
    """What is asked of the axis, one row a sample: shapes (n,)."""

    qr: Floats  # command
    vr: Floats  # its velocity
    load: Floats  # effort that helps the motor
    step: float  # sampling interval [s]
    substeps: int  # internal steps a sample
    error: float  # tracking error at which the run is stopped


class Memory(NamedTuple):
    """Room for what friction and the dead time remember."""

    late: Floats  # efforts of the last steps, shape (1, whole + 2)
    bend: Floats  # of presliding elements, shape (m, 7)
    where: Floats  # their positions, shape (m,)
    one: Floats  # effort, damping and stiffness of the element last moved, shape (3,)


@inlined
def _command(course, interval, row, share):  # type: ignore[no-untyped-def]
    """Return the command and its two derivatives at a share of the way from a row to the next."""
    q, v = course.qr, course.vr
    return hermite(q[row], q[row + 1], v[row], v[row + 1], interval, share)


@inlined
def _dry(tables, pace):  # type: ignore[no-untyped-def]
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


def _loop(further: Callable[..., Any]) -> Callable[..., Any]:
    """Return the stepping loop of an axis with a further friction; see :func:`run`."""

    @leaf
    def loop(axis, tables, course, memory, start, out):  # type: ignore[no-untyped-def]
        n, sub, at, law = len(course.qr), course.substeps, 0, axis.law
        h, interval = course.step / sub, (course.step, 1.0 / course.step)
        q, v, before = start[0], start[1], start[1]
        state = begun(law, _command(course, interval, 0, 0.0), q, v, start[2])
        for k in range(memory.late.shape[1]):
            memory.late[0, k] = start[2]
        for k in range(len(memory.where)):
            memory.where[k] = q
        for row in range(n - 1):
            load, rise = course.load[row], course.load[row + 1] - course.load[row]
            for k in range(sub):
                share = k / sub
                c = _command(course, interval, row, share)
                e = c[0] - q
                seen = 1.5 * v - 0.5 * before  # the scheme's v is half a step late
                state = asked(law, h, c, q, seen, state)
                at = at + 1 if at + 1 < memory.late.shape[1] else 0
                force = acts(law, memory.late, 0, at, state[2]) + load + share * rise
                if k == 0:
                    out[row, 0], out[row, 1] = e, state[2]
                    if not abs(e) <= course.error:
                        return row
                pace, before = pace_of(tables, 0, v), v
                effort, damping = further(tables, h, q, v, pace, memory)
                A = axis.inertia + h * (axis.viscous + damping)
                low, high = _dry(tables, pace)
                force -= axis.viscous * v + effort
                force += v * (A / h)  # what stops the axis within the step
                v = (h / A) * (force - (high if force > high else (low if force < low else force)))
                q += h * v
        out[n - 1, 0], out[n - 1, 1] = course.qr[n - 1] - q, state[2]
        return -1

    return entry(loop)


_plain, _whole = _loop(_nothing), _loop(_further)


def run(axis: Axis, tables: Lookup, course: Course, start: Floats) -> Floats | None:
    """Return e and u, (n, 2), from position, velocity and effort ``start`` on; None where the axis runs away."""
    slips, z, out = len(tables.slips), np.zeros, np.empty((len(course.qr), 2))
    loop = _whole if slips or len(tables.speeds) else _plain
    memory = Memory(z((1, int(axis.law.whole) + 2)), z((slips, tables.give.shape[1] + 1)), z(slips), z(3))
    return out if loop(axis, tables, course, memory, start, out) < 0 else None
