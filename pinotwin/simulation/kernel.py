"""The stepping loop: linear blocks of all axes with the full nonlinear disturbance fed back; second order in h.

    1  x_p   = A x + B0 w(t) + B1 w(t + h)         exact; w holds vr, and d held at d(t)
    2  e, e', e'' without d, u   from x_p
    3  q = qr - e,   v = vr - e',   a = a0 - K d   (Eq. 4.12; K is the gain of d in e'')
    4  r     = h(q, v) + friction + position + other - external
    5  d(t+h) = (M(q) - M_D) a + r                 a linear system: (I + (M - M_D) K) d = (M - M_D) a0 + r
                                                   (K is diagonal but for the loops with a vibration)
    6  x     = x_p + B1 (d(t+h) - d(t))            d runs straight between the steps

Step 5 solves the algebraic loop between disturbance and acceleration: nothing is differentiated or one step late.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.stepping import entry, leaf
from pinotwin.errors import TwinError
from pinotwin.loop import LoopModel, ModalStep, Section, Structure
from pinotwin.loop.sections import flush
from pinotwin.machine import Machine
from pinotwin.simulation.plant_kernel import along, clip, command_at, dynamics, friction, invert, load_at

E, U = 0, 3  # Rows of ``Blocks.C``: e, e', e'', u
D_RATE, D_RATE2, DA_RATE2, GAIN, U_V, U_A, U_D, LOAD_E, LOAD_U = range(9)
"""Columns of ``Blocks.direct``, see :class:`Blocks`."""


class Blocks(NamedTuple):
    """The loops of all axes as k blocks of 2 x 2, sorted by joint; nv joints.

    An axis with a loop gives the blocks of its :class:`LoopModel`, one without has none and follows its command. A
    passive joint is one second-order block, M_D q'' + C q' + K q + d = 0, e = -q, unless the loop of the axis next to
    it has it as a further disturbance and output (thesis Eq. 5.8). Then its blocks are those of that loop: with y = c x
    its velocity, the angle is c A^-1 x, since y has gain zero at frequency zero. In such a loop the two bodies count
    from the ground (q_A' = q_A + q_d, Eq. 5.4), which the kernel is told by ``pairs``.

    The direct terms are: vr in e', vr and ar in e'', d in e'' (the gain K, near 1/M_D), vr, ar and d in u; and what
    a step of d at the end of an interval adds to e and u.
    """

    first: Ints  # first block of each joint, and k at the end, shape (nv + 1,)
    command: Ints  # 1 for a block driven by the command's velocity, 0 by the disturbance, shape (k,)
    source: Ints  # joint whose command or disturbance that is, shape (k,)
    A: Floats  # shape (k, 2, 2)
    B0: Floats  # shape (k, 2)
    B1: Floats  # shape (k, 2)
    C: Floats  # rows e, e', e'', u, shape (k, 4, 2)
    direct: Floats  # per joint the direct terms, in the order of the names above, shape (nv, 9)
    others: Ints  # joint and source of every effect of another joint's disturbance, shape (m, 2)
    reach: Floats  # its gain in e'', and what a step of it adds to e and u, shape (m, 3)
    pairs: Ints  # passive joint and axis that count from the ground, shape (p, 2)
    ideal: Ints  # 1 for a joint that follows its command exactly, shape (nv,)


_Stack = tuple[Any, ...]  # ``command``, ``source``, ``A``, ``B0``, ``B1`` and ``C`` of one joint
_Reach = list[tuple[int, Floats]]  # Other disturbances that act on it, and their row of ``reach``


def lay_blocks(
    machine: Machine, loops: Mapping[str, LoopModel], diagonal: Mapping[str, Floats], step: float
) -> Blocks:
    """Return all joints' blocks at an internal step [s]; TwinError if a loop cannot be laid or a spring is missing."""
    direct, ideal = np.zeros((machine.nv, 9)), np.zeros(machine.nv, dtype=np.intp)
    held = {_partner(machine, loop): name for name, loop in loops.items() if _wide(loop)}
    blocks, counts, others = list[_Stack](), [0], list[tuple[int, int, Floats]]()
    for j, name in enumerate(machine.names):
        if name in held:
            sources = [machine.names.index(held[name]), j]
            own, reach = _of_vibration(loops[held[name]], step, direct[j], sources)
        elif name in machine.passive:
            terms = (float(diagonal[k][j]) for k in ("inertia", "viscous", "stiffness"))
            own, reach = _of_loop(_sprung(name, *terms), step, direct[j], [j])
        elif name in loops:
            sources = [j]
            if _wide(loops[name]):
                sources.append(machine.names.index(_partner(machine, loops[name])))
            own, reach = _of_loop(loops[name], step, direct[j], sources)
        else:
            ideal[j] = 1
            counts.append(0)
            continue
        blocks.append(own)
        counts.append(len(own[0]))
        others += [(j, *one) for one in reach]
    pairs = [(machine.names.index(p), machine.names.index(a)) for p, a in held.items()]
    stacked = [np.ascontiguousarray(np.concatenate(x)) for x in zip(*blocks, strict=True)]
    reached = np.array([x[:2] for x in others], dtype=np.intp).reshape(-1, 2)
    gains = np.array([x[2] for x in others], dtype=float).reshape(-1, 3)
    paired = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return Blocks._make([np.cumsum(counts), *stacked, direct, reached, gains, paired, ideal])


def _wide(loop: LoopModel) -> bool:
    """Whether a loop holds the vibration of a passive joint."""
    return len(loop.disturbances) == 2 and len(loop.outputs) == 3 and not loop.structure.direct


def _partner(machine: Machine, loop: LoopModel) -> str:
    name = loop.disturbances[1]
    if name not in machine.passive:
        raise TwinError(f"{loop.axis}: its loop has the disturbance {name!r}, no passive joint")
    return name


def _of_loop(loop: LoopModel, step: float, direct: Floats, sources: list[int]) -> tuple[_Stack, _Reach]:
    """Return the blocks of an axis' loop; fill its row of direct terms."""
    if len(loop.disturbances) != len(sources):
        raise TwinError(
            f"{loop.axis}: its loop has {len(loop.disturbances)} disturbances "
            f"({', '.join(loop.disturbances)}) and {len(loop.outputs)} outputs; simulation needs loops "
            "with one, or with that of a passive joint and its velocity as output"
        )
    modal = loop.modal(step)
    C1, D1, _, _ = modal.derivative(1)
    C2, D2, E2, _ = modal.derivative(2)
    C = np.stack([modal.C[0], C1[0], C2[0], modal.C[1]], axis=1)  # (k, 4, 2)
    reach, u, ua = _late(modal, C), modal.D[1], modal.Da[1]
    direct[:] = D1[0, -1], D2[0, -1], E2[0, -1], D2[0, 0], u[-1], ua, u[0], *reach[0]
    others = [(sources[i], np.array([D2[0, i], *reach[i]])) for i in range(1, len(loop.disturbances))]
    return _stacked(modal, C, sources), others


def _of_vibration(loop: LoopModel, step: float, direct: Floats, sources: list[int]) -> tuple[_Stack, _Reach]:
    """Return the blocks of a passive joint in the loop of its axis: e = -angle, u = 0."""
    modal = loop.modal(step)
    C1, D1, _, _ = modal.derivative(1)
    angle = np.einsum("ki,kij->kj", modal.C[2], np.linalg.pinv(modal.rate))
    C = -np.stack([angle, modal.C[2], C1[2], np.zeros_like(angle)], axis=1)
    reach = _late(modal, C)
    direct[GAIN], direct[LOAD_E] = -D1[2, 1], reach[1][0]
    return _stacked(modal, C, sources), [(sources[0], np.array([-D1[2, 0], *reach[0]]))]


def _late(modal: ModalStep, C: Floats) -> list[tuple[float, float]]:
    """Return what a step of each disturbance at the end of an interval adds to e and u."""
    out = []
    for i in range(modal.inputs - 1):
        late = (modal.input == i)[:, None] * modal.B1
        out.append((float(np.sum(C[:, E] * late)), float(np.sum(C[:, U] * late))))
    return out


def _stacked(modal: ModalStep, C: Floats, sources: list[int]) -> _Stack:
    commanded = (modal.input == modal.inputs - 1).astype(np.intp)
    source = np.array([*sources, sources[0]], dtype=np.intp)[modal.input]
    return commanded, source, modal.A, modal.B0, modal.B1, C


def _sprung(name: str, inertia: float, viscous: float, stiffness: float) -> LoopModel:
    """Return a passive joint as a loop whose error is its deflection with the sign turned."""
    if inertia <= 0.0 or stiffness <= 0.0:
        raise TwinError(
            f"{name}: passive joint with inertia {inertia:g} and stiffness {stiffness:g}; both must "
            "be positive to be simulated; identify it from a log with its vibration"
        )
    wn = math.sqrt(stiffness / inertia)
    section = Section("wn1", 2, (wn, 0.5 * viscous / (inertia * wn)))
    residues = np.zeros((2, 6))
    residues[0, 0] = 1.0 / stiffness
    structure = Structure(real_poles=0, pole_pairs=1, feedforward_poles=())
    return LoopModel(name, ("d",), ("e", "u"), 1e-3, structure, (section,), residues)


@leaf
def _predict(blocks, c, vr0, s):  # type: ignore[no-untyped-def]
    """Advance the blocks with d held, and fill e, e', e'' without d, u; see steps 1 to 3."""
    x, C, A, B0, B1 = s.x, blocks.C, blocks.A, blocks.B0, blocks.B1
    for j in range(len(s.d)):
        for k in range(4):
            s.y[k] = 0.0
        for b in range(blocks.first[j], blocks.first[j + 1]):
            i = blocks.source[b]
            if blocks.command[b] == 1:
                w0, w1 = vr0[i], c[1, i]
            else:
                w0 = s.d[i]
                w1 = w0
            p, q = x[b, 0], x[b, 1]
            z = flush(A[b, 0, 0] * p + A[b, 0, 1] * q + B0[b, 0] * w0 + B1[b, 0] * w1)
            y = flush(A[b, 1, 0] * p + A[b, 1, 1] * q + B0[b, 1] * w0 + B1[b, 1] * w1)
            x[b, 0], x[b, 1] = z, y
            for k in range(4):
                s.y[k] += C[b, k, 0] * z + C[b, k, 1] * y
        _outputs(blocks, j, c, s)


@leaf
def _outputs(blocks, j, c, s):  # type: ignore[no-untyped-def]
    """Fill e, q, v, the acceleration without d, and u of one joint from the sums in y."""
    g, e, e1, e2, u = blocks.direct, s.y[0], s.y[1], s.y[2], s.y[3]
    s.e[j] = e
    s.q[j] = c[0, j] - e
    s.v[j] = c[1, j] - e1 - g[j, D_RATE] * c[1, j]
    s.a[j] = c[2, j] - e2 - g[j, D_RATE2] * c[1, j] - g[j, DA_RATE2] * c[2, j]
    s.u[j] = u + g[j, U_V] * c[1, j] + g[j, U_A] * c[2, j]


@leaf
def _from_ground(plant, blocks, s):  # type: ignore[no-untyped-def]
    """Turn rows of r and M into those of the pairs' motion from the ground (thesis Eq. 5.4), less M_D: r, M - M_D."""
    for k in range(len(blocks.pairs)):
        p, j = blocks.pairs[k, 0], blocks.pairs[k, 1]
        s.r[p] -= s.r[j]
        for i in range(len(s.r)):
            s.M[p, i] -= s.M[j, i]
        s.M[p, p] += plant.inertia[p] - plant.ground[p]
        s.M[j, p] -= plant.inertia[j]
    for j in range(len(s.r)):
        s.M[j, j] -= plant.inertia[j]


@leaf
def _solve(plant, blocks, s):  # type: ignore[no-untyped-def]
    """Fill d and a: the linear system of step 5."""
    S, g, nv = s.A, blocks.direct, len(s.r)
    _from_ground(plant, blocks, s)
    for i in range(nv):
        for k in range(nv):
            s.r[i] += s.M[i, k] * s.a[k]
            S[i, k] = s.M[i, k] * g[k, GAIN] + (1.0 if i == k else 0.0)
    for x in range(len(blocks.others)):  # the disturbance of one joint acts on the acceleration of another
        j, source = blocks.others[x, 0], blocks.others[x, 1]
        for i in range(nv):
            S[i, source] += s.M[i, j] * blocks.reach[x, 0]
    invert(S, s.X)
    for j in range(nv):
        s.d[j] = 0.0
        for k in range(nv):
            s.d[j] += s.X[j, k] * s.r[k]
        s.a[j] -= g[j, GAIN] * s.d[j]
    for x in range(len(blocks.others)):
        s.a[blocks.others[x, 0]] -= blocks.reach[x, 0] * s.d[blocks.others[x, 1]]


@leaf
def _resist(plant, tables, command, row, share, s):  # type: ignore[no-untyped-def]
    """Fill r at the present q, v; see step 4."""
    dynamics(plant, s)
    for j in range(len(s.r)):
        s.r[j] = s.h[j] - load_at(command, row, share, j) + along(tables, j, s.q[j])
    friction(tables, s)


@leaf
def _finish(plant, blocks, old, s):  # type: ignore[no-untyped-def]
    """Let d run straight over the step: correct states, e and u; see step 6."""
    g = blocks.direct
    for j in range(len(s.d)):
        for b in range(blocks.first[j], blocks.first[j + 1]):
            if blocks.command[b] == 0:
                change = s.d[blocks.source[b]] - old[blocks.source[b]]
                s.x[b, 0] += blocks.B1[b, 0] * change
                s.x[b, 1] += blocks.B1[b, 1] * change
        change = s.d[j] - old[j]
        s.e[j] += g[j, LOAD_E] * change
        s.q[j] -= g[j, LOAD_E] * change
        s.u[j] += g[j, LOAD_U] * change + g[j, U_D] * s.d[j]
        if blocks.ideal[j] == 1:
            s.u[j] = (
                plant.inertia[j] * s.a[j] + plant.viscous[j] * s.v[j] + plant.stiffness[j] * s.q[j] + s.d[j]
            )
    for x in range(len(blocks.others)):
        j, i = blocks.others[x, 0], blocks.others[x, 1]
        s.e[j] += blocks.reach[x, 1] * (s.d[i] - old[i])
        s.q[j] -= blocks.reach[x, 1] * (s.d[i] - old[i])
        s.u[j] += blocks.reach[x, 2] * (s.d[i] - old[i])


@leaf
def _write(record, row, s):  # type: ignore[no-untyped-def]
    for j in range(len(s.q)):
        record.q[row, j], record.e[row, j], record.u[row, j] = s.q[j], s.e[j], s.u[j]
        if len(record.d):
            record.v[row, j], record.a[row, j], record.d[row, j] = s.v[j], s.a[j], s.d[j]


@entry
@leaf
def settle(plant, tables, blocks, command, s):  # type: ignore[no-untyped-def]
    """Put the loops in equilibrium under the first command, which the machine follows: friction not yet loaded."""
    command_at(command, (command.step, 1.0 / command.step), 0, 0.0, s.c)
    nv = len(s.d)
    for _ in range(30):
        for j in range(nv):
            s.y[0], s.y[1], s.y[2], s.y[3] = 0.0, 0.0, 0.0, 0.0
            for b in range(blocks.first[j], blocks.first[j + 1]):
                i = blocks.source[b]
                w = s.c[1, i] if blocks.command[b] == 1 else s.d[i]
                s.x[b, 0], s.x[b, 1] = w, 0.0
                for k in range(4):
                    s.y[k] += blocks.C[b, k, 0] * w
            _outputs(blocks, j, s.c, s)
            s.v[j], s.a[j], s.before[j] = s.c[1, j], s.c[2, j], s.c[1, j]
        for k in range(len(tables.directions)):
            j, partner = tables.directions[k, 0], tables.directions[k, 1]
            s.turn[k] = clip((s.v[j] + (s.v[partner] if partner >= 0 else 0.0)) * tables.slope[k])
        for k in range(len(tables.slips)):
            s.where[k] = s.q[tables.slips[k]]
        _resist(plant, tables, command, 0, 0.0, s)
        _from_ground(plant, blocks, s)
        for j in range(nv):
            s.d[j] = s.r[j]
            for k in range(nv):
                s.d[j] += s.M[j, k] * s.a[k]
    for j in range(nv):
        s.old[j] = s.d[j]
    _finish(plant, blocks, s.old, s)


@entry
@leaf
def run(plant, tables, blocks, command, s, record):  # type: ignore[no-untyped-def]
    """Step through the whole command; return row and joint at which the tracking error exceeds its limit, or -1, -1."""
    n, nv = command.qr.shape
    old, vr0 = s.old, s.vr0
    interval = command.step, 1.0 / command.step
    _write(record, 0, s)
    for row in range(n - 1):
        for k in range(command.substeps):
            share = (k + 1.0) / command.substeps
            for j in range(nv):
                old[j], vr0[j] = s.d[j], s.c[1, j]
            command_at(command, interval, row, share, s.c)
            _predict(blocks, s.c, vr0, s)
            _resist(plant, tables, command, row, share, s)
            _solve(plant, blocks, s)
            _finish(plant, blocks, old, s)
        for j in range(nv):
            if not abs(s.e[j]) <= command.limit[j]:
                return row + 1, j
        _write(record, row + 1, s)
    return -1, -1
