"""What the stepping kernel works on: plain arrays in named tuples, which compiled code can take."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints


class Parts(NamedTuple):
    """What the disturbance is made of.

    Attributes:
        revolute: of the tape, and so on, see :class:`pinotwin.dynamics.tape.Tape`.
        ops: operations.
        sign: signs.
        mass: entries of M.
        bias: entries of h.
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


class Modes(NamedTuple):
    """Loads that hang on joints by springs, at one internal step; one row each.

    Attributes:
        joint: that a load hangs on, shape (m,).
        share: of the joint's inertia that it is, shape (m,).
        pull: stiffness and damping over the load's mass, shape (m, 2).
        step: how twist and its rate go on in a step, and what an acceleration of the joint adds, shape (m, 2, 3).
    """

    joint: Ints
    share: Floats
    pull: Floats
    step: Floats


class State(NamedTuple):
    """Where the machine is, and room for a step; changed by the kernels. Shapes (nv,) unless said otherwise.

    Attributes:
        q: position; likewise velocity ``v``, acceleration ``a``, tracking error ``e``, effort ``u``.
        before: velocity at the last step.
        w: velocity after the step.
        act: effort that acts, after the dead time.
        d: disturbance of the loops, and ``old`` at the last step.
        vr0: velocity of the command at the last step.
        pace: place of each joint's speed in the tables over speed.
        h: bias effort, with ``r`` all that moves a joint.
        M: mass matrix, with A the matrix of a step and X its inverse, shape (nv, nv).
        x: states of the loops' blocks, shape (blocks, 2).
        y: e, e', e'', u of the blocks of one joint, shape (4,).
        law: states of the controllers, shape (nv, 5).
        late: efforts of the last steps, shape (nv, late), and in ``at`` where the last one is.
        turn: direction, or effort, of each dry-friction element, between ``low`` and ``high``, shape (k,).
        bend: bend of the slip elements and, last, of the bristle, shape (m, 7).
        where: position of each slip element's joint at the last step, shape (m,).
        one: effort, damping and stiffness of the element last moved, shape (3,).
        twist: of loads on springs and its rate, shape (modes, 2).
        c: command now and its two derivatives, shape (3, nv).
        t: values of the tape.
    """

    q: Floats
    v: Floats
    a: Floats
    e: Floats
    u: Floats
    before: Floats
    w: Floats
    act: Floats
    d: Floats
    old: Floats
    vr0: Floats
    pace: Floats
    h: Floats
    r: Floats
    M: Floats
    A: Floats
    X: Floats
    x: Floats
    y: Floats
    law: Floats
    late: Floats
    at: Ints
    turn: Floats
    low: Floats
    high: Floats
    bend: Floats
    where: Floats
    one: Floats
    twist: Floats
    c: Floats
    t: Floats


def at_rest(tables: Lookup, t: Floats, *, blocks: int = 0, late: int = 0, modes: int = 0) -> State:
    """Return a machine at rest at zero, with room for blocks, late efforts and loads on springs; t of the tape."""
    nv, dry, slips = len(tables.slowness), len(tables.directions), len(tables.slips)
    shapes: dict[str, int | tuple[int, ...]] = dict.fromkeys(State._fields, nv)
    shapes |= dict.fromkeys(("M", "A", "X"), (nv, nv)) | dict.fromkeys(("turn", "low", "high"), dry)
    shapes |= {"x": (blocks, 2), "y": 4, "law": (nv, 5), "late": (nv, late), "twist": (modes, 2)}
    shapes |= {"bend": (slips, tables.give.shape[1] + 1), "where": slips, "one": 3, "c": (3, nv)}
    arrays: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
    return State(**{**arrays, "at": np.zeros(1, dtype=np.int64), "t": t})


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


def records(n: int, nv: int, full: bool) -> Record:
    """Return arrays for the results."""
    return Record(*(np.zeros((n if full or k < 3 else 0, nv)) for k in range(6)))
