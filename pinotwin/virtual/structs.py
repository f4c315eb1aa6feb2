"""The records that the kernel works on: named tuples of arrays, which numba takes as they are."""

from __future__ import annotations

from typing import NamedTuple

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual.rigid import Pose


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
        coupled: 0 removes inertial coupling between joints of different groups.
        group: axis to which each joint belongs, shape (nv,).
    """

    joint: Ints
    P: Floats
    ripple: Floats
    table: Floats
    grid: Floats
    sprung: Ints
    springs: Floats
    coupled: int
    group: Ints


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
        z: states of friction, shape (na, N_STATES) (:mod:`~pinotwin.virtual.columns`).
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
    """Scratch arrays of :func:`~pinotwin.virtual.kernel.run`."""

    pose: Pose
    M: Floats
    inverse: Floats
    bias: Floats
    tau: Floats
    qh: Floats
    vh: Floats
    still: Floats
    extra: Floats
    target: Floats


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
