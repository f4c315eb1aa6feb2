"""From a motion and its effects to the rows and columns that the solver takes.

Every joint with a measured effort gives one row a sample. Columns and effort go through the same
zero-phase decimation (the *parallel filter* of Gautier 1997), stretch by stretch, so that the linear
model holds exactly in the filtered rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.errors import DataError
from pinotwin.motion import Motion
from pinotwin.signals import decimate_zero_phase
from pinotwin.solve.problem import Problem


@dataclass(frozen=True)
class Rows:
    """Which samples of which joints are fitted.

    Attributes:
        joints: joints with rows, ascending.
        kept: for each of them, the samples (after decimation) that are used, shape (m,).
        block: stretch number of every decimated sample, shape (m,).
        sample: sample of the motion that each decimated row stands for, shape (m,).
    """

    joints: tuple[int, ...]
    kept: tuple[Mask, ...]
    block: Ints
    sample: Ints

    def slice_of(self, joint: int) -> slice:
        """Return where a joint's rows are when all are stacked."""
        counts = [int(k.sum()) for k in self.kept]
        at = self.joints.index(joint)
        start = sum(counts[:at])
        return slice(start, start + counts[at])


def choose_rows(motion: Motion) -> Rows:
    """Return the rows of a motion that identification uses.

    Raises:
        DataError: no joint has a usable effort.
    """
    sample, block = _decimated_samples(motion)
    joints, kept = [], []
    for joint in range(len(motion.names)):
        usable = motion.use[:, joint] & np.isfinite(motion.u[:, joint])
        mask = usable[sample]
        if mask.any():
            joints.append(joint)
            kept.append(mask)
    if not joints:
        raise DataError(
            f"{motion.source}: no usable row left: no axis has both effort and motion above the "
            "thresholds; record a longer or faster motion, or lower `min_speed`"
        )
    return Rows(tuple(joints), tuple(kept), block, sample)


def _decimated_samples(motion: Motion) -> tuple[Ints, Ints]:
    step = motion.decimation
    picks = [np.arange(s.stop - 1, s.start - 1, -step)[::-1] for s in motion.segments]
    blocks = [np.full(len(p), k) for k, p in enumerate(picks)]
    if not picks:
        raise DataError(f"{motion.source}: no stretch of regular sampling is long enough")
    return np.concatenate(picks), np.concatenate(blocks)


def thin(motion: Motion, values: Floats) -> Floats:
    """Return ``values`` (n, ...) decimated as the motion says, stretch by stretch."""
    return decimate_zero_phase(values, motion.decimation, motion.segments)


def joint_columns(motion: Motion, effect: Effect, joint: int) -> Floats | None:
    """Return the thinned columns of one effect at one joint, or None if it does not act there."""
    columns = effect.columns(motion)
    if joint not in columns.joints:
        return None
    return thin(motion, columns.values[:, columns.joints.index(joint), :])


def assemble(motion: Motion, effects: Sequence[Effect], rows: Rows | None = None) -> Problem:
    """Return the stacked least-squares problem of all joints.

    Args:
        motion: prepared log.
        effects: what may explain the effort, shapes fixed.
        rows: rows to use; chosen from the motion when None.
    """
    rows = rows or choose_rows(motion)
    slices = effect_slices(effects)
    total = sum(int(k.sum()) for k in rows.kept)
    w = np.zeros((total, slices[-1].stop))
    for effect, where in zip(effects, slices, strict=True):
        columns = effect.columns(motion)
        for at, joint in enumerate(columns.joints):
            if joint in rows.joints:
                part = thin(motion, columns.values[:, at, :])
                w[rows.slice_of(joint), where] = part[rows.kept[rows.joints.index(joint)]]
    return Problem(
        W=w,
        y=_stacked_effort(motion, rows),
        axis=_stack(rows, lambda joint, kept: np.full(int(kept.sum()), joint)),
        time=_stack(rows, lambda joint, kept: np.flatnonzero(kept)),
        block=_stack(rows, lambda joint, kept: rows.block[kept]),
        names=coefficient_names(effects),
    )


def _stack(rows: Rows, part) -> Ints:  # type: ignore[no-untyped-def]
    pairs = zip(rows.joints, rows.kept, strict=True)
    return np.concatenate([part(joint, kept) for joint, kept in pairs])


def _stacked_effort(motion: Motion, rows: Rows) -> Floats:
    u = motion.u if motion.external is None else motion.u + motion.external
    parts = []
    for joint, kept in zip(rows.joints, rows.kept, strict=True):
        parts.append(thin(motion, np.nan_to_num(u[:, joint]))[kept])
    return np.concatenate(parts)


def coefficient_names(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return the full name of every linear coefficient, e.g. ``Y.coulomb.c``."""
    pairs = zip(effect_keys(effects), effects, strict=True)
    return tuple(f"{key}.{c.name}" for key, effect in pairs for c in effect.coefficients())
