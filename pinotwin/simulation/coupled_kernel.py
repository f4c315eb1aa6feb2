"""The stepping loop of the coupled machine: identified controllers around the identified plant.

One internal step h, semi-implicit (symplectic) Euler, which is late by nothing between effort and
position:

    1  u      from e, v, vr, ar by the law of each axis (:mod:`pinotwin.loop.servo`), lags exactly
    2  A dv   = h (u_late - h(q, v) - position - velocity's effort - K (q + h v) + load),
                A = M(q) + h C + h² K, with the slopes of what depends on velocity and bend in C and K
    3  dry friction: impulses that stop an axis, none larger than its level (projected Gauss-Seidel)
    4  v += dv,  q += h v

A load that hangs on joint j by a spring (a share s of its inertia, twist x with x'' = a_j - f, f = w^2 x + 2 zeta w x')
takes s M_ij a_j off step 2 and puts s M_ij f there instead, at every joint i.

Dry friction solved for inside the step holds an axis at rest as it is; the integrator winds up against
it. So whatever the gains, friction takes energy out and never puts any in.
"""

from __future__ import annotations

import numpy as np

from pinotwin.dynamics.stepping import entry, gather, leaf, replay
from pinotwin.simulation.axis_kernel import bend, shown
from pinotwin.simulation.kernel import _command, _cubic
from pinotwin.simulation.lookup import along, level_at

SERVO, IDEAL, PASSIVE = 0, 1, 2
SWEEPS = 12
ENOUGH = 1e-9


@leaf
def _law(servos, j, c, h, s):  # type: ignore[no-untyped-def]
    """Step the controller of joint j: fill u (as logged) and the effort that acts."""
    e = c[0, j] - shown(s.q[j], servos.tick[j], servos.origin[j])
    v = 1.5 * s.v[j] - 0.5 * s.before[j]  # the velocity of the scheme is half a step late
    s.before[j] = s.v[j]
    s.seen[j] += servos.see[j] * (v - s.seen[j])
    g = servos.gains
    u = g[j, 0] * e + s.wound[j] - g[j, 2] * s.seen[j] + g[j, 3] * c[1, j] + g[j, 5] * c[2, j]
    if servos.notched[j] == 1:
        b = servos.notch
        y = b[j, 0] * u + s.past[j, 0]
        s.past[j, 0] = b[j, 1] * u - b[j, 3] * y + s.past[j, 1]
        s.past[j, 1] = b[j, 2] * u - b[j, 4] * y
        u = y
    limit = servos.limit[j]
    if abs(u) <= limit:
        s.wound[j] += h * (g[j, 1] * e + g[j, 4] * c[1, j])
    else:
        u = limit if u > 0.0 else -limit
    s.out[j] += servos.lag[j] * (u - s.out[j])
    s.e[j], s.u[j] = c[0, j] - s.q[j], s.out[j]
    n = s.late.shape[1]
    at = s.at[0]
    s.late[j, at] = s.out[j]
    i = at - servos.whole[j]
    new, old = s.late[j, i % n], s.late[j, (i - 1) % n]
    s.act[j] = new + servos.part[j] * (old - new)


@leaf
def _slide(plant, tables, h, s):  # type: ignore[no-untyped-def]
    """Add what depends on velocity and bend to r, and its slopes to the diagonal of A."""
    n = float(tables.velocity.shape[2] - 1)
    for j in range(len(s.v)):
        share = abs(s.v[j]) * tables.slowness[j]
        s.pace[j] = n * np.sqrt(share) if share < 1.0 else n
        s.A[j, j] += h * (plant.viscous[j] + h * plant.stiffness[j])
        s.r[j] -= plant.viscous[j] * s.v[j] + plant.stiffness[j] * (s.q[j] + h * s.v[j])
    for k in range(len(tables.speeds)):
        j = tables.speeds[k]
        side = 0 if s.v[j] >= 0.0 else 1
        effort = level_at(tables.velocity, k, side, s.pace[j])
        s.r[j] -= effort
        if abs(s.v[j]) > 1e-12:
            s.A[j, j] += h * max(effort / s.v[j], 0.0)
    for k in range(len(tables.slips)):
        j = tables.slips[k]
        bend(tables, k, s.q[j], s.v[j], s.pace[j], s)
        s.r[j] -= s.one[0] + h * s.one[2] * s.v[j]
        s.A[j, j] += h * (s.one[1] + h * s.one[2])


@leaf
def _invert(A, X):  # type: ignore[no-untyped-def]
    """Fill X with the inverse of A, which is symmetric and positive but for loads on springs; A is used up."""
    n = len(A)
    for i in range(n):
        for k in range(n):
            X[i, k] = 1.0 if i == k else 0.0
    for i in range(n):
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
def _dry(tables, h, s):  # type: ignore[no-untyped-def]
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
    for _ in range(SWEEPS):
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
        if change < ENOUGH or count == 1:
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
def _forces(plant, tables, servos, command, at, h, s):  # type: ignore[no-untyped-def]
    """Fill r with what moves the joints and A with what resists, dry friction apart."""
    nv, row, share = len(s.q), at[0], at[1]
    replay(plant.revolute, plant.ops, plant.sign, s.q, s.v, s.t)
    gather(plant.mass, plant.bias, s.t, s.M, s.h)
    constant = len(command.load) == 1
    for j in range(nv):
        load = command.load[0 if constant else row, j]
        if not constant and share > 0.0:
            load += share * (command.load[row + 1, j] - load)
        push = s.act[j] if servos.kind[j] == SERVO else 0.0
        s.r[j] = push + load - s.h[j] - along(tables, j, s.q[j])
        for k in range(nv):
            s.A[j, k] = s.M[j, k]
    _slide(plant, tables, h, s)


@leaf
def _accelerate(tables, servos, c, h, s):  # type: ignore[no-untyped-def]
    """Steps 2 and 3: the velocities after the step, in w."""
    nv = len(s.q)
    for j in range(nv):
        if servos.kind[j] == IDEAL:  # its motion is given: what it does to the others is known
            a = c[2, j]
            for k in range(nv):
                if k != j:
                    s.r[k] -= s.A[k, j] * a
                    s.A[k, j], s.A[j, k] = 0.0, 0.0
            s.A[j, j], s.r[j] = 1.0, a
    _invert(s.A, s.X)
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
    return total - command.load[0 if len(command.load) == 1 else row, j]


@leaf
def begin(servos, c, s):  # type: ignore[no-untyped-def]
    """Wind the integrators up so that every law asks for the effort ``u`` at the present state.

    A law without an integral cannot: its axis begins as far from the command as the effort asks for.
    """
    g = servos.gains
    for j in range(len(s.q)):
        law = g[j, 3] * c[1, j] + g[j, 5] * c[2, j] - g[j, 2] * s.v[j]
        if servos.kind[j] == SERVO and not np.isnan(servos.offset[j]) and g[j, 0] != 0.0:
            s.wound[j] = servos.offset[j]
            s.q[j] = c[0, j] - (s.u[j] - law - s.wound[j]) / g[j, 0]
        else:
            e = c[0, j] - shown(s.q[j], servos.tick[j], servos.origin[j])
            s.wound[j] = s.u[j] - law - g[j, 0] * e
        s.seen[j], s.out[j], s.e[j] = s.v[j], s.u[j], c[0, j] - s.q[j]
        s.before[j] = s.v[j]
        b = servos.notch
        s.past[j, 0] = s.u[j] * (1.0 - b[j, 0])
        s.past[j, 1] = s.u[j] * (b[j, 2] - b[j, 4])
        for k in range(s.late.shape[1]):
            s.late[j, k] = s.u[j]


@entry
@leaf
def settle(plant, tables, servos, modes, command, s):  # type: ignore[no-untyped-def]
    """Begin as the command does: no tracking error, the effort that this motion takes."""
    nv = len(s.q)
    _cubic(command, 0, s.p)
    _command(s.p, 1.0 / command.step, 0.0, s.c)
    for j in range(nv):
        s.q[j] = s.c[0, j] if servos.kind[j] != PASSIVE else s.q[j]
        s.v[j] = s.c[1, j]
        s.a[j] = s.c[2, j]
        for k in range(len(tables.slips)):
            if tables.slips[k] == j:
                s.where[k] = s.q[j]
    replay(plant.revolute, plant.ops, plant.sign, s.q, s.v, s.t)
    gather(plant.mass, plant.bias, s.t, s.M, s.h)
    n = float(tables.velocity.shape[2] - 1)
    for j in range(nv):
        share = abs(s.v[j]) * tables.slowness[j]
        s.pace[j] = n * np.sqrt(share) if share < 1.0 else n
    for j in range(nv):
        s.u[j] = _inverse(plant, tables, command, 0, j, s)
    for m in range(len(modes.joint)):
        s.twist[m, 0] = s.a[modes.joint[m]] / modes.pull[m, 0]
    begin(servos, s.c, s)


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
def _controllers(servos, h, s):  # type: ignore[no-untyped-def]
    """Step 1 for all joints; an axis without a controller is put where its command is."""
    s.at[0] = (s.at[0] + 1) % s.late.shape[1]
    for j in range(len(s.q)):
        if servos.kind[j] == SERVO:
            _law(servos, j, s.c, h, s)
        elif servos.kind[j] == IDEAL:
            s.q[j], s.v[j], s.e[j] = s.c[0, j], s.c[1, j], 0.0
        else:
            s.e[j], s.u[j] = -s.q[j], 0.0


@leaf
def _row(plant, tables, servos, command, row, s, record):  # type: ignore[no-untyped-def]
    """Write a row; return the joint whose tracking error exceeds its limit, or -1."""
    for j in range(len(s.q)):
        if servos.kind[j] == IDEAL:
            s.u[j] = _inverse(plant, tables, command, row, j, s)
        if servos.kind[j] == SERVO and not abs(s.e[j]) <= command.limit[j]:
            return j
    _write(plant, servos.kind, record, row, s)
    return -1


@entry
@leaf
def run(plant, tables, servos, modes, command, s, record):  # type: ignore[no-untyped-def]
    """Step through the whole command from the state ``s``.

    Returns:
        Row and joint at which the tracking error exceeded its limit, or (-1, -1).
    """
    n, nv = command.qr.shape
    h, rate = command.step / command.substeps, 1.0 / command.step
    for row in range(n):
        last = row == n - 1
        if not last:
            _cubic(command, row, s.p)
        for k in range(1 if last else command.substeps):
            share = k / command.substeps
            _command(s.p, rate, 1.0 if last else share, s.c)
            _controllers(servos, h, s)
            _forces(plant, tables, servos, command, (row, share), h, s)
            _hang(modes, s)
            _accelerate(tables, servos, s.c, h, s)
            if k == 0:
                bad = _row(plant, tables, servos, command, row, s, record)
                if bad >= 0:
                    return row, bad
            _swing(modes, s)
            for j in range(nv):
                s.v[j] = s.w[j]
                s.q[j] += h * s.v[j]
    return -1, -1
