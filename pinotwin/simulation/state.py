"""What the stepping kernel works on: plain arrays in named tuples, which compiled code can take."""

from __future__ import annotations

from typing import NamedTuple

from pinotwin.arrays import Floats, Ints


class Parts(NamedTuple):
    """What the disturbance is made of.

    Attributes:
        revolute: of the tape, and so on, see :class:`pinotwin.dynamics.tape.Tape`.
        ops: operations.
        sign: signs.
        mass: entries of M.
        bias: entries of h.
        coupled: joints whose row of M - M_D is not zero, shape (m,).
        inertia: M_D, shape (nv,).
        viscous: C, shape (nv,).
        stiffness: K of the springs, shape (nv,).
        ground: M_D of a passive joint that counts from the ground with its axis, shape (nv,).
    """

    revolute: Ints
    ops: Ints
    sign: Floats
    mass: Ints
    bias: Ints
    coupled: Ints
    inertia: Floats
    viscous: Floats
    stiffness: Floats
    ground: Floats


class Lookup(NamedTuple):
    """Efforts of all axes as tables; see :mod:`pinotwin.simulation.tables`.

    Attributes:
        position: all position tables, one after the other.
        place: first entry and number of entries of each joint's table, shape (nv, 2).
        grid: first position and inverse spacing, shape (nv, 2).
        slowness: inverse of the largest speed of the tables, shape (nv,).
        speeds: joints with an effort of velocity, shape (h,).
        velocity: it over |v| for v >= 0 and v < 0, shape (h, 2, SPEEDS + 1).
        directions: joint of each dry-friction element, and the joint that slides with it or -1,
            shape (k, 2).
        slope: inverse of its width [s/m or s/rad], shape (k,).
        dry: g+ and g- of each, shape (k, 2, SPEEDS + 1).
        slips: joint of each presliding element, shape (m,).
        give: inverse yield displacements of its six elements, shape (m, 6).
        slip: g of each, shape (m, 1, SPEEDS + 1).
        memory: 1/x_s, play, m and d of each element's bristle, shape (m, 4).
    """

    position: Floats
    place: Ints
    grid: Floats
    slowness: Floats
    speeds: Ints
    velocity: Floats
    directions: Ints
    slope: Floats
    dry: Floats
    slips: Ints
    give: Floats
    slip: Floats
    memory: Floats


class Command(NamedTuple):
    """What is asked of the machine, one row a sample.

    Attributes:
        qr: command, shape (n, nv).
        vr: its velocity at the samples; between them the command is cubic, shape (n, nv).
        load: effort that helps the motors (external loads less effects without a table), shape (n,
            nv), or (1, nv) if constant.
        step: sampling interval [s].
        substeps: internal steps a sample.
        limit: largest tracking error before the run is stopped, shape (nv,).
    """

    qr: Floats
    vr: Floats
    load: Floats
    step: float
    substeps: int
    limit: Floats


class State(NamedTuple):
    """Where the machine is; changed by :func:`run`.

    Attributes:
        x: states of the blocks, shape (k, 2).
        d: disturbance, shape (nv,).
        q: position, shape (nv,); likewise ``v``, ``a``, ``e``, ``u``.
        v: velocity.
        a: acceleration.
        e: tracking error.
        u: effort.
        c: command now and its two derivatives, shape (3, nv).
        p: its coefficients in the present interval, shape (4, nv).
        pace: place of each joint's speed in the tables over speed, shape (nv,).
        turn: direction of each dry-friction element, shape (k,).
        before: velocity of each element's joint at the last step, shape (k,).
        bend: bend of the slip elements and, last, of the bristle, shape (m, 7).
        where: position of each slip element's joint at the last step, shape (m,).
        t: values of the tape.
        M: mass matrix, shape (nv, nv).
        h: bias effort, shape (nv,).
        y: e, e', e'', u of the blocks of one joint, shape (4,).
        old: disturbance at the last step, shape (nv,).
        vr0: velocity of the command at the last step, shape (nv,).
        r: right side of step 5, shape (nv,).
        S: its matrix, shape (nv, nv + 1).
    """

    x: Floats
    d: Floats
    q: Floats
    v: Floats
    a: Floats
    e: Floats
    u: Floats
    c: Floats
    p: Floats
    pace: Floats
    turn: Floats
    before: Floats
    bend: Floats
    where: Floats
    t: Floats
    M: Floats
    h: Floats
    y: Floats
    old: Floats
    vr0: Floats
    r: Floats
    S: Floats


class Record(NamedTuple):
    """What is written down, one row a sample; arrays of no rows are not written.

    Attributes:
        q: shape (n, nv); likewise the others.
        e: tracking error.
        u: effort.
        v: velocity.
        a: acceleration.
        d: generalised disturbance.
    """

    q: Floats
    e: Floats
    u: Floats
    v: Floats
    a: Floats
    d: Floats
