"""What the stepping kernel works on: plain arrays in named tuples, which compiled code can take."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints


class Parts(NamedTuple):
    """What the disturbance is made of."""

    revolute: Ints  # of the tape, and so on, see :class:`pinotwin.dynamics.tape.Tape`
    ops: Ints  # operations
    sign: Floats  # signs
    mass: Ints  # entries of M
    bias: Ints  # entries of h
    inertia: Floats  # M_D, shape (nv,)
    viscous: Floats  # C, shape (nv,)
    stiffness: Floats  # K of the springs, shape (nv,)
    ground: Floats  # M_D of a passive joint that counts from the ground with its axis, shape (nv,)


class Lookup(NamedTuple):
    """Efforts of all axes as tables; see :mod:`pinotwin.simulation.tables`."""

    position: Floats  # all position tables, one after the other
    place: Ints  # first entry and number of entries of each joint's table, shape (nv, 2)
    grid: Floats  # first position and inverse spacing, shape (nv, 2)
    slowness: Floats  # inverse of the largest speed of the tables, shape (nv,)
    speeds: Ints  # joints with an effort of velocity, shape (h,)
    velocity: Floats  # it over |v| for v >= 0 and v < 0, shape (h, 2, SPEEDS + 1)
    directions: Ints  # joint of each dry-friction element, and that which slides with it or -1, shape (k, 2)
    slope: Floats  # inverse of its width [s/m or s/rad], shape (k,)
    dry: Floats  # g+ and g- of each, shape (k, 2, SPEEDS + 1)
    slips: Ints  # joint of each presliding element, shape (m,)
    give: Floats  # inverse yield displacements of its six elements, shape (m, 6)
    slip: Floats  # g of each, shape (m, 1, SPEEDS + 1)
    memory: Floats  # 1/x_s, play, m and d of each element's bristle, shape (m, 4)


class Command(NamedTuple):
    """What is asked of the machine, one row a sample; its load is external loads less effects without a table.

    Of an axis alone arrays have the shape (n,), and its load is what helps the motor.
    """

    qr: Floats  # command, shape (n, nv)
    vr: Floats  # its velocity at the samples; between them the command is cubic, shape (n, nv)
    load: Floats  # effort that helps the motors, shape (n, nv), or (1, nv) if constant
    step: float  # sampling interval [s]
    substeps: int  # internal steps a sample
    limit: Floats | float  # largest tracking error before the run is stopped, shape (nv,)


class Modes(NamedTuple):
    """Loads that hang on joints by springs, at one internal step; one row each."""

    joint: Ints  # that a load hangs on, shape (m,)
    share: Floats  # of the joint's inertia that it is, shape (m,)
    pull: Floats  # stiffness and damping over the load's mass, shape (m, 2)
    step: Floats  # of twist and its rate, and what the joint's acceleration adds, shape (m, 2, 3)


class State(NamedTuple):
    """Where the machine is, and room for a step; changed by the kernels. Shapes (nv,) unless said otherwise."""

    q: Floats  # position; likewise velocity ``v``, acceleration ``a``, tracking error ``e``, effort ``u``
    v: Floats
    a: Floats
    e: Floats
    u: Floats
    before: Floats  # velocity at the last step
    w: Floats  # velocity after the step
    act: Floats  # effort that acts, after the dead time
    d: Floats  # disturbance of the loops, and ``old`` at the last step
    old: Floats
    vr0: Floats  # velocity of the command at the last step
    pace: Floats  # place of each joint's speed in the tables over speed
    h: Floats  # bias effort, with ``r`` all that moves a joint
    r: Floats
    M: Floats  # mass matrix, with A the matrix of a step and X its inverse, shape (nv, nv)
    A: Floats
    X: Floats
    x: Floats  # states of the loops' blocks, shape (blocks, 2)
    y: Floats  # e, e', e'', u of the blocks of one joint, shape (4,)
    law: Floats  # states of the controllers, shape (nv, 5)
    late: Floats  # efforts of the last steps, shape (nv, late), and in ``at`` where the last one is
    at: Ints
    turn: Floats  # direction, or effort, of each dry-friction element, shape (k,)
    low: Floats
    high: Floats
    bend: Floats  # bend of the slip elements and, last, of the bristle, shape (m, 7)
    where: Floats  # position of each slip element's joint at the last step, shape (m,)
    one: Floats  # effort, damping and stiffness of the element last moved, shape (3,)
    twist: Floats  # of loads on springs and its rate, shape (modes, 2)
    c: Floats  # command now and its two derivatives, shape (3, nv)
    t: Floats  # values of the tape


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
    """What is written down, one row a sample; arrays of no rows are not written."""

    q: Floats  # shape (n, nv); likewise the others
    e: Floats  # tracking error
    u: Floats  # effort
    v: Floats  # velocity
    a: Floats  # acceleration
    d: Floats  # generalised disturbance
