"""One axis alone under its controller, the scheme of :mod:`pinotwin.simulation.coupled_kernel` in scalars.

The search for a controller takes a tenth of the time so. A test holds both kernels to the same numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.stepping import entry, inlined, leaf
from pinotwin.simulation.law import Law, acts, asked, begun
from pinotwin.simulation.plant_kernel import further, hermite, level_at, pace_of
from pinotwin.simulation.state import Command, Lookup, at_rest


class Axis(NamedTuple):
    """What one axis is made of."""

    inertia: float  # M [kg or kg·m²]
    viscous: float  # C
    law: Law  # its controller at the internal step


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


@entry
@leaf
def _loop(axis, tables, course, s, start, out):  # type: ignore[no-untyped-def]
    """Step an axis along its course and fill e and u, (n, 2); return the row at which it runs away, or -1."""
    n, sub, at, law = len(course.qr), course.substeps, 0, axis.law
    h, interval = course.step / sub, (course.step, 1.0 / course.step)
    q, v, before = start[0], start[1], start[1]
    state = begun(law, _command(course, interval, 0, 0.0), q, v, start[2])
    for k in range(s.late.shape[1]):
        s.late[0, k] = start[2]
    for k in range(len(s.where)):
        s.where[k] = q
    for row in range(n - 1):
        load, rise = course.load[row], course.load[row + 1] - course.load[row]
        for k in range(sub):
            share = k / sub
            c = _command(course, interval, row, share)
            e = c[0] - q
            seen = 1.5 * v - 0.5 * before  # the scheme's v is half a step late
            state = asked(law, h, c, q, seen, state)
            at = at + 1 if at + 1 < s.late.shape[1] else 0
            force = acts(law, s.late, 0, at, state[2]) + load + share * rise
            if k == 0:
                out[row, 0], out[row, 1] = e, state[2]
                if not abs(e) <= course.limit:
                    return row
            pace, before = pace_of(tables, 0, v), v
            effort, damping = further(tables, 0, h, q, v, pace, s)
            A = axis.inertia + h * (axis.viscous + damping)
            low, high = _dry(tables, pace)
            force -= axis.viscous * v + effort
            force += v * (A / h)  # what stops the axis within the step
            v = (h / A) * (force - (high if force > high else (low if force < low else force)))
            q += h * v
    out[n - 1, 0], out[n - 1, 1] = course.qr[n - 1] - q, state[2]
    return -1


def run(axis: Axis, tables: Lookup, course: Command, start: Floats) -> Floats | None:
    """Return e and u, (n, 2), from position, velocity and effort ``start`` on; None where the axis runs away."""
    out, state = np.empty((len(course.qr), 2)), at_rest(tables, np.zeros(0), late=int(axis.law.whole) + 2)
    return out if _loop(axis, tables, course, state, start, out) < 0 else None
