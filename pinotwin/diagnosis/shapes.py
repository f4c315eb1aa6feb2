"""Shapes of the base model's own effects, found on the rows of the diagnosis.

Each shaped effect is scanned coordinate by coordinate on its own grid, jointly with all linear columns;
then all shapes are refined together by Gauss-Newton steps on first-order columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.base import Base, effect_columns, plain_base, with_slopes
from pinotwin.diagnosis.ledger import Ledger, build_ledger, sums, worth
from pinotwin.diagnosis.noise import Noise
from pinotwin.diagnosis.rows import Rows
from pinotwin.diagnosis.stage import build_stage
from pinotwin.effects import Effect
from pinotwin.motion import Motion

BATCH = 48
REFINEMENTS = 3
FASTEST_STRIBECK = 0.15  # of the top speed


def shaped_base(rows: Rows, effects: Sequence[Effect], noise: Noise) -> Base:
    """Return the base with every searched shape at its best value, and free to first order."""
    fixed = [e for e in effects if not e.shapes()]
    moving = [e for e in effects if e.shapes()]
    found: list[Effect] = []
    joined = Motion.join(rows.motions)
    for effect in moving:
        base = plain_base(rows, [*fixed, *found])
        ledger = build_ledger(build_stage(rows, base, noise))
        found.append(_scanned(rows, ledger, effect, joined, base.distance))
    done = iter(found)
    ordered = [next(done) if e.shapes() else e for e in effects]
    return _refined(rows, ordered, noise)


def _scanned(
    rows: Rows, ledger: Ledger, effect: Effect, motion: Motion, distance: Floats
) -> Effect:
    grids = effect.grid(motion)
    passes = 1 if len(grids) == 1 else 2
    for number in range(passes):
        for k, grid in enumerate(grids):
            if number and len(grid) > 40:
                continue  # a pitch is found once, at full resolution
            some = _within(effect, k, grid, motion)
            effect = _along(rows, ledger, effect, k, some, distance)
    return effect


def _within(effect: Effect, k: int, grid: Floats, motion: Motion) -> Floats:
    """Return the grid without Stribeck speeds so high that they stand for viscosity or drag."""
    if effect.shapes()[k].name != "v_s":
        return grid
    top = float(np.abs(motion.axis(str(effect.axis)).v).max(initial=0.0))
    low = grid[grid <= FASTEST_STRIBECK * top]
    return low if len(low) else grid[:1]


def _along(
    rows: Rows, ledger: Ledger, effect: Effect, k: int, grid: Floats, distance: Floats
) -> Effect:
    values = list(effect.shape_values())
    options = [effect.shaped([*values[:k], float(x), *values[k + 1 :]]) for x in grid]
    gain = []
    for first in range(0, len(options), BATCH):
        gain.append(_gains(rows, ledger, options[first : first + BATCH], distance))
    return options[int(np.argmax(np.concatenate(gain)))]


def _gains(rows: Rows, ledger: Ledger, options: Sequence[Effect], distance: Floats) -> Floats:
    columns = [
        [np.stack([x for _, x in effect_columns(e, m, distance)[:1]], 0)[0] for e in options]
        for m in rows.motions
    ]
    joint = rows.motions[0].index(str(options[0].axis))
    count, k = len(options), columns[0][0].shape[1]
    batch: list[Floats | None] = []
    for piece in ledger.stage.pieces:
        if piece.channel.joint != joint:
            batch.append(None)
            continue
        wide = np.concatenate(columns[piece.channel.log], axis=1)
        batch.append(ledger.stage.whitened(piece, wide).reshape(-1, count, k))
    if all(x is None for x in batch):
        return np.zeros(count)
    return worth(ledger, sums(ledger, batch)).gain[:, 0]


def _refined(rows: Rows, effects: Sequence[Effect], noise: Noise) -> Base:
    joined = Motion.join(rows.motions)
    for _ in range(REFINEMENTS):
        base = plain_base(rows, effects)
        theta = build_ledger(build_stage(rows, base, noise)).theta
        sloped = with_slopes(base, theta)
        if not sloped.slopes:
            return base
        steps = build_ledger(build_stage(rows, sloped, noise)).theta[base.count :]
        effects = _moved(effects, sloped, steps, joined)
    base = plain_base(rows, effects)
    theta = build_ledger(build_stage(rows, base, noise)).theta
    return with_slopes(base, theta)


def _moved(effects: Sequence[Effect], base: Base, steps: Floats, motion: Motion) -> list[Effect]:
    out = list(effects)
    for (i, k, _), step in zip(base.slopes, steps, strict=True):
        shape = out[i].shapes()[k]
        values = list(out[i].shape_values())
        if shape.name == "period":
            change = float(np.clip(step, -2e-3, 2e-3))
        else:
            change = float(np.clip(step, -0.3, 0.3))
        x = (
            values[k] * (1.0 + change)
            if shape.log
            else values[k] + change * max(abs(values[k]), 0.1)
        )
        upper = shape.upper
        if shape.name == "v_s":
            top = float(np.abs(motion.axis(str(out[i].axis)).v).max(initial=0.0))
            upper = max(shape.lower, FASTEST_STRIBECK * top)
        values[k] = float(np.clip(x, shape.lower, upper))
        out[i] = out[i].shaped(values)
    return out


def frozen(base: Base) -> Base:
    """Return the base without first-order columns."""
    count = base.count - len(base.slopes)
    return replace(
        base, slopes=(), mean=base.mean[:count], precision=base.precision[:count, :count]
    )
