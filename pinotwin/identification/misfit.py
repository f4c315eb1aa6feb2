"""The twin's cross-validated residual on its own logs (see :mod:`pinotwin.twin.misfit`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.effects.scene import without_model
from pinotwin.errors import DataError
from pinotwin.identification.judge import CrossValidated
from pinotwin.identification.settings import Settings
from pinotwin.motion import Motion
from pinotwin.signals import autocorrelation, rms
from pinotwin.solve.crossval import HeldOut
from pinotwin.twin import OpenLoop, Twin
from pinotwin.twin.misfit import Misfit

_BANDS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)


def misfit_of(plant: OpenLoop, motion: Motion, known: CrossValidated, settings: Settings) -> Misfit | None:
    """Return what a plant leaves of the logs it was identified from; None where they are too short.

    The parts are predicted by least squares on the others, moved by what physical consistency and the closed loop
    moved it itself away from least squares on all. What is ``known`` of the rows as they were fitted, part by part, is
    found anew where loops changed its effects.
    """
    motion, log = without_model(motion), known.log
    if len(motion) > settings.kept:
        starts = np.linspace(0, len(motion) - (size := settings.kept // 12), 12).astype(int)
        motion = Motion.join([motion.cut(int(s), int(s) + size) for s in starts])
        log = np.concatenate([log[s : s + size] for s in starts])
    if not known.serves(plant.effects, motion):
        scene = plant.scene(motion)
        known = CrossValidated.of(plant.machine, plant.effects, scene, folds=settings.folds, log=log)
    if known.held is None:
        return None
    theta = known.held.theta + plant.theta - known.held.whole
    fold = np.full(known.length, -1)
    fold[known.rows.sample[known.problem.time]] = known.held.fold
    there = np.flatnonzero(fold >= 0)  # a row belongs to the part of the fitted one before it
    fold = fold[there[np.clip(np.searchsorted(there, np.arange(len(fold)), side="right") - 1, 0, None)]]
    foreseen = _foreseen(motion, known, known.held)
    residual = _residual(plant, motion, theta, fold)
    return Misfit(foreseen, fold, theta, _summary(foreseen, residual, ~motion.use), log)


def misfit_with(
    plant: OpenLoop,
    before: Misfit,
    new: Sequence[Motion],
    parts: Sequence[CrossValidated],
    known: CrossValidated,
    settings: Settings,
) -> tuple[Misfit, CrossValidated | None]:
    """Return the misfit of kept rows and new logs' ``parts``, each log predicted from the other ``known`` ones."""
    count, held, most = int(known.problem.block.max()) + 1, known.held, settings.kept // 4
    merged = parts[-1].log[-1] + 1 - count  # of the oldest logs, which are kept as one
    whose = [before.log, *(part.log[:most] for part in parts)]
    log = np.maximum(np.concatenate(whose) - merged, 0)[-settings.kept :]
    kept, resting = [before.motion], [np.zeros_like(before.motion.use)]
    fold = [] if held is None else [held.fold[known.problem.block == k][0] for k in range(count)]
    for motion, part in zip(new, parts, strict=True):
        resting.append(~motion.use[:most])
        if held is not None:
            own = replace(held, fold=np.full(len(part.problem.y), fold[part.log[0] - merged]))
            motion = _foreseen(motion, part, own)
        kept.append(without_model(motion).cut(0, most))
    joined = Motion.join(kept)
    joined = joined.cut(max(len(joined) - settings.kept, 0), len(joined))
    if held is None:
        blocks = CrossValidated.of(plant.machine, plant.effects, plant.scene(joined), folds=settings.folds)
        if blocks.held is not None:
            moved = blocks.held.theta + plant.theta - blocks.held.whole
            blocks = replace(blocks, held=blocks.held.by(blocks.problem, moved, plant.theta))
        found = misfit_of(plant, joined, blocks, settings)
        return replace(found or before, log=log), blocks
    theta, of_rows = held.theta + plant.theta - held.whole, np.array(fold)[log]
    left = _residual(plant, joined, theta, of_rows)
    summary = _summary(joined, left, np.concatenate(resting)[-settings.kept :])
    return Misfit(joined, of_rows, theta, summary, log), None


def _foreseen(
    motion: Motion, known: CrossValidated, held: HeldOut, unsure: float = 1.0, least: float = 0.1
) -> Motion:
    """Return the motion without the rows of a joint that the other parts of the logs say nothing of.

    ``unsure`` is the variance of a prediction, over that of the noise, from which its row tells nothing of the model;
    ``least`` the share of a joint's rows that must be left.
    """
    blind, use = held.unsure(known.problem) > unsure, motion.use.copy()
    sample = known.rows.sample[known.problem.time]
    for joint, part in known.problem.slices.items():
        if np.mean(blind[part]) > 1.0 - least:
            continue
        for k in sample[part][blind[part]]:
            use[max(k - motion.decimation + 1, 0) : k + 1, joint] = False
    return replace(motion, use=use)


def own_residual(twin: Twin) -> Floats:
    """Return the cross-validated residual on every row of the own logs, shape (n, nv) [N or N·m]."""
    if twin.misfit is None:
        raise DataError(f"{twin.machine.name}: this twin has no validation error; identify it again")
    return _residual(twin, twin.misfit.motion, twin.misfit.theta, twin.misfit.fold)


def _residual(plant: OpenLoop, motion: Motion, theta: Floats, fold: Ints) -> Floats:
    motion, effort = plant.scene(motion), np.zeros((len(motion), plant.machine.nv))
    every, parts = np.arange(len(motion)), [np.flatnonzero(fold == k) for k in range(len(theta))]
    for effect, where in zip(plant.effects, plant.slices, strict=True):
        if not effect.pointwise:
            effort += effect.along(motion, theta[:, where].T)[every, :, fold]
            continue
        for part, own in zip(parts, theta[:, where], strict=True):
            effort[part] += effect.along(motion.at(part), own)
    if motion.external is not None:
        effort = effort - motion.external
    return motion.u - effort


def _summary(motion: Motion, residual: Floats, resting: Mask) -> dict[str, Any]:
    """Return axis -> size of the residual (n, nv) in every regime, its spectrum and correlation time."""
    out: dict[str, Any] = {}
    for j, name in enumerate(motion.names):
        usable = motion.inside & np.isfinite(residual[:, j])
        moving = usable & motion.use[:, j]
        if moving.sum() < 10:
            continue
        r, still = np.nan_to_num(residual[:, j]), usable & resting[:, j]
        out[name] = {
            "unit": "N·m" if motion.rotary[j] else "N",
            "rms": rms(r[usable]),
            "moving": rms(r[moving]),
            "resting": rms(r[still]) if still.any() else None,
            "by_speed": _by(np.abs(motion.v[:, j]), r, moving),
            "by_acceleration": _by(np.abs(motion.a[:, j]), r, moving),
            "by_position": _by(motion.q[:, j], r, moving),
            "correlation_time": correlation_time(r, motion.segments, motion.step),
            "spectrum": _bands(r, motion.segments, motion.step),
        }
    return out


def _by(x: Floats, r: Floats, rows: Mask) -> dict[str, list[float]]:
    """Return the RMS of ``r`` in six bins of equal population of ``x``."""
    edges = np.quantile(x[rows], np.linspace(0.0, 1.0, 7))
    at = np.clip(np.searchsorted(edges, x[rows], side="right") - 1, 0, 5)
    power = np.bincount(at, r[rows] ** 2, 6) / np.maximum(np.bincount(at, minlength=6), 1)
    return {"edges": edges.tolist(), "rms": np.sqrt(power).tolist()}


def correlation_time(r: Floats, segments: Sequence[slice], step: float) -> float:
    """Return the integral time of the autocorrelation of a residual up to its first zero [s]."""
    longest = max(segments, key=lambda s: s.stop - s.start)
    x = r[longest]
    if not np.ptp(x) > 0.0:
        return step
    c = autocorrelation(x, max(len(x) // 2 - 1, 0))
    below = np.flatnonzero(c <= 0.0)
    return float(step * (0.5 + c[1 : int(below[0]) if len(below) else len(c)].sum()))


def _bands(r: Floats, segments: Sequence[slice], step: float) -> dict[str, list[float]]:
    """Return the share of the residual's power in frequency bands [Hz]."""
    edges = np.array([f for f in _BANDS if f < 0.5 / step] + [0.5 / step])
    power = np.zeros(len(edges) - 1)
    for s in segments:
        x = r[s]
        if len(x) >= 32:
            line = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
            power += np.histogram(np.fft.rfftfreq(len(x), step), edges, weights=line)[0]
    return {"edges": edges.tolist(), "share": (power / max(power.sum(), 1e-300)).tolist()}
