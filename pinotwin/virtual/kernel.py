"""The simulation kernel: controllers, drives, friction and rigid bodies, period after period.

M(q), h(q, v), ripple and tables are evaluated ``updates`` times a period at the predicted midpoint (second order in
time); everything stiff runs on ``substeps`` of each, drift-kick-drift (Strang 1968, doi:10.1137/0705041).
"""

from __future__ import annotations

import numpy as np

from pinotwin.virtual import columns as c
from pinotwin.virtual.columns import kernel
from pinotwin.virtual.control import control_step
from pinotwin.virtual.friction import friction_force, steady_force
from pinotwin.virtual.rigid import apply_load, fold, invert, move, place


@kernel
def read_encoder(P, i, motor, load, noise):  # type: ignore[no-untyped-def]
    """Return what the encoder of an axis says."""
    q = load if P[i, c.LOAD_ENCODER] > 0.5 else motor
    reading = q * (1.0 + P[i, c.PITCH]) + noise
    if P[i, c.ERROR] != 0.0:
        reading += P[i, c.ERROR] * np.sin(P[i, c.ERROR_RATE] * q + P[i, c.ERROR_PHASE])
    step = P[i, c.RESOLUTION]
    return step * np.floor(reading / step + 0.5) if step > 0.0 else reading


@kernel
def position_effort(r, table, grid, i, q, v, time):  # type: ignore[no-untyped-def]
    """Return ripple plus table of one axis [N or N·m]."""
    effort = 0.0
    for k in range(r.shape[1]):
        if r[i, k, c.AMPLITUDE] == 0.0:
            continue
        rate = r[i, k, c.RATE]
        angle = 2.0 * np.pi * rate * time if rate > 0.0 else r[i, k, c.WAVE] * q
        wave = r[i, k, c.AMPLITUDE] * np.sin(angle + r[i, k, c.PHASE])
        if r[i, k, c.MODULATION] != 0.0:
            wave *= 1.0 + r[i, k, c.MODULATION] * abs(np.sin(q + r[i, k, c.MODULATION_PHASE]))
        if r[i, k, c.SPEED] > 0.0:
            wave *= abs(v) / r[i, k, c.SPEED]
        effort += wave
    x = (q - grid[i, 0]) * grid[i, 1]
    m = int(np.floor(x))
    if grid[i, 1] > 0.0 and 1 <= m < table.shape[1] - 2:
        y = x - m  # Catmull-Rom: smooth between the grid points, unlike a table of hat functions
        p0, p1, p2, p3 = table[i, m - 1], table[i, m], table[i, m + 1], table[i, m + 2]
        curve = (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) + (3.0 * (p1 - p2) + p3 - p0) * y
        effort += p1 + 0.5 * y * (p2 - p0 + y * curve)
    return effort


@kernel
def rigid_update(tree, axes, room, s, drive, k, moment):  # type: ignore[no-untyped-def]
    """Fill ``room.inverse`` and ``bias`` mid-update: row ``k`` of ``drive``, ``moment``: its start, half length [s]."""
    time, half = moment
    q, v, a, qh, vh, M, bias = s.q, s.v, s.a, room.qh, room.vh, room.M, room.bias
    joint, ripple, table, grid, nv = axes.joint, axes.ripple, axes.table, axes.grid, len(s.q)
    for i in range(nv):
        qh[i] = q[i] + half * (v[i] + 0.5 * half * a[i])
        vh[i] = (v[i] + half * a[i]) * axes.coupled
    place(tree, qh, room.pose)
    move(tree, vh, room.pose)
    for m in range(len(drive.body)):
        apply_load(room.pose, drive.body[m], drive.point[m], drive.load[k, m])
    fold(tree, room.pose, bias, M)
    if axes.coupled == 0:
        for i in range(nv):
            for j in range(nv):
                M[i, j] *= axes.group[i] == axes.group[j]
    invert(M, room.inverse)
    for i in range(len(joint)):
        j = joint[i]
        rate = v[j] + half * a[j]
        bias[j] += position_effort(ripple, table, grid, i, qh[j], rate, time + half)


@kernel
def transmit(P, i, twist, rate):  # type: ignore[no-untyped-def]
    """Return the effort that a flexible transmission passes on, for a twist (motor less load) and its rate."""
    gap = P[i, c.BACKLASH]
    if gap == 0.0:
        return P[i, c.SPRING] * twist + P[i, c.DAMPER] * rate
    if abs(twist) <= gap:
        return 0.0
    depth = twist - gap if twist > 0.0 else twist + gap
    push = P[i, c.SPRING] * depth + P[i, c.DAMPER] * rate
    return push if push * depth > 0.0 else 0.0  # faces in contact push, they do not pull


@kernel
def spring_efforts(axes, s, tau, dt):  # type: ignore[no-untyped-def]
    """Add the springs, dampers and bristles of the passive joints to the joint efforts."""
    S, sprung, zs = axes.springs, axes.sprung, s.zs
    for m in range(len(sprung)):
        j = sprung[m]
        q, v = s.q[j], s.v[j]
        tau[j] -= S[m, c.STIFFNESS] * q + S[m, c.HARDENING] * q * q * q + S[m, c.DAMPING] * v
        if S[m, c.SLIP_LEVEL] > 0.0:  # Dahl: builds up over a deflection, whatever the speed
            steady = np.sign(v) * S[m, c.SLIP_LEVEL] / S[m, c.SLIP_STIFFNESS]
            rate = abs(v) * S[m, c.SLIP_STIFFNESS] / S[m, c.SLIP_LEVEL]
            zs[m] = steady + (zs[m] - steady) * np.exp(-rate * dt)
            tau[j] -= S[m, c.SLIP_STIFFNESS] * zs[m]


@kernel
def plant_steps(axes, room, s, target, extra, dt, substeps):  # type: ignore[no-untyped-def]
    """Advance the plant by some substeps towards the commanded efforts ``target``, shape (na,)."""
    P, joint = axes.P, axes.joint
    q, v, a, qm, vm, u, f, z = s.q, s.v, s.a, s.qm, s.vm, s.u, s.f, s.z
    bias, tau, inverse = room.bias, room.tau, room.inverse
    nv, na, half = len(q), len(joint), 0.5 * dt
    for _ in range(substeps):
        for j in range(nv):
            q[j] += half * v[j]
            tau[j] = -bias[j]
        for i in range(na):
            j = joint[i]
            push = target[i] + P[i, c.U_MEAN] * (u[i] - target[i])
            u[i] += P[i, c.U_ALPHA] * (target[i] - u[i])
            if P[i, c.FLEXIBLE] < 0.5:
                load = push - steady_force(P, i, v[j], z)
                f[i] = friction_force(P, i, q[j], v[j], z, load, extra, dt)
                tau[j] += push - f[i]
                continue
            qm[i] += half * vm[i]
            passed = transmit(P, i, qm[i] - q[j], vm[i] - v[j])
            f[i] = friction_force(P, i, qm[i], vm[i], z, passed, extra, dt)
            tau[j] += passed
            vm[i] += dt * P[i, c.INV_ROTOR] * (push - passed - f[i])
            qm[i] += half * vm[i]
        spring_efforts(axes, s, tau, dt)
        for j in range(nv):
            acceleration = 0.0
            for m in range(nv):
                acceleration += inverse[j, m] * tau[m]
            a[j] = acceleration
        for j in range(nv):
            v[j] += dt * a[j]
            q[j] += half * v[j]
    for i in range(na):
        if P[i, c.FLEXIBLE] < 0.5:
            qm[i], vm[i] = q[joint[i]], v[joint[i]]


@kernel
def control_all(axes, drive, s, record, k, target, period):  # type: ignore[no-untyped-def]
    """Read the encoders, run the controllers and write down a row; fills the effort commands."""
    P, joint, tick, q, qm = axes.P, axes.joint, s.tick[0], s.q, s.qm
    qr, vr, ar, noise = drive.qr, drive.vr, drive.ar, drive.encoder
    control, queue, readings = s.control, s.queue, record.reading
    write, row = tick % record.every == 0, k // record.every
    for i in range(len(joint)):
        reading = read_encoder(P, i, qm[i], q[joint[i]], noise[k, i])
        if write:
            readings[row, i] = reading
        command = (qr[k, i], vr[k, i], ar[k, i])
        u = control_step(P, i, control, command, reading, period)
        queue[i, tick % c.MAX_DELAY] = u
        target[i] = queue[i, (tick - int(P[i, c.DELAY])) % c.MAX_DELAY]
    if write:
        for i in range(len(joint)):
            record.effort[row, i] = s.u[i]
            record.friction[row, i] = s.f[i]
        for j in range(len(q)):
            record.q[row, j] = q[j]
            record.v[row, j] = s.v[j]
            record.a[row, j] = s.a[j]


@kernel
def run(tree, axes, drive, state, room, record, timing):  # type: ignore[no-untyped-def]
    """Run a machine through all of ``drive``; ``timing``: control period [s], its updates, and their substeps."""
    period, updates, substeps = timing
    na, P = len(axes.joint), axes.P
    h = period / updates
    extra, target = room.extra, room.target
    for k in range(len(drive.qr)):
        time = state.tick[0] * period
        control_all(axes, drive, state, record, k, target, period)
        for i in range(na):
            if P[i, c.WARMING] != 0.0:
                extra[0, i] = 1.0 - np.exp(-time / P[i, c.WARMING_TIME])
            extra[1, i] = drive.chatter[k % len(drive.chatter), i]
        for u in range(updates):
            rigid_update(tree, axes, room, state, drive, k, (time + u * h, 0.5 * h))
            plant_steps(axes, room, state, target, extra, h / substeps, substeps)
        state.tick[0] += 1
