"""Rows of a diagnosis: what is left of a log when the twin's effort is taken away, thinned for the search.

Prepared exactly as the twin's own logs: residuals and columns go through one zero-phase decimation. Only rows in
motion are used: at rest, dry friction holds any effort up to its level. An axis whose command stands still rests, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.diagnosis.rules import RULES
from pinotwin.effects import Effect
from pinotwin.effects.scene import Shaking, with_model_effort
from pinotwin.identification.assemble import Rows, choose_rows, thin
from pinotwin.motion import Motion
from pinotwin.signals import rms, since_start
from pinotwin.twin import Twin

ROW_RATE = 200.0
"""Rows a second that a search works on [Hz]: drive resonances that an effort shows lie below 60 Hz."""
MOST_ROWS = 12_000  # Rows of a joint beyond which every log is thinned further
SKIMMED_ROWS = 3_000
"""Instants from which the instances of one effect are ranked: enough for a hundred numbers."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The rows of one or several logs."""

    motion: Motion  # prepared log(s), with the channels of the model's own effort
    rows: Rows  # which rows, by joint
    residual: Mapping[int, Floats]  # joint -> measured effort less the twin's, shape (m,)
    effort: Mapping[int, Floats]  # joint -> measured effort, shape (m,)
    # what effects that shake others do to their own axis at the skimmed instants, (k, p); who feels it, and how much
    swings: dict[Effect, Floats] = field(default_factory=dict, repr=False)
    felt: dict[tuple[str, float], tuple[tuple[int, ...], Floats]] = field(default_factory=dict, repr=False)

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that have rows."""
        return self.rows.joints

    def only(self, joints: Collection[int]) -> Sample:
        """Return the rows of some joints."""
        kept = [k for k, j in enumerate(self.joints) if j in joints]
        if len(kept) == len(self.joints):
            return self
        chosen = tuple(self.joints[k] for k in kept)
        rows = replace(self.rows, joints=chosen, kept=tuple(self.rows.kept[k] for k in kept))
        part = [{j: x[j] for j in chosen} for x in (self.residual, self.effort)]
        return replace(self, rows=rows, residual=part[0], effort=part[1])

    def columns(self, effect: Effect) -> dict[int, Floats]:
        """Return the columns of an effect at every joint that it acts on, each of shape (m, p)."""
        found = effect.columns(self.motion)
        at = {joint: k for k, joint in enumerate(found.joints) if joint in self.joints}
        return {joint: self.picked(found.values[:, k, :], joint) for joint, k in at.items()}

    @cached_property
    def coarse(self) -> Motion:
        """The motion at the thinned instants."""
        if self.motion.decimation == 1 and self.motion.inside.all():
            return self.motion
        return self.motion.at(self.rows.sample, self.rows.block)

    def skimmed(self, effect: Effect, finer: Sample) -> tuple[dict[int, Floats], dict[int, Ints]]:
        """Return the columns of an effect on some rows of every joint, and these rows; near, and much faster.

        One without states is computed on them alone, another on all rows of a finer sample, once if it shakes others.
        """
        few, rows, place, motion = self._few
        if isinstance(effect, Shaking):
            if (load := (effect.axis, effect.load)) not in self.felt:
                self.felt[load] = effect.felt(motion)
            if effect not in self.swings:
                at = np.searchsorted(finer.rows.sample, self.rows.sample[few])
                self.swings[effect] = effect.swing(finer.coarse)[at]
            own, (joints, shares) = self.swings[effect], self.felt[load]
            pairs = [(k, j) for k, j in enumerate(joints) if j in place]
            return {j: own[place[j]] * shares[place[j], k, None] for k, j in pairs}, rows
        momentary = effect.depends in ("position", "velocity")
        found = effect.columns(motion if momentary else finer.coarse)
        if not momentary:
            at = np.searchsorted(finer.rows.sample, self.rows.sample[few])
            place = {j: at[k] for j, k in place.items()}
        pairs = [(at, j) for at, j in enumerate(found.joints) if j in place]
        return {j: found.values[place[j], at, :] for at, j in pairs}, rows

    @cached_property
    def _few(self) -> tuple[Ints, dict[int, Ints], dict[int, Ints], Motion]:
        """Random instants, their rows and places by joint, and their motion: every k-th would alias the position."""
        count = len(self.rows.sample)
        few = np.sort(np.random.default_rng(0).permutation(count)[:SKIMMED_ROWS])
        pairs = list(zip(self.rows.joints, self.rows.kept, strict=True))
        rows = {j: (np.cumsum(kept) - 1)[few[kept[few]]] for j, kept in pairs}
        place = {j: np.flatnonzero(kept[few]) for j, kept in pairs}
        return few, rows, place, self.coarse.at(few, self.rows.block[few])

    def picked(self, values: Floats, joint: int) -> Floats:
        """Return channels at the log's rate (n, ...) thinned, at the rows of one joint."""
        return thin(self.motion, values)[self.rows.kept[self.rows.joints.index(joint)]]

    def samples(self, joint: int) -> Ints:
        """Return the row of the motion that each row of a joint stands for."""
        return self.rows.sample[self.rows.kept[self.rows.joints.index(joint)]]

    def level(self, joint: int) -> float:
        """Return the RMS of what is left at one joint [N or N·m]."""
        return rms(self.residual[joint])

    def size(self, joint: int) -> float:
        """Return how much the measured effort of one joint varies [N or N·m]."""
        return float(np.std(self.effort[joint]))

    def foretold(self, joint: int) -> float:
        """Return how much the twin's effort of one joint varies [N or N·m]."""
        return float(np.std(self.effort[joint] - self.residual[joint]))


def left_of(twin: Twin, motion: Motion) -> tuple[Motion, Floats]:
    """Return a motion with the channels of the twin's effort, and measured effort less that, (n, nv) [N or N·m]."""
    motion = with_model_effort(motion, twin.effects, twin.theta)
    return motion, motion.u - twin.effort(motion)


def sample(motion: Motion, residual: Floats) -> Sample:
    """Return the rows of a prepared motion, with the model's own effort; DataError where no joint has a usable one.

    ``residual`` is measured effort less the twin's at the log's rate, (n, nv).
    """
    moving = sum(s.stop - s.start for s in motion.segments)
    count = max(motion.decimation, round(1.0 / (motion.step * ROW_RATE)), int(np.ceil(moving / MOST_ROWS)), 1)
    motion = replace(motion, decimation=count)
    rows = _sliding(motion, choose_rows(motion))
    thinned = thin(motion, np.nan_to_num(residual))
    effort = thin(motion, np.nan_to_num(motion.u))
    pairs = list(zip(rows.joints, rows.kept, strict=True))
    return Sample(
        motion=motion,
        rows=rows,
        residual={j: thinned[kept, j] for j, kept in pairs},
        effort={j: effort[kept, j] for j, kept in pairs},
    )


def _sliding(motion: Motion, rows: Rows) -> Rows:
    """Return the rows on which joints slide, all of a joint that never does; a joint that stands all along has none.

    Where no joint is asked to move all are kept.
    """
    asked = [j for j in rows.joints if motion.vr is None or _top(motion.vr[:, j]) > 0.0] or rows.joints
    pairs = [(j, mask) for j, mask in zip(rows.joints, rows.kept, strict=True) if j in asked]
    kept = tuple(_narrowed(mask, sliding(motion, j)[rows.sample]) for j, mask in pairs)
    return replace(rows, joints=tuple(j for j, _ in pairs), kept=kept)


def sliding(motion: Motion, joint: int) -> Mask:
    """Return where a joint slides: not where its command has stood for a while and it but trembles, shape (n,).

    The first moments count: dry friction is seen best as an axis settles. Before a first move nothing settles.
    """
    if motion.vr is None:
        return np.ones(len(motion), dtype=bool)
    v, asked = np.abs(motion.v[:, joint]), np.abs(motion.vr[:, joint])
    goes = asked >= RULES.standing * _top(asked)
    since = np.full(len(v), np.inf)
    for s in motion.segments:
        at = np.arange(len(goes[s]), dtype=float)
        since[s] = motion.step * (at - np.maximum.accumulate(np.where(goes[s], at, -np.inf)))
    begins = np.zeros(len(v), dtype=bool)
    begins[motion.inside] = since_start(motion.t[motion.inside]) < RULES.starting
    swings = (v >= RULES.trembling * _top(v)) & ~(np.isinf(since) & begins)
    return np.asarray((since <= RULES.settles) | swings)


def judged_rows(motion: Motion, joint: int) -> Mask:
    """Return the rows of a prepared log on which a gap is stated: in motion, with an effort, sliding, shape (n,)."""
    return _narrowed(motion.moving(joint), sliding(motion, joint))


def _narrowed(rows: Mask, by: Mask) -> Mask:
    """Return the rows that another mask has too, all of them where it has none."""
    left = rows & by
    return left if left.any() else rows


def _top(x: Floats) -> float:
    return float(np.nanmax(np.abs(x), initial=0.0))
