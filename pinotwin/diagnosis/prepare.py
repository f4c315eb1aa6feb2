"""From logs to a whitened stage: the base model, its noise, and its first coefficients."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.base import Base, change_base, is_scattered
from pinotwin.diagnosis.context import Context, make_context
from pinotwin.diagnosis.deflection import bent
from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.noise import Noise, estimate, white_noise
from pinotwin.diagnosis.rows import Bend, Rows, at_rest_too, coarsest, take_rows
from pinotwin.diagnosis.shapes import shaped_base
from pinotwin.diagnosis.stage import Stage, build_stage
from pinotwin.effects.layout import effect_slices
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.twin.twin import Twin

QUICK = 3  # by how much fewer samples and rows a quick look takes at most


@dataclass(frozen=True)
class Ready:
    """All that a search starts from.

    Attributes:
        context: what candidates are made from.
        stage: whitened rows.
        theta: coefficients of the base, shape (p,).
        residuals: effort the base leaves, per channel [N or N·m].
    """

    context: Context
    stage: Stage
    theta: Floats
    residuals: tuple[Floats, ...]

    @property
    def search_stage(self) -> Stage:
        """The stage without validation logs: what effects may be fitted to."""
        return self.stage.fitted


def ready(
    subject: Machine | Twin,
    logs: Sequence[Log],
    validation: Sequence[Log],
    tick: Callable[[str], None],
    *,
    quick: bool = False,
) -> Ready:
    """Return the stage of a diagnosis.

    Args:
        subject: machine or twin.
        logs: logs to diagnose.
        validation: logs that no effect is fitted to.
        tick: called with each stage.
        quick: look at fewer samples and rows of long logs.
    """
    coarse = coarsest(logs, QUICK) if quick else 1
    machine, bend = _machine(subject)
    every = take_rows(machine, logs, validation, coarse=coarse, bend=bend)
    rows = every.fitted  # validation logs are sealed: nothing below is fitted to them
    tick("rows")
    if isinstance(subject, Twin):
        base = change_base(subject, every)
    else:
        base = shaped_base(machine, logs, rows, every.motions, white_noise(rows), coarse)
    tick("base")
    start = _settled(every, base, None)
    tick("noise")
    return start


def _machine(subject: Machine | Twin) -> tuple[Machine, Bend | None]:
    """Return the machine, and how its passive joints bend: only a twin knows their springs."""
    if isinstance(subject, Twin):
        bends = functools.partial(bent, subject) if subject.machine.passive else None
        return subject.machine, bends
    return subject.with_rigid_joints(), None


def at_rest(start: Ready) -> Ready:
    """Return the same with rows at standstill and reversals."""
    return _settled(at_rest_too(start.context.rows), start.stage.base, start.context)


def with_rest_of(start: Ready, rest: Ready, joints: Collection[int]) -> Ready:
    """Return the start with the rows at rest, and their noise, of some joints."""
    own, other = start.stage, rest.stage
    channels = [c for c in own.rows.channels if c.joint not in joints]
    channels += [c for c in other.rows.channels if c.joint in joints]
    channels.sort(key=lambda c: (c.log, c.joint))
    rows = replace(own.rows, channels=tuple(channels))
    noise = own.noise.with_joints(other.noise, joints)
    stage = build_stage(rows, own.base, noise)
    theta = _believed(stage.fitted, start.theta)
    return Ready(start.context, stage, theta, _residuals(rows, own.base, theta))


def _settled(every: Rows, base: Base, context: Context | None) -> Ready:
    """Return the stage with the noise that agrees with its own coefficients."""
    rows = every.fitted
    theta, residuals = _first(rows, base, white_noise(rows))
    noise = estimate(rows, residuals, _friction(rows, base), rich=_rich(rows, residuals))
    for _ in range(2):
        theta = _believed(build_stage(rows, base, noise), theta)
    residuals = _residuals(rows, base, theta)
    noise = estimate(rows, residuals, _friction(rows, base), rich=_rich(rows, residuals))
    seen = replace(every, channels=tuple(c for c in every.channels if c.joint in noise.models))
    context = make_context(seen, base, theta) if context is None else context
    return Ready(context, build_stage(seen, base, noise), theta, _residuals(seen, base, theta))


def _first(rows: Rows, base: Base, noise: Noise) -> tuple[Floats, tuple[Floats, ...]]:
    theta = _believed(build_stage(rows, base, noise), None)
    return theta, _residuals(rows, base, theta)


def _believed(stage: Stage, theta: Floats | None) -> Floats:
    """Return the coefficients of the base, those of a twin included."""
    moved = build_ledger(stage, theta).theta
    return moved + stage.base.mean if stage.base.change else moved


def _residuals(rows: Rows, base: Base, theta: Floats) -> tuple[Floats, ...]:
    columns = [base.columns(motion) for motion in rows.motions]
    out = []
    for c in rows.channels:
        effort = np.zeros((len(rows.motions[c.log]), 1))
        for joint, where, values in columns[c.log]:
            if joint == c.joint:
                effort[:, 0] += values @ theta[where]
        out.append(c.y - rows.thinner.apply(effort, c.centres)[:, 0])
    return tuple(out)


def _friction(rows: Rows, base: Base) -> list[Floats]:
    """Return the columns of friction that may scatter from run to run, per channel."""
    slices = effect_slices(base.effects)
    wanted = [w for e, w in zip(base.effects, slices, strict=True) if is_scattered(e)]
    columns = [base.columns(motion) for motion in rows.motions]
    out = []
    for c in rows.channels:
        mine = [x for j, w, x in columns[c.log] if j == c.joint and w in wanted]
        values = np.concatenate(mine, axis=1) if mine else np.zeros((len(rows.motions[c.log]), 0))
        out.append(rows.thinner.apply(values, c.centres))
    return out


def _rich(rows: Rows, residuals: Sequence[Floats]) -> list[Floats]:
    """Return the residual less what smooth functions of position, speed and acceleration explain."""
    out = []
    for c, r in zip(rows.channels, residuals, strict=True):
        m = rows.motions[c.log]
        features = [np.ones(len(r))]
        room = len(r) / 1200.0  # a rich model, but one row in ten a column at most
        for x, knots in ((m.q, 40), (m.v, 30), (m.a, 12)):
            count = int(knots * min(room, 1.0))
            if count >= 4:
                features += list(_hats(x[c.centres, c.joint], count).T)
        direction = np.sign(m.v[c.centres, c.joint])
        features.append(direction)
        W = np.stack(features, axis=1)
        W /= np.linalg.norm(W, axis=0) + 1e-12
        solved = np.linalg.solve(W.T @ W + 1e-6 * np.eye(W.shape[1]), W.T @ r)
        left = max(len(r) - W.shape[1], len(r) // 2)
        out.append((r - W @ solved) * np.sqrt(len(r) / left))
    return out


def _hats(x: Floats, count: int) -> Floats:
    knots = np.quantile(x, np.linspace(0.0, 1.0, count))
    knots = np.unique(knots)
    if len(knots) < 3:
        return np.zeros((len(x), 0))
    out = np.zeros((len(x), len(knots)))
    place = np.clip(np.searchsorted(knots, x) - 1, 0, len(knots) - 2)
    share = np.clip((x - knots[place]) / (knots[place + 1] - knots[place]), 0.0, 1.0)
    rows = np.arange(len(x))
    out[rows, place] = 1.0 - share
    out[rows, place + 1] += share
    return out
