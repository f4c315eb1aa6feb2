r"""The loop of an axis next to a passive joint, with its vibration (thesis Eq. 5.4, 5.8, 5.9).

Counted from the ground (q_A' = q_A + q_d) motor and link obey

     u = I_A q_A'' + b q_A' + d_A,       - u = I_d q_d'' + c q_d' + k q_d - b q_A' + d_d

so that the loop has the link's generalised disturbance as a further input and its velocity as a further output: 3 x 3
of order 7 in the source. A twin simulates by default the link as a spring of its own, beside a 2 x 2 loop, for that
needs no further poles and keeps the posture in the mass matrix. Both are judged on the part of the log that neither
saw. The axes' loops are then tied (:mod:`pinotwin.identification.loop_with_mass`): with the spring between them
several accelerations are solved together, and loops that do not move the known mass could feed that circle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import generalised_disturbance, reacting
from pinotwin.errors import DataError
from pinotwin.identification.loop_parts import both_errors, first_part, loop_data, score
from pinotwin.identification.loop_with_mass import tied, with_lag
from pinotwin.identification.settings import Settings, better
from pinotwin.loop import LoopData, LoopModel, Structure, identify_loop
from pinotwin.motion import Motion
from pinotwin.twin import OpenLoop

KEY = "with_vibration"  # Where ``quality["loops"][axis]`` keeps the loop


def tie_loops(
    plant: OpenLoop, loops: Mapping[str, LoopModel], motion: Motion, settings: Settings
) -> dict[str, tuple[LoopModel, dict[str, Any]]]:
    """Return the loops whose effort follows from the mass, where held-out data allow it, and each axis' quality row."""
    d = generalised_disturbance(plant, motion, plant.diagonal)
    out = {}
    for name, free in loops.items():
        i = motion.index(name)
        known = (float(plant.diagonal["inertia"][i]), float(plant.diagonal["viscous"][i]))
        data = loop_data(motion, d, name, settings)
        before = identify_loop(first_part(data), free.structure, starts=free.theta)
        try:
            trial = tied(first_part(data), with_lag(free), *known)
            model = tied(data, trial, *known)
        except DataError:
            continue
        taken = better(before, [trial], partial(score, data), settings.no_worse) is trial
        own = both_errors(data, model, trial)
        row: dict[str, Any] = {"tied": {"free": free.to_dict(), **own, "taken": taken}}
        if taken:
            row |= {"real_poles": model.structure.real_poles, **own}
        out[name] = (model if taken else free, row)
    return out


def vibration_loops(
    plant: OpenLoop, loops: Mapping[str, LoopModel], motion: Motion, settings: Settings
) -> dict[str, Any]:
    """Return the loop with vibration of every axis on a passive joint, with its errors, or why there is none.

    Kept as ``quality["loops"][axis]["with_vibration"]``, which :func:`pinotwin.simulation.wide_loops` reads.
    """
    out: dict[str, Any] = {}
    for passive, axis in reacting(plant.machine).items():
        if axis not in loops or np.ptp(motion.v[:, motion.index(passive)]) == 0.0:
            continue
        try:
            data = vibration_data(plant, motion, axis, passive, settings)
            trial = _with_mode(plant, loops[axis], first_part(data), passive)
            model = identify_loop(data, trial.structure, starts=trial.theta)
        except DataError as error:
            out[axis] = {"note": str(error)}
            continue
        out[axis] = {"model": model.to_dict(), **both_errors(data, model, trial)}
    return out


def vibration_data(plant: OpenLoop, motion: Motion, axis: str, passive: str, settings: Settings) -> LoopData:
    """Return inputs and outputs of an axis' loop with the vibration of a passive joint, counted from the ground."""
    i, p = motion.index(axis), motion.index(passive)
    d, M = generalised_disturbance(plant, motion, plant.diagonal), plant.diagonal["inertia"]
    plain = loop_data(motion, d, axis, settings)
    more = (M[p] - plant.diagonal["ground"][p]) * motion.a[:, p] - M[i] * motion.a[:, i]
    return replace(
        plain,
        d=np.column_stack([d[:, i] - M[i] * motion.a[:, p], d[:, p] - d[:, i] + more]),
        outputs=np.column_stack([plain.outputs, motion.v[:, p]]),
        output_names=("e", "u", f"{passive}.v"),
        disturbance_names=("d", passive),
    )


def _with_mode(plant: OpenLoop, alone: LoopModel, data: LoopData, passive: str) -> LoopModel:
    """Return the loop with one pair more than the axis alone, its search begun at the spring's mode."""
    p = plant.machine.names.index(passive)
    k, c, I = (float(plant.diagonal[x][p]) for x in ("stiffness", "viscous", "ground"))
    wn = np.sqrt(k / I)
    mode = [np.log(wn), np.log(np.clip(0.5 * c / (I * wn), 0.006, 0.6))]
    structure: Structure = replace(alone.structure, pole_pairs=alone.structure.pole_pairs + 1)
    return identify_loop(data, structure, starts=np.array([[*alone.theta, *mode]]))
