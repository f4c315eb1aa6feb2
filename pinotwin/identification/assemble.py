"""From a motion and its effects to the rows and columns that the solver takes.

Columns and effort of a joint go through the same zero-phase decimation (the *parallel filter* of Gautier 1997),
stretch by stretch, so that the linear model holds exactly in the filtered rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, vstack

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.effects import Columns, Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.effects.scene import blocks
from pinotwin.errors import DataError
from pinotwin.identification.settings import Settings
from pinotwin.motion import Motion
from pinotwin.signals import decimate_zero_phase
from pinotwin.solve.problem import Problem


@dataclass(frozen=True)
class Rows:
    """Which samples of which joints are fitted."""

    joints: tuple[int, ...]  # joints with rows, ascending
    kept: tuple[Mask, ...]  # for each of them, the samples (after decimation) that are used, shape (m,)
    block: Ints  # stretch number of every decimated sample, shape (m,)
    sample: Ints  # sample of the motion that each decimated row stands for, shape (m,)

    def only(self, joint: int) -> Rows:
        """Return the rows of one joint."""
        return replace(self, joints=(joint,), kept=(self.kept[self.joints.index(joint)],))


def choose_rows(motion: Motion) -> Rows:
    """Return the rows of a motion that identification uses; DataError where no joint has a usable effort."""
    picks = [np.arange(s.stop - 1, s.start - 1, -motion.decimation)[::-1] for s in motion.segments]
    if not picks:
        raise DataError(f"{motion.source}: no stretch of regular sampling is long enough")
    sample, block = np.concatenate(picks), np.repeat(np.arange(len(picks)), list(map(len, picks)))
    usable = (motion.use & np.isfinite(motion.u))[sample]
    joints = tuple(int(joint) for joint in np.flatnonzero(usable.any(axis=0)))
    if not joints:
        raise DataError(
            f"{motion.source}: no usable row left: no axis has both effort and motion above the "
            "thresholds; record a longer or faster motion, or lower `min_speed`"
        )
    return Rows(joints, tuple(usable[:, joint] for joint in joints), block, sample)


def pieces(motion: Motion, rows: Rows, settings: Settings) -> Motion | None:
    """Return twelve pieces of a long motion, evenly spread, to search shapes on; None if it is not long.

    Which value a shape has a minute shows as well as an hour. Of an axis with fewer than 100 fitted rows filters and
    friction at rest leave nothing.
    """
    if len(rows.sample) <= settings.long:
        return None
    width = settings.short * motion.decimation // 12
    found = []
    for start in np.linspace(0, len(motion) - width, 12).astype(int):
        for s in motion.segments:
            a, b = max(int(start), s.start), min(int(start) + width, s.stop)
            if b - a > 100 * motion.decimation:
                found.append(motion.cut(a, b))
    return Motion.join(found) if found else None


def thin(motion: Motion, values: Floats) -> Floats:
    """Return ``values`` (n, ...) decimated as the motion says, stretch by stretch."""
    return decimate_zero_phase(values, motion.decimation, motion.segments)


def assemble(motion: Motion, effects: Sequence[Effect], rows: Rows | None = None) -> Problem:
    """Return the stacked least-squares problem of all joints, shapes fixed; rows chosen from the motion when None."""
    rows = rows or choose_rows(motion)
    u = np.nan_to_num(motion.u if motion.external is None else motion.u + motion.external)
    pairs = list(zip(rows.joints, rows.kept, strict=True))
    return Problem(
        W=_columns(motion, effects, rows),
        y=np.concatenate([thin(motion, u[:, joint])[kept] for joint, kept in pairs]),
        axis=np.concatenate([np.full(int(kept.sum()), joint) for joint, kept in pairs]),
        time=np.concatenate([np.flatnonzero(kept) for _, kept in pairs]),
        block=np.concatenate([rows.block[kept] for _, kept in pairs]),
        names=coefficient_names(effects),
        second=1.0 / (motion.step * motion.decimation),
        turning=np.concatenate([_turning(motion, effects, j)[rows.sample[kept]] for j, kept in pairs]),
    )


def _columns(motion: Motion, effects: Sequence[Effect], rows: Rows) -> csr_array:
    """Return the columns of all effects at the rows of all joints, sparse."""
    slices, parts = effect_slices(effects), {joint: list[csr_array]() for joint in rows.joints}
    every = (None if e.pointwise and motion.decimation == 1 else e.columns(motion) for e in effects)
    whole = [
        c and Columns(c.joints, np.stack([thin(motion, x) for x in c.values.swapaxes(0, 1)], 1))
        for c in every
    ]
    for some, formed in blocks(motion, effects, whole, rows.sample):
        for joint, kept in zip(rows.joints, rows.kept, strict=True):
            acting = [(c, s) for c, s in zip(formed, slices, strict=True) if joint in c.joints]
            dense = np.hstack([c.values[kept[some], c.joints.index(joint)] for c, _ in acting])
            at, there = np.r_[*(s for _, s in acting)].astype(np.int32), dense != 0.0
            starts = np.append(0, np.cumsum(there.sum(axis=1))).astype(np.int32)
            entries = dense[there], np.broadcast_to(at, dense.shape)[there], starts
            parts[joint].append(csr_array(entries, (len(dense), slices[-1].stop)))
    return vstack([x for own in parts.values() for x in own], format="csr")


def _turning(motion: Motion, effects: Sequence[Effect], joint: int, share: float = 0.06) -> Mask:
    """Return the ``share`` of the rows in motion that are nearest behind a turn of an axis, by its travel, shape (n,).

    There no law of dry friction is true; none without such friction, or with a table, whose ends they alone tell. With
    the usual share 95 % intervals hold 93 to 98 % under four laws of friction (``python -m benchmarks bound``).
    """
    moving, q = motion.moving(joint), motion.q[:, joint]
    own = [e for e in effects if e.axis == motion.names[joint]]
    if not moving.any() or any(e.local for e in own) or not any(e.depends == "direction" for e in own):
        return np.zeros(len(q), dtype=bool)
    side, row = np.where(moving, np.sign(motion.v[:, joint]), 0.0), np.arange(len(q))
    way = side[np.maximum.accumulate(row * (side != 0.0))]
    turns = np.unique([0, *np.flatnonzero(np.diff(way)) + 1, *(s.start for s in motion.segments)])
    travel = np.abs(q - q[turns[np.searchsorted(turns, row, side="right") - 1]])
    return moving & (travel <= np.quantile(travel[moving], share))


def coefficient_names(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return the full name of every linear coefficient, e.g. ``Y.coulomb.c``."""
    pairs = zip(effect_keys(effects), effects, strict=True)
    return tuple(f"{key}.{c.name}" for key, effect in pairs for c in effect.coefficients())
