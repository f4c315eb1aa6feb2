"""How far the gap shrinks: the effort of data not used to fit, before and after an effect is modelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.admission import Judged, admit
from pinotwin.diagnosis.base import Base
from pinotwin.diagnosis.ledger import Ledger, build_ledger
from pinotwin.diagnosis.result import Shrink
from pinotwin.diagnosis.stage import Piece, Stage, build_stage, scatter_precision, steady

RESAMPLES = 400
FIRM = 1e8  # times the precision of a twin's coefficients: they do not move
LEAST_ROWS = 40  # of a block whose share counts
KNOWN = 0.03  # relative uncertainty of the noise's power
OTHER = 1.25  # times the part of a gap that stays: what another motion may make of it
STRETCH = 0.5  # [s] length of the blocks that are resampled


@dataclass(frozen=True)
class Errors:
    """Errors per piece of a plain (not whitened) stage [N or N·m], each of shape (m,)."""

    stage: Stage
    values: tuple[Floats, ...]


@dataclass(frozen=True)
class HeldOut:
    """Errors on data that were not fitted, and what the data that were fitted promised.

    Attributes:
        delivered: on validation logs; without them, on blocks that were not fitted.
        promised: on blocks of the fitted logs that were not fitted; without validation logs, of the
            fit itself.
        on: ``validation``, ``held-out blocks``, or ``fitted logs`` (of an event).
    """

    delivered: Errors
    promised: Errors
    on: str


def plain_stage(stage: Stage) -> Stage:
    """Return the same stage without whitening: rows in units of the noise."""
    noise, rows = stage.noise, stage.rows
    plain = replace(noise, models={j: np.zeros(0) for j in noise.models}, level=noise.rms)
    logs = {p.channel.log for p in stage.pieces}
    whole = build_stage(rows, _firm(stage.base), plain)
    return replace(whole, pieces=tuple(p for p in whole.pieces if p.channel.log in logs))


def _firm(base: Base) -> Base:
    """Return a twin's base that stays what it was; a base that is refitted as it is.

    The gap before is the twin's own. If its parameters might move, they would hide a change that is
    within what is granted them, and the effect that names it would seem to shrink nothing.
    """
    return replace(base, precision=FIRM * base.precision) if base.change else base


def held_out(stage: Stage, effects: Sequence[Judged], theta: Floats) -> HeldOut:
    """Return the errors of the base with some effects on data not used to fit them."""
    some = stage.fitted
    under = admit(some, effects)
    ledger = build_ledger(under, theta)
    count = stage.base.count
    thetas = np.array([ledger.theta, *(_fold_theta(ledger, f) for f in range(under.blocks))])
    blocks = Errors(some, _rebased(some, under, thetas[:, count:], theta))
    if any(stage.rows.validation):
        return HeldOut(_unseen(stage, effects, ledger.theta, theta), blocks, "validation")
    return HeldOut(blocks, _own(some, under, ledger.theta), "held-out blocks")


def on_fitted(stage: Stage, effects: Sequence[Judged], theta: Floats) -> HeldOut:
    """Return the errors on the fitted logs themselves: of an event that no other log holds."""
    under = admit(stage.fitted, effects)
    own = _own(stage.fitted, under, build_ledger(under, theta).theta)
    return HeldOut(own, own, "fitted logs")


def _own(some: Stage, under: Stage, found: Floats) -> Errors:
    """Return what coefficients leave on the very rows of a stage."""
    values = (_si(some, p, p.y - p.B @ found[p.columns]) for p in under.pieces)
    return Errors(some, tuple(values))


def _unseen(stage: Stage, effects: Sequence[Judged], found: Floats, theta: Floats) -> Errors:
    """Return the errors on validation logs, their own scatter of friction (noise of runs) taken out."""
    flags = stage.rows.validation
    seen = replace(stage, pieces=tuple(p for p in stage.pieces if flags[p.channel.log]))
    own = scatter_precision(stage.base, stage.noise, theta)
    precision = np.concatenate([own, np.full(len(found) - len(own), np.inf)])
    pieces = admit(seen, effects).pieces
    values = (steady(p, p.y - p.B @ found[p.columns], precision) for p in pieces)
    return Errors(seen, tuple(_si(stage, p, e) for p, e in zip(pieces, values, strict=True)))


def _rebased(stage: Stage, under: Stage, effects: Floats, theta: Floats) -> tuple[Floats, ...]:
    """Return the errors with the effects' coefficients of the other folds, the base fitted anew.

    The base is not on trial: it may use all rows, or a table would be judged at knots that the other
    folds never visited.
    """
    if not effects.shape[1]:
        plain = build_ledger(stage, theta)
        return tuple(_si(stage, p, p.y - p.B @ plain.theta[p.columns]) for p in stage.pieces)
    count, pieces = stage.base.count, []
    for p, wide in zip(stage.pieces, under.pieces, strict=True):
        extra = wide.columns >= count
        values = effects[1 + p.block][:, wide.columns[extra] - count]
        pieces.append(replace(p, y=p.y - np.einsum("nk,nk->n", wide.B[:, extra], values)))
    moved = replace(stage, pieces=tuple(pieces))
    plain = build_ledger(moved, theta)
    return tuple(_si(stage, p, p.y - p.B @ plain.theta[p.columns]) for p in pieces)


def _fold_theta(ledger: Ledger, fold: int) -> Floats:
    return ledger.solve(fold + 1, ledger.right[fold + 1][:, :1])[:, 0]


def _si(stage: Stage, piece, error: Floats) -> Floats:  # type: ignore[no-untyped-def]
    return np.asarray(error * stage.noise.level[piece.channel.joint])


def shrink(
    before: HeldOut, after: HeldOut, joint: int, noise: float, rng: np.random.Generator
) -> Shrink | None:
    """Return the shrink of one joint's gap, with a block bootstrap's interval."""
    x, y, block = _squares(before.delivered, after.delivered, joint)
    u, v, _ = _squares(before.promised, after.promised, joint)
    if not len(x):
        return None
    count = block.max() + 1
    sums = np.stack([np.bincount(block, w, count) for w in (x, y, np.ones(len(x)))])
    draws = rng.integers(0, count, (RESAMPLES, count))
    picked = sums[:, draws].sum(axis=2)
    share = share_gone(picked[0], picked[1], picked[2] * noise**2)
    return Shrink(
        before=float(np.sqrt(x.mean())),
        after=float(np.sqrt(y.mean())),
        share=float(share_gone(x.sum(), y.sum(), len(x) * noise**2)),
        interval=(float(np.quantile(share, 0.05)), float(np.quantile(share, 0.95))),
        promised=float(share_gone(u.sum(), v.sum(), len(u) * noise**2)) if len(u) else 0.0,
        on=before.on,
        promised_interval=_range_of_blocks(before.promised, after.promised, joint, noise),
    )


def foretold(before: HeldOut, after: HeldOut, joint: int) -> tuple[float, float]:
    """Return the slope of the gap on what effects foretell of it, on data not used to fit them.

    1 where they are right, whatever else is in the gap (a base may foretell another motion badly by
    itself); 0 where they foretell nothing of it. Beside it its standard error, stretches of time apart.
    """
    stage = before.delivered.stage
    own = [k for k, p in enumerate(stage.pieces) if p.channel.joint == joint]
    if not own:
        return 0.0, np.inf
    gap, left = (np.concatenate([x.delivered.values[k] for k in own]) for x in (before, after))
    said = gap - left
    size = max(float(said @ said), 1e-300)
    slope = float(gap @ said) / size
    stretch = np.concatenate([stretches(stage, stage.pieces[k]) for k in own])
    parts = np.bincount(np.unique(stretch, return_inverse=True)[1], (gap - slope * said) * said)
    return slope, float(np.sqrt(np.sum(parts**2))) / size


def stretches(stage: Stage, piece: Piece) -> Floats:
    """Return the stretch of time of every row of a piece, another number in every log."""
    t = piece.channel.centres[piece.kept] * stage.rows.motions[0].step
    return np.asarray(np.floor(t / STRETCH) + 4096.0 * piece.channel.log)


def _range_of_blocks(before: Errors, after: Errors, joint: int, noise: float) -> tuple[float, float] | None:
    """Return within which the share on another log is promised to lie.

    What stays of the gap differs from block to block with their motion. Another log may hold all of the
    worst and all of the best of it, and its own motion beyond: the range of what stays, a
    quarter wider to either side. Less than a tenth is not told from nothing.
    """
    folds = np.concatenate([p.block for p in before.stage.pieces if p.channel.joint == joint])
    x, y, _ = _squares(before, after, joint)
    count = np.bincount(folds)
    seen = np.flatnonzero(count >= LEAST_ROWS)
    if len(seen) < 3:
        return None
    u, v = (np.asarray(np.bincount(folds, w)[seen], dtype=float) for w in (x, y))
    level = np.asarray(count[seen] * noise**2, dtype=float)
    stays = 1.0 - np.concatenate([share_gone(u, v, level * k) for k in (1.0 - KNOWN, 1.0 + KNOWN)])
    least, most = float(stays.min()), float(stays.max())
    return max(1.0 - OTHER * most, -1.0), 1.0 if least < 0.1 else 1.0 - least / OTHER


def share_gone(before: Floats | float, after: Floats | float, noise: Floats | float) -> Floats:
    """Return the share of the squared gap above the noise that goes, at most 1."""
    excess = np.maximum(before - noise, 0.02 * before + 1e-300)
    return np.asarray(np.clip((before - after) / excess, -1.0, 1.0))


def _squares(before: Errors, after: Errors, joint: int) -> tuple[Floats, Floats, Ints]:
    """Return squared errors before and after on one joint, and the stretch of time of each."""
    x, y, block = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for k, piece in enumerate(before.stage.pieces):
        if piece.channel.joint == joint:
            x.append(before.values[k] ** 2)
            y.append(after.values[k] ** 2)
            block.append(stretches(before.stage, piece))
    number = np.unique(np.concatenate(block), return_inverse=True)[1]
    return np.concatenate(x), np.concatenate(y), number
