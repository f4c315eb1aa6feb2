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
        coarse: by how much fewer samples are looked at.
    """
    motion = prepare(machine, list(logs))
    motion = motion.every(2 * coarse) if coarse > 1 else motion  # a pitch is long and a log too
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


def _carried(plant: Plant, effects: Sequence[Effect]) -> Floats:
    """Return the plant's coefficients in the order of the effects, knots where these have theirs."""
    out = []
    for old, new, where in zip(plant.effects, effects, effect_slices(plant.effects), strict=True):
        theta = plant.theta[where]
        if isinstance(old, PositionTable) and isinstance(new, PositionTable):
            theta = np.interp(new.knots, old.knots, theta)
        out.append(theta)
    return np.concatenate(out)
