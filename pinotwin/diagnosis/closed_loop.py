"""The same gaps in the tracking error: the disturbance of each axis through its closed loop.

The effort that a model predicts along the motion, less the axis' own inertia, is the disturbance that the
servo must reject (Eq. 4.1). An axis' loop is identified with the disturbance of the base model, and again
with the effects that were found; what either leaves of the tracking error on data it was not fitted to is
the gap before and after. Encoder readings share nothing with the effort's noise: this is a second witness.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.admission import Judged, admit
from pinotwin.diagnosis.base import Base
from pinotwin.diagnosis.context import Scene
from pinotwin.diagnosis.decide import Decision
from pinotwin.diagnosis.noise import between_repeats
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.result import Gap, Region, Shrink
from pinotwin.diagnosis.stage import Piece
from pinotwin.diagnosis.where import concentrated, regimes
from pinotwin.errors import DataError
from pinotwin.loop import LoopData, Structure, identify_loop
from pinotwin.loop.model import LoopModel
from pinotwin.motion import Motion
from pinotwin.signals import roughness

TRAINED = 0.7  # of a log that a loop is fitted to where there is no validation log
MOVING = 0.01  # share of an axis' top speed above which the tracking error is looked at
SETTLED = 0.2  # [s] at the start of a stretch, in which the loop's own state is not known
SENSED = ("delay", "effort_scale")  # they are in what is logged of the effort, not in the effort
RESAMPLES = 400
THERE = 0.35  # power above the noise, over that of the noise, from which a gap is localised
MOST = 3  # regions of one axis
STRETCH = 0.5  # [s]


def error_gaps(
    start: Ready, decision: Decision, tell: Callable[[str, float], None], rng: np.random.Generator
) -> tuple[dict[str, Gap], dict[str, Shrink], list[Region]]:
    """Return the gap of the tracking error per axis, how far named effects shrink it, where it lies."""
    motions = start.stage.rows.motions
    where: list[Region] = []
    if any(m.qr is None for m in motions):
        return {}, {}, where
    named = [n.judged for n in decision.named if n.judged.candidate.effect not in SENSED]
    plain = _efforts(start, [])
    fuller = _efforts(start, named) if named else plain
    table: dict[str, Gap] = {}
    shrinks: dict[str, Shrink] = {}
    joints = start.stage.rows.joints
    for k, joint in enumerate(joints):
        axis = motions[0].names[joint]
        tell(f"closed loop of {axis}", 0.9 + 0.09 * k / len(joints))
        try:
            before = _left(start, joint, plain)
            touched = any(joint in dict(n.candidate.columns[0]) for n in named)
            after = _left(start, joint, fuller) if touched else before
        except DataError:  # the axis hardly moves: its loop is not seen in these logs
            continue
        better = touched and _rms(after) < _rms(before)
        table[axis] = _gap(start, joint, before, after if better else before)
        if better:  # else the effect's share of dry friction could not be carried to standstill
            shrinks[axis] = _shrink(start, before, after, rng)
        if table[axis].rms ** 2 > (1.0 + THERE) * table[axis].noise ** 2:
            where += _where(motions, joint, before, rng)
    return table, shrinks, where


def _efforts(start: Ready, named: Sequence[Judged]) -> list[Floats]:
    """Return the effort of the base with some effects, standstill included, per log of shape (n, nv)."""
    base = start.stage.base
    theta = (base.mean if base.whole is None else base.whole).copy()
    found = np.zeros(0)
    if named:
        moved, found = _change(start, named)
        theta += moved
    return [_effort(scene, base, theta, named, found) for scene in start.context.scenes]


def _change(start: Ready, named: Sequence[Judged]) -> tuple[Floats, Floats]:
    """Return by how much the base moves when effects are admitted, and the effects' coefficients.

    Only what means the same at rest as in motion may move: rows in motion say nothing about a contact.
    """
    base, p = start.stage.base, start.stage.base.count
    stage = admit(start.search_stage, named)
    known = np.zeros(p) if base.whole is None or base.change else base.whole
    free = np.concatenate([_steady(base), np.ones(stage.base.count - p, dtype=bool)])
    A, b = np.zeros((0, len(free))), np.zeros(0)
    for piece in stage.pieces:
        wide = np.zeros((len(piece.y), len(free)))
        wide[:, piece.columns] = piece.B
        own = piece.columns[piece.columns < p]
        left = piece.y - wide[:, own] @ known[own]
        rows = _moving(start, piece)
        A, b = np.concatenate([A, wide[rows]]), np.concatenate([b, left[rows]])
    held = np.diag(np.sqrt(np.maximum(np.diag(stage.base.precision), 0.0)))
    A, b = np.concatenate([A, held]), np.concatenate([b, np.zeros(len(free))])
    size = np.maximum(np.linalg.norm(A[:, free], axis=0), 1e-300)
    change = np.zeros(len(free))
    change[free] = np.linalg.lstsq(A[:, free] / size, b, rcond=1e-8)[0] / size
    return change[:p], change[p:]


def _moving(start: Ready, piece: Piece) -> Mask:
    """Return which rows of a piece are clearly in motion."""
    v = np.abs(start.stage.rows.motions[piece.channel.log].v[:, piece.channel.joint])
    return np.asarray(v[piece.channel.centres[piece.kept]] > MOVING * v.max())


def _steady(base: Base) -> Mask:
    """Return which coefficients mean the same at rest as in motion."""
    contact = ("presliding.s", "presliding.m", "presliding.d", "stribeck.s")
    count = len(base.mean) - len(base.slopes)
    names = enumerate(base.names)
    return np.array([k < count and not name.endswith(contact) for k, name in names])


def _effort(scene: Scene, base: Base, theta: Floats, named: Sequence[Judged], found: Floats) -> Floats:
    out = np.zeros(scene.motion.q.shape)
    for joint, where, values in base.columns(scene.motion):
        out[:, joint] += values @ theta[where]
    at = 0
    for item in named:
        width = len(item.theta)
        for joint, values in item.candidate.columns[scene.log]:
            out[:, joint] += values @ found[at : at + width]
        at += width
    return out


def _left(start: Ready, joint: int, efforts: Sequence[Floats]) -> list[tuple[int, Floats, Floats]]:
    """Return (log, time, tracking error that stays) of the data a loop was not fitted to."""
    rows = start.stage.rows
    held = any(rows.validation)
    data = [_data(s, joint, u) for s, u in zip(start.context.scenes, efforts, strict=True)]
    fitted = [d if held else _part(d, True) for d, v in zip(data, rows.validation, strict=True) if not v]
    # One log is enough for a loop: repeats of a command add no poles.
    model = identify_loop(fitted[0], Structure(), judged=False)
    out = []
    for k, d in enumerate(data):
        if not held or rows.validation[k]:
            moving = np.abs(rows.motions[k].v[:, joint])
            moving = moving > MOVING * moving.max()
            out += [(k, *x) for x in _errors(model, d if held else _part(d, False), moving)]
    return out


def _data(scene: Scene, joint: int, effort: Floats) -> LoopData:
    inertia = float(np.median(scene.inertia(joint)))
    d = effort[:, joint] - inertia * scene.motion.a[:, joint]
    return LoopData.of_axis(scene.motion, joint, d)


def _part(data: LoopData, first: bool) -> LoopData:
    cut = int(TRAINED * len(data.qr))
    parts = []
    for s in data.segments:
        part = slice(s.start, min(s.stop, cut)) if first else slice(max(s.start, cut), s.stop)
        if part.stop - part.start > 64:
            parts.append(part)
    if not parts:
        raise DataError(f"{data.axis}: too short to hold a part of it back")
    return data.within(parts)


def _errors(model: LoopModel, data: LoopData, moving: Mask) -> list[tuple[Floats, Floats]]:
    """Return time and error of the rows in motion, the ones that the effort's gap is stated on."""
    out = []
    for s in data.segments:
        y = model.simulate(data.qr[s], data.d[s])
        at = np.arange(s.start, s.stop)
        kept = moving[s] & (at >= s.start + round(SETTLED / data.step))
        if kept.any():
            out.append((data.step * at[kept], (data.outputs[s][:, 0] - y[:, 0])[kept]))
    if not out:
        raise DataError(f"{data.axis}: rests in the data that were held back")
    return out


Left = Sequence[tuple[int, Floats, Floats]]


def _gap(start: Ready, joint: int, before: Left, after: Left) -> Gap:
    """Return the gap of the tracking error; its noise is what repeats differ by."""
    motions = start.stage.rows.motions
    size = np.concatenate([(m.qr - m.q)[:, joint] for m in motions if m.qr is not None])
    rms, rest = _rms(before), _rms(after)
    return Gap(rms, rms / max(float(np.sqrt(np.mean(size**2))), 1e-300), _noise(start, joint), rest)


def _noise(start: Ready, joint: int) -> float:
    """Return the RMS difference of repeats over sqrt(2); without repeats the encoder's roughness."""
    rows = start.stage.rows
    errors = [(m.qr - m.q)[:, joint] for m in rows.motions if m.qr is not None]
    noise = between_repeats(errors, rows.commands)
    return roughness([errors[0]]) if noise is None else noise


def _shrink(start: Ready, before: Left, after: Left, rng: np.random.Generator) -> Shrink:
    blocks: list[tuple[float, float]] = []
    for (_, t, x), (_, _, y) in zip(before, after, strict=True):
        number = (t / STRETCH).astype(int)
        for k in np.unique(number):
            own = number == k
            blocks.append((float(np.sum(x[own] ** 2)), float(np.sum(y[own] ** 2))))
    sums = np.array(blocks)
    picked = sums[rng.integers(0, len(sums), (RESAMPLES, len(sums)))].sum(axis=1)
    share = 1.0 - picked[:, 1] / np.maximum(picked[:, 0], 1e-300)
    whole = 1.0 - float(sums[:, 1].sum() / max(sums[:, 0].sum(), 1e-300))
    low, high = (float(np.clip(np.quantile(share, q), -1.0, 1.0)) for q in (0.05, 0.95))
    on = "validation" if any(start.stage.rows.validation) else "held-out blocks"
    return Shrink(_rms(before), _rms(after), max(whole, -1.0), (low, high), max(whole, -1.0), on)


def _where(motions: Sequence[Motion], joint: int, before: Left, rng: np.random.Generator) -> list[Region]:
    """Return the regimes of its motion in which the tracking error is not foretold."""
    seen = [(motions[k], np.round(t / motions[k].step).astype(np.intp)) for k, t, _ in before]
    power = np.concatenate([x for _, _, x in before]) ** 2
    cells = regimes(seen, joint)
    if not cells or power.sum() <= 0.0:
        return []
    found = concentrated(cells, power, motions[0].names[joint], "e", rng)
    return sorted(found, key=lambda r: r.time_share - r.share)[:MOST]


def _rms(left: Left) -> float:
    return float(np.sqrt(np.mean(np.concatenate([x for _, _, x in left]) ** 2)))
