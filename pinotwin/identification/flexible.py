r"""The loop of an axis next to a passive joint, with its vibration (thesis Eq. 5.4, 5.8, 5.9).

The motor of an axis that sits on a passive joint turns its own body and, by its reaction, the link
below. Counted from the ground (q_A' = q_A + q_d) the two bodies obey

     u = I_A q_A'' + b q_A' + d_A,       - u = I_d q_d'' + c q_d' + k q_d - b q_A' + d_d

so that the loop has the link's generalised disturbance as a further input and its velocity as a
further output: 3 x 3 of order 7 in the source. With the joint's own coordinates instead, the link
is a spring with its own states and the axis' loop stays 2 x 2; that is what a twin simulates by default,
for it needs no further poles and keeps the posture in the mass matrix. Both are identified, and judged on
the part of the log that neither saw.

The axes' own loops are then tied (:mod:`pinotwin.identification.tied`): with the spring between them the
accelerations of several axes are solved together, and loops that do not move the known mass could
feed that circle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import generalised_disturbance, reacting
from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.identification.loop_parts import errors, first_part, loop_data
from pinotwin.identification.tied import tied, with_lag
from pinotwin.loop import LoopData, LoopModel, Structure, identify_loop
from pinotwin.motion import Motion
from pinotwin.twin import Twin

KEY = "with_vibration"
"""Where ``quality["loops"][axis]`` keeps the loop."""
NO_WORSE = 1.05
"""A tied loop is taken unless its held-out error is above this times the free one's."""


def with_tied_loops(twin: Twin, motion: Motion) -> Twin:
    """Return the twin with loops whose effort follows from the mass, where held-out data allow it."""
    d = generalised_disturbance(twin, motion, twin.diagonal)
    models, loops = dict(twin.loops), dict(twin.quality.get("loops", {}))
    for name, free in twin.loops.items():
        i = motion.index(name)
        known = (float(twin.diagonal["inertia"][i]), float(twin.diagonal["viscous"][i]))
        data = loop_data(motion, d, name)
        before = errors(
            data, identify_loop(first_part(data), free.structure, starts=_start(free)), held_out=True
        )
        try:
            trial = tied(first_part(data), with_lag(free), *known)
            model = tied(data, trial, *known)
        except DataError:
            continue
        after = errors(data, trial, held_out=True)
        taken = np.mean(list(after.values())) <= NO_WORSE * np.mean(list(before.values()))
        row = {"free": free.to_dict(), "fit": errors(data, model), "held_out": after}
        loops[name] = {**loops[name], "tied": {**row, "taken": bool(taken)}}
        if taken:
            models[name] = model
            loops[name] |= {"real_poles": model.structure.real_poles, "fit": row["fit"], "held_out": after}
    return replace(twin, loops=models, quality={**twin.quality, "loops": loops})


def with_vibration_loops(twin: Twin, motion: Motion) -> Twin:
    """Return the twin with the loop with vibration of every axis that sits on a passive joint.

    They are kept under ``quality["loops"][axis]["with_vibration"]``: the model, the errors of the fit
    and on held-out rows; :func:`pinotwin.simulation.wide_loops` reads them.
    """
    loops: dict[str, Any] = dict(twin.quality.get("loops", {}))
    for passive, axis in reacting(twin.machine).items():
        if axis not in twin.loops or np.ptp(motion.v[:, motion.index(passive)]) == 0.0:
            continue
        try:
            data = vibration_data(twin, motion, axis, passive)
            trial = _fitted(twin, first_part(data), axis, passive)
            model = _fitted(twin, data, axis, passive, near=trial)
        except DataError as error:
            loops[axis] = {**loops[axis], KEY: {"note": str(error)}}
            continue
        judged = {"fit": errors(data, model), "held_out": errors(data, trial, held_out=True)}
        loops[axis] = {**loops[axis], KEY: {"model": model.to_dict(), **judged}}
    return replace(twin, quality={**twin.quality, "loops": loops})


def vibration_data(twin: Twin, motion: Motion, axis: str, passive: str) -> LoopData:
    """Return inputs and outputs of an axis' loop with the vibration of a passive joint."""
    i, p = motion.index(axis), motion.index(passive)
    d = generalised_disturbance(twin, motion, twin.diagonal)
    plain = loop_data(motion, d, axis)
    return replace(
        plain,
        d=from_ground(d, motion.a, twin.diagonal, i, p)[:, [i, p]],
        outputs=np.column_stack([plain.outputs, motion.v[:, p]]),
        output_names=("e", "u", f"{passive}.v"),
        disturbance_names=("d", passive),
    )


def from_ground(d: Floats, a: Floats, diagonal: Mapping[str, Floats], i: int, p: int) -> Floats:
    """Return the generalised disturbances with axis i and passive joint p counted from the ground.

    Args:
        d: in joint coordinates, shape (n, nv).
        a: accelerations of the joints, shape (n, nv).
        diagonal: M_D, and ``ground``, that of passive joints counted from the ground.
        i: column of the axis.
        p: column of the passive joint.
    """
    M, ground = diagonal["inertia"], diagonal["ground"]
    out = d.copy()
    out[:, i] -= M[i] * a[:, p]
    out[:, p] += (M[p] - ground[p]) * a[:, p] - d[:, i] - M[i] * a[:, i]
    return out


def _fitted(twin: Twin, data: LoopData, axis: str, passive: str, near: LoopModel | None = None) -> LoopModel:
    """Return the loop: one pair more than the axis alone, its search begun at the spring's mode."""
    alone = near or twin.loops[axis]
    start = _start(alone)[0]
    if near is not None:
        return identify_loop(data, near.structure, starts=start[None])
    p = twin.machine.names.index(passive)
    k, c, I = (float(twin.diagonal[x][p]) for x in ("stiffness", "viscous", "ground"))
    wn = np.sqrt(k / I)
    mode = [np.log(wn), np.log(np.clip(0.5 * c / (I * wn), 0.006, 0.6))]
    structure: Structure = replace(
        alone.structure, pole_pairs=alone.structure.pole_pairs + 1, integrator=False
    )
    return identify_loop(data, structure, starts=np.array([[*start, *mode]]))


def _start(model: LoopModel) -> Floats:
    """Return the logarithms of the searched poles, shape (1, np)."""
    return np.array([[np.log(x) for part in model.sections if part.free for x in part.values]])
