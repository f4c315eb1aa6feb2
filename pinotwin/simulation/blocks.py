"""The loops of all axes as one list of 2 x 2 blocks for the stepping kernel.

An axis with a loop gives the blocks of its :class:`LoopModel`. A passive joint is one second-order
block driven by its own disturbance,

    M_D q'' + C q' + K q + d = 0,     e = -q.

An axis without a loop has no blocks: it follows its command exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import TwinError
from pinotwin.loop import LoopModel, Section, Structure
from pinotwin.machine import Machine

E, E_RATE, E_RATE2, U = range(4)
"""Rows of ``Blocks.C``: e, e', e'', u."""
D_RATE, D_RATE2, DA_RATE2, GAIN, U_V, U_A, U_D, LOAD_E, LOAD_U = range(9)
"""Columns of ``Blocks.direct``, see :class:`Blocks`."""


class Blocks(NamedTuple):
    """k blocks, sorted by joint; nv joints.

    Attributes:
        first: first block of each joint, and k at the end, shape (nv + 1,).
        command: 1 for a block driven by the command's velocity, 0 by the disturbance, shape (k,).
        A: shape (k, 2, 2).
        B0: shape (k, 2).
        B1: shape (k, 2).
        C: rows e, e', e'', u, shape (k, 4, 2).
        direct: per joint the direct terms: vr in e', vr and ar in e'', d in e'' (the gain K, near
            1/M_D), vr, ar and d in u; and what a step of d at the end of an interval adds to e and
            u, shape (nv, 9).
        ideal: 1 for a joint that follows its command exactly, shape (nv,).
    """

    first: Ints
    command: Ints
    A: Floats
    B0: Floats
    B1: Floats
    C: Floats
    direct: Floats
    ideal: Ints


def lay_blocks(
    machine: Machine, loops: Mapping[str, LoopModel], diagonal: Mapping[str, Floats], step: float
) -> Blocks:
    """Return the blocks of all joints at a sampling interval [s].

    Args:
        machine: whose joints they are.
        loops: loop of each axis that has one.
        diagonal: M_D, C, K; a passive joint's own dynamics are made of them.
        step: internal step [s].

    Raises:
        TwinError: a loop with several disturbances, or a passive joint without a spring.
    """
    parts, first = [], [0]
    direct, ideal = np.zeros((machine.nv, 9)), np.zeros(machine.nv, dtype=np.intp)
    for j, name in enumerate(machine.names):
        loop = loops.get(name)
        if name in machine.passive:
            loop = _sprung(
                name, *(float(diagonal[k][j]) for k in ("inertia", "viscous", "stiffness"))
            )
        if loop is None:
            ideal[j] = 1
        else:
            parts.append(_of_loop(loop, step, direct[j]))
        first.append(first[-1] + (0 if loop is None else len(parts[-1][0])))
    shapes = ((), (2, 2), (2,), (2,), (4, 2))
    empty = [[np.zeros((0, *shape)) for shape in shapes]]
    command, A, B0, B1, C = (
        np.ascontiguousarray(np.concatenate(x)) for x in zip(*(empty + parts), strict=True)
    )
    return Blocks(
        np.array(first, dtype=np.intp), command.astype(np.intp), A, B0, B1, C, direct, ideal
    )


def _of_loop(loop: LoopModel, step: float, direct: Floats) -> list[Floats]:
    """Return command, A, B0, B1, C of one loop; fill its row of direct terms."""
    if len(loop.disturbances) != 1:
        raise TwinError(
            f"{loop.axis}: its loop has {len(loop.disturbances)} disturbances "
            f"({', '.join(loop.disturbances)}); simulation needs loops with one"
        )
    modal = loop.modal(step)
    C1, D1, _, _ = modal.derivative(1)
    C2, D2, E2, _ = modal.derivative(2)
    C = np.stack([modal.C[0], C1[0], C2[0], modal.C[1]], axis=1)  # (k, 4, 2)
    late = (modal.input == 0)[:, None] * modal.B1
    direct[:] = (
        D1[0, 1], D2[0, 1], E2[0, 1], D2[0, 0], modal.D[1, 1], modal.Da[1], modal.D[1, 0],
        np.sum(C[:, E] * late), np.sum(C[:, U] * late),
    )  # fmt: skip
    return [modal.input.astype(float), modal.A, modal.B0, modal.B1, C]


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
