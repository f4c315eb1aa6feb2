"""The records that the kernel works on: named tuples of arrays, which numba takes as they are."""

from __future__ import annotations

from typing import NamedTuple

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual.rigid import Pose


class Axes(NamedTuple):
    """Parameters of the machine beside its tree; ``na`` axes."""

    joint: Ints  # joint that each motor drives, shape (na,)
    P: Floats  # parameter table, shape (na, N_COLUMNS)
    ripple: Floats  # ripple table, shape (na, k, N_RIPPLE)
    table: Floats  # position-dependent effort on an even grid, shape (na, m)
    grid: Floats  # first position and inverse spacing of that grid, shape (na, 2)
    sprung: Ints  # joints with a spring, shape (ns,)
    springs: Floats  # their table, shape (ns, N_SPRING)
    coupled: int  # 0 removes inertial coupling between joints of different groups
    group: Ints  # axis to which each joint belongs, shape (nv,)


class Drive(NamedTuple):
    """What happens to the machine from outside, per control period; ``n`` periods."""

    qr: Floats  # command, shape (n, na); vr and ar its derivatives
    vr: Floats
    ar: Floats
    encoder: Floats  # noise of the position reading [m or rad], shape (n, na)
    chatter: Floats  # standard normal numbers, shape (n or 1, na)
    body: Ints  # bodies under load, shape (nl,)
    point: Floats  # where, in the body's joint frame [m], shape (nl, 3)
    load: Floats  # world-axes loads at mid-period, shape (n, nl, 6)


class State(NamedTuple):
    """State of plant and controllers; changed by :func:`run`."""

    q: Floats  # joint positions, shape (nv,); v velocities, a last accelerations
    v: Floats
    a: Floats
    qm: Floats  # motor positions in joint units, shape (na,); vm velocities
    vm: Floats
    z: Floats  # states of friction, shape (na, N_STATES) (:mod:`~pinotwin.virtual.columns`)
    zs: Floats  # deflection of the springs' own bristles, shape (ns,)
    u: Floats  # actual motor effort, shape (na,)
    f: Floats  # friction, shape (na,)
    control: Floats  # controllers, shape (na, 3)
    queue: Floats  # efforts under way, shape (na, MAX_DELAY)
    tick: Ints  # number of the next control period, shape (1,)


class Room(NamedTuple):
    """Scratch arrays of :func:`~pinotwin.virtual.kernel.run`."""

    pose: Pose
    M: Floats
    inverse: Floats
    bias: Floats
    tau: Floats
    qh: Floats
    vh: Floats
    extra: Floats
    target: Floats


class Record(NamedTuple):
    """What :func:`run` writes down, every ``every`` periods."""

    every: int  # control periods per row
    reading: Floats  # encoder readings, shape (m, na)
    effort: Floats  # motor efforts, shape (m, na)
    friction: Floats  # friction efforts, shape (m, na)
    q: Floats  # joint positions, shape (m, nv); likewise v and a
    v: Floats
    a: Floats
