"""How far the gap shrinks: the effort of data not used to fit, before and after an effect is modelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.ledger import Ledger, build_ledger
from pinotwin.diagnosis.result import Shrink
from pinotwin.diagnosis.search import Judged, admit
from pinotwin.diagnosis.stage import Stage, build_stage

RESAMPLES = 400
STRETCH = 0.5  # [s] length of the blocks that are resampled


@dataclass(frozen=True)
class HeldOut:
    """Error on data that were not fitted, per piece of a stage, in SI.

    Attributes:
        stage: plain (not whitened) stage.
        error: per piece, shape (m,).
        fitted: error with all data fitted, per piece.
        on: ``validation`` or ``held-out blocks``.
    """

    stage: Stage
    error: tuple[Floats, ...]
    fitted: tuple[Floats, ...]
    on: str


def plain_stage(stage: Stage) -> Stage:
    """Return the same stage without whitening: rows in units of the noise."""
    noise, rows = stage.noise, stage.rows
    plain = replace(noise, models={j: np.zeros(0) for j in noise.models}, level=noise.rms)
    logs = {p.channel.log for p in stage.pieces}
    whole = build_stage(rows, stage.base, plain)
    return replace(whole, pieces=tuple(p for p in whole.pieces if p.channel.log in logs))


def held_out(stage: Stage, effects: Sequence[Judged], theta: Floats) -> HeldOut:
    """Return the errors of the base with some effects on data not used to fit them."""
    under = admit(stage, effects)
    flags = stage.rows.validation
    if any(flags):
        some = [p for p in under.pieces if not flags[p.channel.log]]
        fitted = build_ledger(replace(under, pieces=tuple(some)), theta)
        error = tuple(p.y - p.B @ fitted.theta[p.columns] for p in under.pieces)
        pieces = [(p, e) for p, e in zip(under.pieces, error, strict=True) if flags[p.channel.log]]
        seen = replace(stage, pieces=tuple(p for p, _ in pieces))
        scaled = tuple(_si(stage, p, e) for p, e in pieces)
        return HeldOut(seen, scaled, scaled, "validation")
    ledger = build_ledger(under, theta)
    count = stage.base.count
    thetas = np.array([ledger.theta, *(_fold_theta(ledger, f) for f in range(under.blocks))])
    error = _rebased(stage, under, thetas[:, count:], theta)
    own = tuple(_si(stage, p, p.y - p.B @ ledger.theta[p.columns]) for p in under.pieces)
    return HeldOut(stage, error, own, "held-out blocks")


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
    x, y, u, v, block = _squares(before, after, joint)
    if not len(x):
        return None
    count = block.max() + 1
    sums = np.stack([np.bincount(block, w, count) for w in (x, y, u, v, np.ones(len(x)))])
    draws = rng.integers(0, count, (RESAMPLES, count))
    picked = sums[:, draws].sum(axis=2)
    share = _share(picked[0], picked[1], picked[4] * noise**2)
    return Shrink(
        before=float(np.sqrt(x.mean())),
        after=float(np.sqrt(y.mean())),
        share=float(_share(x.sum(), y.sum(), len(x) * noise**2)),
        interval=(float(np.quantile(share, 0.05)), float(np.quantile(share, 0.95))),
        promised=float(_share(u.sum(), v.sum(), len(x) * noise**2)),
        on=before.on,
    )


def _share(before: Floats | float, after: Floats | float, noise: Floats | float) -> Floats:
    """Return the share of the squared gap above the noise that goes, at most 1."""
    excess = np.maximum(before - noise, 0.02 * before + 1e-300)
    return np.asarray(np.clip((before - after) / excess, -1.0, 1.0))


def _squares(before: HeldOut, after: HeldOut, joint: int):  # type: ignore[no-untyped-def]
    parts: list[list[Floats]] = [[], [], [], [], []]
    step = before.stage.rows.motions[0].step
    for k, piece in enumerate(before.stage.pieces):
        if piece.channel.joint != joint:
            continue
        t = piece.channel.centres[piece.kept] * step
        values = (before.error[k], after.error[k], before.fitted[k], after.fitted[k])
        for part, x in zip(parts, values, strict=False):
            part.append(x**2)
        parts[4].append((t / STRETCH).astype(int) + 4096.0 * piece.channel.log)
    joined = [np.concatenate(p) if p else np.zeros(0) for p in parts]
    if len(joined[4]):
        joined[4] = np.unique(joined[4], return_inverse=True)[1].astype(float)
    return (*joined[:4], joined[4].astype(int))
