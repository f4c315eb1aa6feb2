"""The loops of all axes as one list of 2 x 2 blocks for the stepping kernel.

An axis with a loop gives the blocks of its :class:`LoopModel`, one without has none and follows its command exactly. A
passive joint is one second-order block, M_D q'' + C q' + K q + d = 0, e = -q, unless the loop of the axis next to it
has it as a further disturbance and output (thesis Eq. 5.8). Then its blocks are those of that loop: with y = c x its
velocity, the angle is c A^-1 x, since y has gain zero at frequency zero. In such a loop the two bodies count from the
ground (q_A' = q_A + q_d, Eq. 5.4), which the kernel is told by ``Blocks.pairs``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import TwinError
from pinotwin.loop import LoopModel, ModalStep, Section, Structure
from pinotwin.machine import Machine

E, E_RATE, E_RATE2, U = range(4)  # Rows of ``Blocks.C``: e, e', e'', u
D_RATE, D_RATE2, DA_RATE2, GAIN, U_V, U_A, U_D, LOAD_E, LOAD_U = range(9)
"""Columns of ``Blocks.direct``, see :class:`Blocks`."""


class Blocks(NamedTuple):
    """k blocks, sorted by joint; nv joints.

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


class _Laid(NamedTuple):
    """The blocks of one joint, and what other disturbances do to it."""

    blocks: tuple[Floats, ...]
    others: tuple[tuple[int, Floats], ...] = ()


def lay_blocks(
    machine: Machine, loops: Mapping[str, LoopModel], diagonal: Mapping[str, Floats], step: float
) -> Blocks:
    """Return all joints' blocks at an internal step [s]; TwinError if a loop cannot be laid or a spring is missing."""
    direct, ideal = np.zeros((machine.nv, 9)), np.zeros(machine.nv, dtype=np.intp)
    held = {_partner(machine, loop): name for name, loop in loops.items() if _wide(loop)}
    laid: list[_Laid | None] = []
    for j, name in enumerate(machine.names):
        if name in held:
            loop = loops[held[name]]
            sources = [machine.names.index(held[name]), j]
            laid.append(_of_vibration(loop, step, direct[j], sources))
        elif name in machine.passive:
            terms = (float(diagonal[k][j]) for k in ("inertia", "viscous", "stiffness"))
            laid.append(_of_loop(_sprung(name, *terms), step, direct[j], [j]))
        elif name in loops:
            sources = [j]
            if _wide(loops[name]):
                sources.append(machine.names.index(_partner(machine, loops[name])))
            laid.append(_of_loop(loops[name], step, direct[j], sources))
        else:
            laid.append(None)
            ideal[j] = 1
    pairs = [(machine.names.index(p), machine.names.index(a)) for p, a in held.items()]
    return _joined(laid, direct, pairs, ideal)


def _joined(laid: list[_Laid | None], direct: Floats, pairs: list[tuple[int, int]], ideal: Ints) -> Blocks:
    shapes = ((), (), (2, 2), (2,), (2,), (4, 2))
    parts = [tuple(np.zeros((0, *shape)) for shape in shapes)]
    parts += [part.blocks for part in laid if part is not None]
    command, source, A, B0, B1, C = (
        np.ascontiguousarray(np.concatenate(x)) for x in zip(*parts, strict=True)
    )
    counts = [0 if part is None else len(part.blocks[0]) for part in laid]
    cross = [(j, s, x) for j, part in enumerate(laid) if part for s, x in part.others]
    return Blocks(
        np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
        command.astype(np.intp),
        source.astype(np.intp),
        A,
        B0,
        B1,
        C,
        direct,
        np.array([(j, s) for j, s, _ in cross], dtype=np.intp).reshape(-1, 2),
        np.array([x for *_, x in cross], dtype=float).reshape(-1, 3),
        np.array(pairs, dtype=np.intp).reshape(-1, 2),
        ideal,
    )


def _wide(loop: LoopModel) -> bool:
    """Whether a loop holds the vibration of a passive joint."""
    return len(loop.disturbances) == 2 and len(loop.outputs) == 3 and not loop.structure.direct


def _partner(machine: Machine, loop: LoopModel) -> str:
    name = loop.disturbances[1]
    if name not in machine.passive:
        raise TwinError(f"{loop.axis}: its loop has the disturbance {name!r}, no passive joint")
    return name


def _of_loop(loop: LoopModel, step: float, direct: Floats, sources: list[int]) -> _Laid:
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
    reach = _late(modal, C)
    direct[:] = (
        D1[0, -1],
        D2[0, -1],
        E2[0, -1],
        D2[0, 0],
        modal.D[1, -1],
        modal.Da[1],
        modal.D[1, 0],
        *reach[0],
    )
    others = tuple((sources[i], np.array([D2[0, i], *reach[i]])) for i in range(1, len(loop.disturbances)))
    return _Laid(_stacked(modal, C, sources), others)


def _of_vibration(loop: LoopModel, step: float, direct: Floats, sources: list[int]) -> _Laid:
    """Return the blocks of a passive joint in the loop of its axis: e = -angle, u = 0."""
    modal = loop.modal(step)
    C1, D1, _, _ = modal.derivative(1)
    angle = np.einsum("ki,kij->kj", modal.C[2], np.linalg.pinv(modal.rate))
    C = -np.stack([angle, modal.C[2], C1[2], np.zeros_like(angle)], axis=1)
    reach = _late(modal, C)
    direct[GAIN], direct[LOAD_E] = -D1[2, 1], reach[1][0]
    others = ((sources[0], np.array([-D1[2, 0], *reach[0]])),)
    return _Laid(_stacked(modal, C, sources), others)


def _late(modal: ModalStep, C: Floats) -> list[tuple[float, float]]:
    """Return what a step of each disturbance at the end of an interval adds to e and u."""
    out = []
    for i in range(modal.inputs - 1):
        late = (modal.input == i)[:, None] * modal.B1
        out.append((float(np.sum(C[:, E] * late)), float(np.sum(C[:, U] * late))))
    return out


def _stacked(modal: ModalStep, C: Floats, sources: list[int]) -> tuple[Floats, ...]:
    last = modal.inputs - 1
    commanded = (modal.input == last).astype(float)
    source = np.array([*sources, sources[0]])[modal.input]
    return commanded, source.astype(float), modal.A, modal.B0, modal.B1, C


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
