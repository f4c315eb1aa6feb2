"""Shapes of the base model's own effects: the ones that ``identify`` finds in the same logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.base import Base, plain_base, with_slopes
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.noise import Noise
from pinotwin.diagnosis.rows import Rows
from pinotwin.diagnosis.stage import build_stage
from pinotwin.effects import Effect, PositionTable
from pinotwin.identification.plant import Plant, fit_plant
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.preparation import prepare
from pinotwin.twin.twin import effect_slices

ENOUGH = 0.35  # of a joint's travel, for its pitches to be found


def shaped_base(
    machine: Machine, logs: Sequence[Log], rows: Rows, travel: Sequence[Motion], noise: Noise,
    coarse: int = 1,
) -> Base:  # fmt: skip
    """Return the base with every searched shape as identified, and free to first order.

    Args:
        machine: what is believed.
        logs: logs to fit, as read.
        rows: their rows.
        travel: motions whose travel tables must cover, validation logs included.
        noise: that weighs the axes.
        coarse: above 1, the shapes are sought in a part of one log per command.
    """
    chosen = list(logs) if coarse == 1 else _one_of_each(logs, rows.commands)
    motion = prepare(machine, chosen)
    motion = motion if coarse == 1 else _first_part(motion)
    every = max(round(rows.thinner.factor / motion.decimation), 1)
    plant = fit_plant(machine, motion, consistent_inertia=False, every=every)
    joined = Motion.join(travel)
    effects = tuple(
        replace(e, start=None, stop=None).fitted_to(joined) if isinstance(e, PositionTable) else e
        for e in plant.effects
    )
    base = plain_base(rows, effects)
    sloped = with_slopes(base, build_ledger(build_stage(rows, base, noise)).theta)
    whole = np.concatenate([_carried(plant, effects), np.zeros(len(sloped.slopes))])
    return replace(sloped, whole=whole)


def _one_of_each(logs: Sequence[Log], commands: Sequence[int]) -> list[Log]:
    """Return one log of every command: a repeat says little more of a pitch."""
    return [log for k, log in enumerate(logs) if commands[k] not in commands[:k]]


def _first_part(motion: Motion) -> Motion:
    """Return the first part of a log that holds enough of every joint's travel.

    Sampled less often, presliding would lead the pitches astray; in less time they are found as well.
    """
    whole = np.ptp(motion.q, axis=0)
    for share in (3, 2):
        part = motion.cut(0, len(motion) // share)
        if part.segments and np.all(np.ptp(part.q, axis=0) >= ENOUGH * whole):
            return part
    return motion


def _carried(plant: Plant, effects: Sequence[Effect]) -> Floats:
    """Return the plant's coefficients in the order of the effects, knots where these have theirs."""
    out = []
    for old, new, where in zip(plant.effects, effects, effect_slices(plant.effects), strict=True):
        theta = plant.theta[where]
        if isinstance(old, PositionTable) and isinstance(new, PositionTable):
            theta = np.interp(new.knots, old.knots, theta)
        out.append(theta)
    return np.concatenate(out)
