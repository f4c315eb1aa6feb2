r"""One axis under its controller, and how its error and effort change with every number it is made of.

The scheme of :mod:`pinotwin.simulation.axis_kernel`, and beside each of its steps the derivatives of that step along
up to :data:`LANES` directions: with x the state and p the numbers of axis and law,

    x' = f(x; p),        dx'/dr = df/dx dx/dr + df/dp dp/dr

What costs (the place in the tables, what holds, what slips) is found once a step; the directions only multiply and
add, several at once in a processor's vectors. A search for a controller asks for a dozen: they cost as much as two
and a half simulations, difference quotients a dozen. Friction of velocity, or with a memory, has no slopes here.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.stepping import entry, inlined, leaf
from pinotwin.simulation.axis_kernel import (
    Axis,
    Course,
    acts,
    asked,
    begin,
    command,
    move,
    pace_of,
    room,
)
from pinotwin.simulation.state import Lookup

LANES = 16
"""Directions that are followed at once; a fixed number lets the compiler use vectors."""
NUMBERS = 19
_M, _C, _GAIN, _SEE, _LAG, _NOTCH, _DEAD, _OFFSET, _DRY, _FADING = (
    LANES * k for k in (0, 1, 2, 8, 9, 10, 15, 16, 17, 18)
)
"""Places of the numbers of an axis in a direction: inertia, viscous friction, six gains, shares of velocity filter
and current loop, five of the notch, dead time [steps], offset, logarithms of lasting and of fading dry friction."""
_Q, _V, _BEFORE, _SEEN, _WOUND, _OUT, _FIRST, _SECOND, _U, _FORCE = (LANES * k for k in range(10))
"""Places of the state's derivatives."""
PLACES, FIRST_GAIN = {"inertia": 0, "viscous": 1, "dry": 17, "fading": 18}, 2
"""Places of the numbers of the plant in a direction, and of the first of six gains."""


def direction(axis: Axis) -> Floats:
    """Return the numbers of an axis as a direction has them, shape (NUMBERS,); friction's logarithms are 0."""
    offset = 0.0 if np.isnan(axis.offset) else axis.offset
    dead = axis.whole + axis.part
    lags = (axis.see, axis.lag)
    return np.array([axis.inertia, axis.viscous, *axis.gains, *lags, *axis.notch, dead, offset, 0.0, 0.0])


@inlined
def _begun(axis, c, start, along, d):  # type: ignore[no-untyped-def]
    """Fill in the derivatives of the state in which the law begins."""
    e, v, u = c[0] - start[0], start[1], start[2]
    free = 1.0 if np.isnan(axis.offset) else 0.0
    for j in range(LANES):
        law = along[_GAIN + j] * e - along[_GAIN + 2 * LANES + j] * v
        law += along[_GAIN + 3 * LANES + j] * c[1] + along[_GAIN + 5 * LANES + j] * c[2]
        d[_WOUND + j] = along[_OFFSET + j] - free * law
        d[_FIRST + j] = -u * along[_NOTCH + j]
        d[_SECOND + j] = u * (along[_NOTCH + 2 * LANES + j] - along[_NOTCH + 4 * LANES + j])


@inlined
def _law(axis, h, c, e, v, law, along, d):  # type: ignore[no-untyped-def]  # noqa: PLR0913, a compiled kernel
    """Step the derivatives of the law; ``law`` is its state before the step."""
    g = axis.gains
    seen = law[0] + axis.see * (v - law[0])
    u = g[0] * e + law[1] - g[2] * seen + g[3] * c[1] + g[5] * c[2]
    for j in range(LANES):
        late = 1.5 * d[_V + j] - 0.5 * d[_BEFORE + j] - d[_SEEN + j]
        d[_SEEN + j] += axis.see * late + along[_SEE + j] * (v - law[0])
        asks = d[_WOUND + j] - g[0] * d[_Q + j] - g[2] * d[_SEEN + j] + along[_GAIN + j] * e
        asks += along[_GAIN + 3 * LANES + j] * c[1] - along[_GAIN + 2 * LANES + j] * seen
        d[_U + j] = asks + along[_GAIN + 5 * LANES + j] * c[2]
    if axis.notched == 1:
        u = _notch(axis, u, law[3], along, d)
    free = 1.0 if abs(u) <= axis.limit else 0.0
    if free == 0.0:
        u = axis.limit if u > 0.0 else -axis.limit
    for j in range(LANES):
        winds = along[_GAIN + LANES + j] * e - g[1] * d[_Q + j] + along[_GAIN + 4 * LANES + j] * c[1]
        d[_WOUND + j] += free * h * winds
        d[_OUT + j] += axis.lag * (free * d[_U + j] - d[_OUT + j]) + along[_LAG + j] * (u - law[2])


@inlined
def _notch(axis, u, first, along, d):  # type: ignore[no-untyped-def]
    """Step the derivatives of the notch; return what it makes of an effort u."""
    b = axis.notch
    y = b[0] * u + first
    for j in range(LANES):
        du = d[_U + j]
        dy = b[0] * du + along[_NOTCH + j] * u + d[_FIRST + j]
        moved = b[1] * du - b[3] * dy + d[_SECOND + j]
        d[_FIRST + j] = moved + along[_NOTCH + LANES + j] * u - along[_NOTCH + 3 * LANES + j] * y
        held = along[_NOTCH + 2 * LANES + j] * u - along[_NOTCH + 4 * LANES + j] * y
        d[_SECOND + j] = b[2] * du - b[4] * dy + held
        d[_U + j] = dy
    return y


@inlined
def _pushed(axis, late, past, at, along, d):  # type: ignore[no-untyped-def]
    """Put the efforts' derivatives in their place ``at``; fill in those of the effort that acts."""
    i = at - axis.whole
    if i < 0:
        i += len(late)
    last = i - 1 if i > 0 else len(late) - 1
    rise, now, then = late[last] - late[i], LANES * i, LANES * last
    for j in range(LANES):
        past[LANES * at + j] = d[_OUT + j]
    for j in range(LANES):
        moved = past[now + j] + axis.part * (past[then + j] - past[now + j])
        d[_FORCE + j] = moved + along[_DEAD + j] * rise


@inlined
def _level(tables, side, pace, v):  # type: ignore[no-untyped-def]
    """Return dry friction on one side at a place: its rise with the velocity, its lasting and its fading part.

    Below the first knot the table is taken as straight in the velocity itself: the root has no slope at rest.
    """
    top = tables.dry.shape[2] - 1
    i = min(int(pace), top - 1)
    level, rise, lasting = 0.0, 0.0, 0.0
    for k in range(len(tables.dry)):
        low = tables.dry[k, side, i]
        level += low + (pace - i) * (tables.dry[k, side, i + 1] - low)
        rise += tables.dry[k, side, i + 1] - low
        lasting += tables.dry[k, side, top]
    slow = pace < 1.0
    places = float(top * top) * tables.slowness[0] if slow else 0.5 * pace / max(abs(v), 1e-300)
    if pace >= top:
        places = 0.0
    return rise * (places if v >= 0.0 else -places), lasting, level - lasting


@inlined
def _motion(axis, tables, A, h, force, v, moved, pace, along, d):  # type: ignore[no-untyped-def]  # noqa: PLR0913, a compiled kernel
    """Step the derivatives of position and velocity; ``moved`` is the velocity after the step."""
    if moved == 0.0:  # dry friction holds it
        for j in range(LANES):
            d[_BEFORE + j] = d[_V + j]
            d[_V + j] = 0.0
        return
    rise, lasting, fading = _level(tables, 0 if moved > 0.0 else 1, pace, v)
    keeps, share = A / h - axis.viscous - rise, h / A
    for j in range(LANES):
        mass = along[_M + j] + h * along[_C + j]
        slows = along[_DRY + j] * lasting + along[_FADING + j] * fading + along[_C + j] * v
        pushes = d[_FORCE + j] + keeps * d[_V + j] - slows + mass * (v / h) - mass * (moved / h)
        d[_BEFORE + j] = d[_V + j]
        d[_V + j] = share * pushes
        d[_Q + j] += h * d[_V + j]


@leaf
def _loop(axis, tables, course, memory, start, along, d, past, out, slopes):  # type: ignore[no-untyped-def]  # noqa: PLR0913, a compiled kernel
    """Step an axis and its derivatives; see :func:`run`."""
    n, sub, at = len(course.qr), course.substeps, 0
    h, rate = course.step / sub, 1.0 / course.step
    q, v, before = start[0], start[1], start[1]
    c = command(course, rate, 0, 0.0)
    law = begin(axis, c, start, memory)
    _begun(axis, c, start, along, d)
    A = axis.inertia + h * axis.viscous
    for row in range(n - 1):
        load, rise = course.load[row], course.load[row + 1] - course.load[row]
        for k in range(sub):
            s = k / sub
            c = command(course, rate, row, s)
            e, seen = c[0] - q, 1.5 * v - 0.5 * before
            _law(axis, h, c, e, seen, law, along, d)
            law = asked(axis, h, c, q, seen, law)
            at = at + 1 if at + 1 < len(memory.late) else 0
            force = acts(axis, memory.late, at, law[2]) + load + s * rise - axis.viscous * v
            _pushed(axis, memory.late, past, at, along, d)
            if k == 0:
                out[row, 0], out[row, 1] = e, law[2]
                for j in range(slopes.shape[2]):
                    slopes[row, 0, j], slopes[row, 1, j] = -d[_Q + j], d[_OUT + j]
                if not abs(e) <= course.error:
                    return row
            pace, before = pace_of(tables, v), v
            q, v = move(tables, A, h, force, q, v, pace)
            _motion(axis, tables, A, h, force, before, v, pace, along, d)
    out[n - 1, 0], out[n - 1, 1] = course.qr[n - 1] - q, law[2]
    for j in range(slopes.shape[2]):
        slopes[n - 1, 0, j], slopes[n - 1, 1, j] = -d[_Q + j], d[_OUT + j]
    return -1


_compiled = entry(_loop)


def run(
    axis: Axis, tables: Lookup, course: Course, start: Floats, directions: Floats
) -> tuple[Floats, Floats] | None:
    """Step through a command from position, velocity and effort ``start``.

    Args:
        axis: law and plant.
        tables: its friction, dry alone.
        course: what is asked of it.
        start: position, velocity, effort.
        directions: of :func:`direction`, shape (k, NUMBERS), k at most :data:`LANES`.

    Returns:
        e and u, shape (n, 2), and their derivatives along the directions, shape (n, 2, k); None where it runs away.
    """
    count, n = len(directions), len(course.qr)
    along = np.zeros((NUMBERS, LANES))
    along[:, :count] = directions.T
    memory = room(axis.whole, 0, tables.give.shape[1])
    d, past = np.zeros(10 * LANES), np.zeros(LANES * len(memory.late))
    out, slopes = np.empty((n, 2)), np.empty((n, 2, count))
    failed = _compiled(axis, tables, course, memory, start, along.ravel(), d, past, out, slopes)
    return None if failed >= 0 else (out, slopes)
