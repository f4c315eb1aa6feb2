"""The simulation kernel: controllers, drives, friction and rigid bodies, one control period after another.

Rates: the controller runs every ``period``. Rigid-body terms M(q) and h(q, v), ripple and tables change
slowly and are evaluated ``updates`` times a period at the predicted midpoint (second order in time).
Everything stiff (bristles, transmission, springs, current loop) runs on ``substeps`` of each update by
drift-kick-drift (Strang 1968, doi:10.1137/0705041).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual import columns as c
from pinotwin.virtual.control import control_step
from pinotwin.virtual.friction import friction_force
from pinotwin.virtual.mass import invert, mass_matrix
from pinotwin.virtual.rigid import (
    Pose,
    Tree,
    apply_load,
    body_forces,
    joint_efforts,
    move,
    place,
    place_in_world,
)


class Axes(NamedTuple):
    """Parameters of the machine beside its tree; ``na`` axes.

    Attributes:
        joint: joint that each motor drives, shape (na,).
        P: parameter table, shape (na, N_COLUMNS).
        ripple: ripple table, shape (na, k, N_RIPPLE).
        table: position-dependent effort on an even grid, shape (na, m).
        grid: first position and inverse spacing of that grid, shape (na, 2).
        sprung: joints with a spring, shape (ns,).
        springs: their table, shape (ns, N_SPRING).
        coupled: 0 removes inertial coupling between the joints.
    """

    joint: Ints
    P: Floats
    ripple: Floats
    table: Floats
    grid: Floats
    sprung: Ints
    springs: Floats
    coupled: int


class Drive(NamedTuple):
    """What happens to the machine from outside, per control period; ``n`` periods.

    Attributes:
        qr: command, shape (n, na); ``vr`` and ``ar`` its derivatives.
        vr: commanded velocity.
        ar: commanded acceleration.
        encoder: noise of the position reading [m or rad], shape (n, na).
        chatter: standard normal numbers, shape (n or 1, na).
        body: bodies under load, shape (nl,).
        point: where, in the body's joint frame [m], shape (nl, 3).
        load: world-axes loads at mid-period, shape (n, nl, 6).
    """

    qr: Floats
    vr: Floats
    ar: Floats
    encoder: Floats
    chatter: Floats
    body: Ints
    point: Floats
    load: Floats


class State(NamedTuple):
    """State of plant and controllers; changed by :func:`run`.

    Attributes:
        q: joint positions, shape (nv,); ``v`` velocities, ``a`` last accelerations.
        v: joint velocities.
        a: joint accelerations.
        qm: motor positions in joint units, shape (na,); ``vm`` velocities.
        vm: motor velocities.
        z: bristles, shape (na, 4).
        zs: deflection of the springs' own bristles, shape (ns,).
        u: actual motor effort, shape (na,).
        f: friction, shape (na,).
        control: controllers, shape (na, 3).
        queue: efforts under way, shape (na, MAX_DELAY).
        tick: number of the next control period, shape (1,).
    """

    q: Floats
    v: Floats
    a: Floats
    qm: Floats
    vm: Floats
    z: Floats
    zs: Floats
    u: Floats
    f: Floats
    control: Floats
    queue: Floats
    tick: Ints


class Room(NamedTuple):
    """Scratch arrays of :func:`run`."""

    pose: Pose
    M: Floats
    W: Floats
    inverse: Floats
    bias: Floats
    tau: Floats
    qh: Floats
    vh: Floats
    still: Floats


class Record(NamedTuple):
    """What :func:`run` writes down, every ``every`` periods.

    Attributes:
        every: control periods per row.
        reading: encoder readings, shape (m, na).
        effort: motor efforts, shape (m, na).
        friction: friction efforts, shape (m, na).
        q: joint positions, shape (m, nv); likewise ``v`` and ``a``.
        v: joint velocities.
        a: joint accelerations.
    """

    every: int
    reading: Floats
    effort: Floats
    friction: Floats
    q: Floats
    v: Floats
    a: Floats


@njit(cache=True)
def read_encoder(P, motor, load, noise):  # type: ignore[no-untyped-def]
    """Return what the encoder of an axis says."""
    q = load if P[c.LOAD_ENCODER] > 0.5 else motor
    reading = q * (1.0 + P[c.PITCH]) + noise
    if P[c.ERROR] != 0.0:
        reading += P[c.ERROR] * np.sin(P[c.ERROR_RATE] * q + P[c.ERROR_PHASE])
    step = P[c.RESOLUTION]
    return step * np.floor(reading / step + 0.5) if step > 0.0 else reading


@njit(cache=True)
def position_effort(axes, i, q, v, time):  # type: ignore[no-untyped-def]
    """Return ripple plus table of one axis [N or N·m]."""
    effort = 0.0
    for k in range(axes.ripple.shape[1]):
        r = axes.ripple[i, k]
        if r[c.AMPLITUDE] == 0.0:
            continue
        angle = 2.0 * np.pi * r[c.RATE] * time if r[c.RATE] > 0.0 else r[c.WAVE] * q
        wave = r[c.AMPLITUDE] * np.sin(angle + r[c.PHASE])
        if r[c.MODULATION] != 0.0:
            wave *= 1.0 + r[c.MODULATION] * abs(np.sin(q + r[c.MODULATION_PHASE]))
        if r[c.SPEED] > 0.0:
            wave *= abs(v) / r[c.SPEED]
        effort += wave
    table = axes.table[i]
    x = (q - axes.grid[i, 0]) * axes.grid[i, 1]
    k = int(np.floor(x))
    if axes.grid[i, 1] > 0.0 and 1 <= k < len(table) - 2:
        s = x - k  # Catmull-Rom: smooth between the grid points, unlike a hat-function table
        p0, p1, p2, p3 = table[k - 1], table[k], table[k + 1], table[k + 2]
        curve = (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) + (3.0 * (p1 - p2) + p3 - p0) * s
        effort += p1 + 0.5 * s * (p2 - p0 + s * curve)
    return effort


@njit(cache=True)
def rigid_update(tree, axes, room, s, drive, k, time, half):  # type: ignore[no-untyped-def]
    """Fill ``room.inverse`` and ``room.bias`` at the midpoint of the coming update."""
    nv = len(s.q)
    for i in range(nv):
        room.qh[i] = s.q[i] + half * (s.v[i] + 0.5 * half * s.a[i])
        room.vh[i] = (s.v[i] + half * s.a[i]) * axes.coupled
    place(tree, room.qh, room.pose)
    move(tree, room.vh, room.still, room.pose)
    body_forces(tree, room.pose)
    if len(drive.body) > 0:
        place_in_world(tree, room.pose)
        for m in range(len(drive.body)):
            apply_load(room.pose, drive.body[m], drive.point[m], drive.load[k, m])
    joint_efforts(tree, room.pose, room.bias)
    mass_matrix(tree, room.pose, room.M)
    if axes.coupled == 0:
        for i in range(nv):
            for j in range(nv):
                if i != j:
                    room.M[i, j] = 0.0
    invert(room.M, room.W, room.inverse)
    for i in range(len(axes.joint)):
        j = axes.joint[i]
        v = s.v[j] + half * s.a[j]
        room.bias[j] += position_effort(axes, i, room.qh[j], v, time + half)


@njit(cache=True)
def motor_step(P, i, j, s, tau, extra, dt):  # type: ignore[no-untyped-def]
    """Add what one axis does to the joint efforts; moves the motor if the drive is flexible."""
    warmth, noise = extra
    if P[c.FLEXIBLE] < 0.5:
        s.f[i] = friction_force(P, s.q[j], s.v[j], s.z[i], s.u[i] - s.f[i], warmth, noise, dt)
        tau[j] += s.u[i] - s.f[i]
        return
    twist, gap = s.qm[i] - s.q[j], P[c.BACKLASH]
    touch = 1.0
    if gap > 0.0:
        touch = 1.0 if abs(twist) > gap else 0.0
        twist -= min(max(twist, -gap), gap)
    spring = P[c.SPRING] * twist + touch * P[c.DAMPER] * (s.vm[i] - s.v[j])
    if gap > 0.0 and spring * twist < 0.0:
        spring = 0.0  # faces in contact push, they do not pull
    share = P[c.LOAD_FRICTION]
    s.f[i] = friction_force(P, s.qm[i], s.vm[i], s.z[i], spring, warmth, noise, dt)
    tau[j] += spring - share * s.f[i]
    s.vm[i] += dt * P[c.INV_ROTOR] * (s.u[i] - spring - (1.0 - share) * s.f[i])


@njit(cache=True)
def spring_efforts(axes, s, tau, dt):  # type: ignore[no-untyped-def]
    """Add the springs, dampers and bristles of the passive joints to the joint efforts."""
    for m in range(len(axes.sprung)):
        j, S = axes.sprung[m], axes.springs[m]
        q, v = s.q[j], s.v[j]
        tau[j] -= S[c.STIFFNESS] * q + S[c.HARDENING] * q * q * q + S[c.DAMPING] * v
        if S[c.SLIP_LEVEL] > 0.0:  # Dahl: builds up over a deflection, whatever the speed
            steady = np.sign(v) * S[c.SLIP_LEVEL] / S[c.SLIP_STIFFNESS]
            rate = abs(v) * S[c.SLIP_STIFFNESS] / S[c.SLIP_LEVEL]
            s.zs[m] = steady + (s.zs[m] - steady) * np.exp(-rate * dt)
            tau[j] -= S[c.SLIP_STIFFNESS] * s.zs[m]


@njit(cache=True)
def plant_step(axes, room, s, target, extra, dt):  # type: ignore[no-untyped-def]
    """Advance the plant by one substep towards the commanded efforts ``target``, shape (na,)."""
    nv, na = len(s.q), len(axes.joint)
    for j in range(nv):
        s.q[j] += 0.5 * dt * s.v[j]
        room.tau[j] = -room.bias[j]
    for i in range(na):
        P, j = axes.P[i], axes.joint[i]
        s.u[i] += P[c.U_ALPHA] * (target[i] - s.u[i])
        s.qm[i] += 0.5 * dt * s.vm[i]
        motor_step(P, i, j, s, room.tau, (extra[0, i], extra[1, i]), dt)
    spring_efforts(axes, s, room.tau, dt)
    for j in range(nv):
        acceleration = 0.0
        for m in range(nv):
            acceleration += room.inverse[j, m] * room.tau[m]
        s.a[j] = acceleration
    for j in range(nv):
        s.v[j] += dt * s.a[j]
        s.q[j] += 0.5 * dt * s.v[j]
    for i in range(na):
        if axes.P[i, c.FLEXIBLE] > 0.5:
            s.qm[i] += 0.5 * dt * s.vm[i]
        else:
            s.qm[i], s.vm[i] = s.q[axes.joint[i]], s.v[axes.joint[i]]


@njit(cache=True)
def control_all(axes, drive, s, record, k, period):  # type: ignore[no-untyped-def]
    """Read the encoders, run the controllers, write down a row; returns the effort commands."""
    na, tick = len(axes.joint), s.tick[0]
    target = np.empty(na)
    write = tick % record.every == 0
    row = k // record.every
    for i in range(na):
        P, j = axes.P[i], axes.joint[i]
        reading = read_encoder(P, s.qm[i], s.q[j], drive.encoder[k, i])
        if write:
            record.reading[row, i] = reading
            record.effort[row, i] = s.u[i]
            record.friction[row, i] = s.f[i]
        u = control_step(
            P, s.control[i], drive.qr[k, i], drive.vr[k, i], drive.ar[k, i], reading, period
        )
        late = int(P[c.DELAY])
        s.queue[i, tick % c.MAX_DELAY] = u
        target[i] = s.queue[i, (tick - late) % c.MAX_DELAY]
    if write:
        record.q[row, :] = s.q
        record.v[row, :] = s.v
        record.a[row, :] = s.a
    return target


@njit(cache=True)
def run(tree, axes, drive, state, room, record, timing):  # type: ignore[no-untyped-def]
    """Run the machine through all control periods of ``drive``.

    Args:
        tree: rigid bodies.
        axes: the rest of the machine.
        drive: what happens to it.
        state: where it starts; left where it ends.
        room: scratch.
        record: filled, one row every ``record.every`` periods.
        timing: control period [s], updates per period, substeps per update.
    """
    period, updates, substeps = timing
    na = len(axes.joint)
    h = period / updates
    dt = h / substeps
    extra = np.zeros((2, na))
    for k in range(len(drive.qr)):
        time = state.tick[0] * period
        target = control_all(axes, drive, state, record, k, period)
        for i in range(na):
            P = axes.P[i]
            if P[c.WARMING] != 0.0:
                extra[0, i] = 1.0 - np.exp(-time / P[c.WARMING_TIME])
            extra[1, i] = drive.chatter[k % len(drive.chatter), i]
        for u in range(updates):
            rigid_update(tree, axes, room, state, drive, k, time + u * h, 0.5 * h)
            for _ in range(substeps):
                plant_step(axes, room, state, target, extra, dt)
        state.tick[0] += 1
