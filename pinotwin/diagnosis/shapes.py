"""Shapes of the base model's own effects: the ones that ``identify`` finds in the same logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.bank import stacked
from pinotwin.diagnosis.base import Base, plain_base, with_slopes
from pinotwin.diagnosis.ledger import build_ledger, residual_of, sums
from pinotwin.diagnosis.noise import Noise
from pinotwin.diagnosis.rows import Rows
from pinotwin.diagnosis.stage import Blocks, Piece, Stage, build_stage
from pinotwin.diagnosis.worth import worth
from pinotwin.effects import Effect, PositionTable, Presliding, Stribeck
from pinotwin.effects.layout import effect_slices
from pinotwin.identification.plant import Plant, fit_plant
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion

ENOUGH = 0.35  # of a joint's travel, for its pitches to be found
FADES = (
    0.004,
    0.4,
    14,
)  # of an axis' top speed: speeds at which its friction may fade, and how many
MUCH_BETTER = 0.97  # of the squared error in motion that another speed may leave to be taken


def shaped_base(
    machine: Machine,
    logs: Sequence[Log],
    rows: Rows,
    travel: Sequence[Motion],
    noise: Noise,
    coarse: int = 1,
) -> Base:
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
    effects = faded(effects, rows, noise)
    base = plain_base(rows, effects)
    sloped = with_slopes(base, build_ledger(build_stage(rows, base, noise)).theta)
    whole = np.concatenate([_carried(plant, effects), np.zeros(len(sloped.slopes))])
    return replace(sloped, whole=whole)


def faded(effects: tuple[Effect, ...], rows: Rows, noise: Noise) -> tuple[Effect, ...]:
    """Return the effects with the speeds at which friction fades as rows in motion tell them.

    ``identify`` fits a friction with a memory at standstill too, where the form of any law is in error by far
    more than the noise: a speed that one axis passes quickly is decided there by what is not of it.
    """
    stage = build_stage(rows, plain_base(rows, effects), noise)
    out = list(effects)
    for k, where in enumerate(effect_slices(effects)):
        effect = effects[k]
        names = [c.name for c in effect.coefficients()]
        if isinstance(effect, (Presliding, Stribeck)) and "s" in names:
            out[k] = _faded(stage, effect, names.index("s"), where.start + names.index("s"))
    return tuple(out)


def _faded(stage: Stage, effect: Presliding | Stribeck, own: int, column: int) -> Effect:
    """Return one effect at the best of some speeds, if that is much better than its own.

    Args:
        stage: rows in motion with the base.
        effect: whose speed is sought.
        own: its coefficient that fades.
        column: the same among the base's columns.
    """
    motions = stage.rows.motions
    joint = motions[0].index(effect.axis)
    if joint not in stage.rows.joints:
        return effect
    top = max(float(np.abs(m.v[:, joint]).max()) for m in motions)
    speeds = np.array([effect.v_s, *(top * np.geomspace(*FADES))])
    columns: list[list[Blocks]] = [
        [
            [(joint, replace(effect, v_s=float(x)).axis_columns(m.axis(effect.axis))[:, [own]])]
            for m in motions
        ]
        for x in speeds
    ]
    without = replace(stage, pieces=tuple(_without(p, column) for p in stage.pieces))
    ledger = build_ledger(without)
    gain = worth(ledger, sums(ledger, stacked(without, columns))).gain[:, 0]
    left = sum(
        float(np.sum(residual_of(p, ledger.theta) ** 2)) for p in without.pieces if p.channel.joint == joint
    )
    best = int(np.argmax(gain))
    better = left - gain[best] < MUCH_BETTER * (left - gain[0])
    return replace(effect, v_s=float(speeds[best])) if better else effect


def _without(piece: Piece, column: int) -> Piece:
    kept = piece.columns != column
    return replace(piece, B=piece.B[:, kept], columns=piece.columns[kept])


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
