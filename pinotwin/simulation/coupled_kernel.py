"""The stepping loop of the coupled machine: identified controllers around the identified plant.

One internal step h, semi-implicit (symplectic) Euler, which is late by nothing between effort and position:

    1  u      from e, v, vr, ar by the law of each axis (:mod:`pinotwin.loop.servo`), lags exactly
    2  A dv   = h (u_late - h(q, v) - position - velocity's effort - K (q + h v) + load),
                A = M(q) + h C + h² K, with the slopes of what depends on velocity and bend in C and K
    3  dry friction: impulses that stop an axis, none larger than its level (projected Gauss-Seidel), so that
                it holds an axis at rest and puts no energy in, whatever the gains
    4  v += dv,  q += h v

A load that hangs on joint j by a spring (a share s of its inertia, twist x, x'' = a_j - f, f = w^2 x + 2 zeta w x')
takes s M_ij a_j off step 2 and puts s M_ij f there instead, at every joint i.
"""

from __future__ import annotations

import numpy as np

from pinotwin.dynamics.stepping import entry, leaf
from pinotwin.simulation.law import acts, asked, begun
from pinotwin.simulation.plant_kernel import (
    along,
    command_at,
    dynamics,
    further,
    invert,
    level_at,
    load_at,
    pace_of,
)

SERVO, IDEAL, PASSIVE = 0, 1, 2  # Kinds of joints: under a controller, on its command, without either


@leaf
def _law(laws, j, h, s):  # type: ignore[no-untyped-def]
    """Step the controller of joint j: fill u (as logged) and the effort that acts."""
    law, c, late = laws[j], (s.c[0, j], s.c[1, j], s.c[2, j]), 1.5 * s.v[j] - 0.5 * s.before[j]
    s.before[j] = s.v[j]  # the velocity of the scheme is half a step late
    now = (s.law[j, 0], s.law[j, 1], s.law[j, 2], s.law[j, 3], s.law[j, 4])
    s.law[j, 0], s.law[j, 1], s.law[j, 2], s.law[j, 3], s.law[j, 4] = asked(law, h, c, s.q[j], late, now)
    s.e[j], s.u[j] = c[0] - s.q[j], s.law[j, 2]
    s.act[j] = acts(law, s.late, j, s.at[0], s.u[j])


@leaf
def _slide(plant, tables, h, s):  # type: ignore[no-untyped-def]
    """Add what depends on velocity and bend to r, and its slopes to the diagonal of A."""
    for j in range(len(s.v)):
        s.pace[j] = pace_of(tables, j, s.v[j])
        s.A[j, j] += h * (plant.viscous[j] + h * plant.stiffness[j])
        s.r[j] -= plant.viscous[j] * s.v[j] + plant.stiffness[j] * (s.q[j] + h * s.v[j])
        effort, damping = further(tables, j, h, s.q[j], s.v[j], s.pace[j], s)
        s.r[j] -= effort
        s.A[j, j] += h * damping


@leaf
def _dry(tables, h, s, sweeps=12, enough=1e-9):  # type: ignore[no-untyped-def]
    """Take dry friction's impulses out of the velocities w: an axis stops or slides at the level."""
    count = len(tables.directions)
    nv = len(s.w)
    for k in range(count):
        j, p = tables.directions[k, 0], tables.directions[k, 1]
        high = level_at(tables.dry, k, 0, s.pace[j])
        low = level_at(tables.dry, k, 1, s.pace[j])
        if low > high:
            high = 0.5 * (low + high)
            low = high
        s.low[k], s.high[k] = low, high
        x = min(max(s.turn[k], low), high)
        s.turn[k] = x
        for i in range(nv):
            s.w[i] -= h * x * (s.X[i, j] + (s.X[i, p] if p >= 0 else 0.0))
    for _ in range(sweeps):
        change = 0.0
        for k in range(count):
            j, p = tables.directions[k, 0], tables.directions[k, 1]
            speed, give = s.w[j], s.X[j, j]
            if p >= 0:
                speed += s.w[p]
                give += s.X[p, p] + 2.0 * s.X[j, p]
            x = min(max(s.turn[k] + speed / (h * give), s.low[k]), s.high[k])
            d = x - s.turn[k]
            if d != 0.0:
                s.turn[k] = x
                for i in range(nv):
                    s.w[i] -= h * d * (s.X[i, j] + (s.X[i, p] if p >= 0 else 0.0))
                change = max(change, abs(d) / (abs(s.high[k]) + abs(s.low[k]) + 1e-300))
        if change < enough or count == 1:
            break


@leaf
def _hang(modes, s):  # type: ignore[no-untyped-def]
    """Put what springs pass on of their loads into r, and the loads out of A."""
    for m in range(len(modes.joint)):
        j, share = modes.joint[m], modes.share[m]
        pull = modes.pull[m, 0] * s.twist[m, 0] + modes.pull[m, 1] * s.twist[m, 1]
        for i in range(len(s.q)):
            s.A[i, j] -= share * s.M[i, j]
            s.r[i] -= share * s.M[i, j] * pull


@leaf
def _swing(modes, s):  # type: ignore[no-untyped-def]
    """Move the loads on springs by the accelerations of a step."""
    for m in range(len(modes.joint)):
        x, y, a = s.twist[m, 0], s.twist[m, 1], s.a[modes.joint[m]]
        for k in range(2):
            g = modes.step
            s.twist[m, k] = g[m, k, 0] * x + g[m, k, 1] * y + g[m, k, 2] * a


@leaf
def _forces(plant, tables, kind, command, at, h, s):  # type: ignore[no-untyped-def]
    """Fill r with what moves the joints and A with what resists, dry friction apart."""
    nv = len(s.q)
    dynamics(plant, s)
    for j in range(nv):
        drive = s.act[j] if kind[j] == SERVO else 0.0
        s.r[j] = drive + load_at(command, at[0], at[1], j) - s.h[j] - along(tables, j, s.q[j])
        for k in range(nv):
            s.A[j, k] = s.M[j, k]
    _slide(plant, tables, h, s)


@leaf
def _accelerate(tables, kind, c, h, s):  # type: ignore[no-untyped-def]
    """Steps 2 and 3: the velocities after the step, in w."""
    nv = len(s.q)
    for j in range(nv):
        if kind[j] == IDEAL:  # its motion is given: what it does to the others is known
            a = c[2, j]
            for k in range(nv):
                if k != j:
                    s.r[k] -= s.A[k, j] * a
                    s.A[k, j], s.A[j, k] = 0.0, 0.0
            s.A[j, j], s.r[j] = 1.0, a
    invert(s.A, s.X)
    for j in range(nv):
        total = 0.0
        for k in range(nv):
            total += s.X[j, k] * s.r[k]
        s.w[j] = s.v[j] + h * total
    if len(tables.directions):
        _dry(tables, h, s)
    for j in range(nv):
        s.a[j] = (s.w[j] - s.v[j]) / h


@leaf
def _inverse(plant, tables, command, row, j, s):  # type: ignore[no-untyped-def]
    """Return the effort that an axis without a controller takes for its given motion."""
    total = s.h[j] + along(tables, j, s.q[j]) + plant.viscous[j] * s.v[j] + plant.stiffness[j] * s.q[j]
    for k in range(len(s.q)):
        total += s.M[j, k] * s.a[k]
    for k in range(len(tables.speeds)):
        if tables.speeds[k] == j:
            total += level_at(tables.velocity, k, 0 if s.v[j] >= 0.0 else 1, s.pace[j])
    for k in range(len(tables.directions)):
        if tables.directions[k, 0] == j and s.v[j] != 0.0:
            total += level_at(tables.dry, k, 0 if s.v[j] > 0.0 else 1, s.pace[j])
    return total - load_at(command, row, 0.0, j)


@leaf
def _begin(kind, laws, s):  # type: ignore[no-untyped-def]
    """Wind the integrators up so that every law asks for the effort ``u``; one without begins off its command."""
    for j in range(len(s.q)):
        law, c = laws[j], (s.c[0, j], s.c[1, j], s.c[2, j])
        if kind[j] == SERVO and not np.isnan(law.offset) and law.e != 0.0:
            s.q[j] = c[0] - (s.u[j] - law.offset - (law.vr * c[1] + law.ar * c[2] - law.v * s.v[j])) / law.e
        state = begun(law, c, s.q[j], s.v[j], s.u[j])
        s.law[j, 0], s.law[j, 1], s.law[j, 2], s.law[j, 3], s.law[j, 4] = state
        s.e[j], s.before[j] = c[0] - s.q[j], s.v[j]
        for k in range(s.late.shape[1]):
            s.late[j, k] = s.u[j]


@entry
@leaf
def settle(plant, tables, kind, laws, modes, command, s):  # type: ignore[no-untyped-def]
    """Begin as the command does: no tracking error, the effort that this motion takes."""
    nv = len(s.q)
    command_at(command, (command.step, 1.0 / command.step), 0, 0.0, s.c)
    for j in range(nv):
        s.q[j] = s.c[0, j] if kind[j] != PASSIVE else s.q[j]
        s.v[j], s.a[j], s.pace[j] = s.c[1, j], s.c[2, j], pace_of(tables, j, s.c[1, j])
    for k in range(len(tables.slips)):
        s.where[k] = s.q[tables.slips[k]]
    dynamics(plant, s)
    for j in range(nv):
        s.u[j] = _inverse(plant, tables, command, 0, j, s)
    for m in range(len(modes.joint)):
        s.twist[m, 0] = s.a[modes.joint[m]] / modes.pull[m, 0]
    _begin(kind, laws, s)


@leaf
def _write(plant, kind, record, row, s):  # type: ignore[no-untyped-def]
    for j in range(len(s.q)):
        record.q[row, j], record.e[row, j], record.u[row, j] = s.q[j], s.e[j], s.u[j]
        if len(record.v):
            v = 0.5 * (s.v[j] + s.w[j])  # the velocity of the scheme is half a step late
            record.v[row, j], record.a[row, j] = v, s.a[j]
            effort = s.act[j] if kind[j] == SERVO else s.u[j]
            record.d[row, j] = (
                effort - plant.inertia[j] * s.a[j] - plant.viscous[j] * v - plant.stiffness[j] * s.q[j]
            )


@leaf
def _controllers(kind, laws, h, s):  # type: ignore[no-untyped-def]
    """Step 1 for all joints; an axis without a controller is put where its command is."""
    s.at[0] = (s.at[0] + 1) % s.late.shape[1]
    for j in range(len(s.q)):
        if kind[j] == SERVO:
            _law(laws, j, h, s)
        elif kind[j] == IDEAL:
            s.q[j], s.v[j], s.e[j] = s.c[0, j], s.c[1, j], 0.0
        else:
            s.e[j], s.u[j] = -s.q[j], 0.0


@leaf
def _row(plant, tables, kind, command, row, s, record):  # type: ignore[no-untyped-def]
    """Write a row; return the joint whose tracking error exceeds its limit, or -1."""
    for j in range(len(s.q)):
        if kind[j] == IDEAL:
            s.u[j] = _inverse(plant, tables, command, row, j, s)
        if kind[j] == SERVO and not abs(s.e[j]) <= command.limit[j]:
            return j
    _write(plant, kind, record, row, s)
    return -1


@entry
@leaf
def run(plant, tables, kind, laws, modes, command, s, record):  # type: ignore[no-untyped-def]  # noqa: PLR0913, a kernel
    """Step through the whole command; return row and joint at which the tracking error exceeds its limit, or -1, -1."""
    n, nv = command.qr.shape
    h, interval = command.step / command.substeps, (command.step, 1.0 / command.step)
    for row in range(n):
        last = row == n - 1
        for k in range(1 if last else command.substeps):
            share = k / command.substeps
            command_at(command, interval, row - 1 if last else row, 1.0 if last else share, s.c)
            _controllers(kind, laws, h, s)
            _forces(plant, tables, kind, command, (row, share), h, s)
            _hang(modes, s)
            _accelerate(tables, kind, s.c, h, s)
            if k == 0:
                bad = _row(plant, tables, kind, command, row, s, record)
                if bad >= 0:
                    return row, bad
            _swing(modes, s)
            for j in range(nv):
                s.v[j] = s.w[j]
                s.q[j] += h * s.v[j]
    return -1, -1
