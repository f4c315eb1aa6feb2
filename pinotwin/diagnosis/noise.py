"""The noise of a diagnosis: an autoregression per joint, and run-to-run scatter of friction.

With repeats of a command the noise is the difference between runs, whatever the model does; without,
it is taken from the residual of a rich model, and said to be assumed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.rows import Channel, Rows
from pinotwin.signals import clipped_rms
from pinotwin.solve.autoregression import burg

ORDER = 6
USUAL = 0.999  # of the samples: the others are an event's, not noise
SCATTER = 0.015  # relative run-to-run scatter of friction that is assumed


@dataclass(frozen=True)
class Noise:
    """What is known of the noise.

    Attributes:
        kind: ``repeats`` or ``assumed``.
        models: autoregressive coefficients per joint.
        level: standard deviation of the innovation per joint [N or N·m].
        rms: standard deviation of the noise per joint [N or N·m].
        scatter: relative run-to-run scatter of friction coefficients.
    """

    kind: Literal["repeats", "assumed"]
    models: Mapping[int, Floats]
    level: Mapping[int, float]
    rms: Mapping[int, float]
    scatter: float = SCATTER

    def whiten(self, channel: Channel, x: Floats) -> Floats:
        """Return rows (m, k) with the noise made white and of unit size; see :meth:`kept`."""
        a = self.models[channel.joint]
        out = x.copy()
        for run in channel.runs:
            part = x[run]
            for k, c in enumerate(a, start=1):
                if k < len(part):
                    out[run][k:] -= c * part[:-k]
        return np.asarray(out / self.level[channel.joint])

    def with_joints(self, other: Noise, joints: Collection[int]) -> Noise:
        """Return this noise with another one's of some joints."""
        models = {**self.models, **{j: other.models[j] for j in joints}}
        level = {**self.level, **{j: other.level[j] for j in joints}}
        rms = {**self.rms, **{j: other.rms[j] for j in joints}}
        return Noise(self.kind, models, level, rms, self.scatter)

    def kept(self, channel: Channel) -> Ints:
        """Return the rows that have a full past, shape (m,)."""
        order = len(self.models[channel.joint])
        return np.concatenate([np.arange(r.start + order, r.stop) for r in channel.runs])


def white_noise(rows: Rows) -> Noise:
    """Return a noise that is white and as large as the effort: the start of the estimate."""
    joints = rows.joints
    size = {j: max(float(np.std([*_all(rows, j)])), 1e-9) for j in joints}
    return Noise("assumed", {j: np.zeros(0) for j in joints}, size, size)


def _all(rows: Rows, joint: int) -> Floats:
    return np.concatenate([c.y for c in rows.channels if c.joint == joint])


def between_repeats(values: Sequence[Floats], commands: Sequence[int]) -> float | None:
    """Return by how much two runs of one command differ, over sqrt(2); None without repeats.

    Args:
        values: a signal in every run, each of shape (n,).
        commands: a label per run, the same for repeats.
    """
    for a, b in combinations(range(len(values)), 2):
        if commands[a] == commands[b]:
            n = min(len(values[a]), len(values[b]))
            return float(np.std(values[a][:n] - values[b][:n]) / np.sqrt(2.0))
    return None


def estimate(
    rows: Rows, residuals: Sequence[Floats], friction: Sequence[Floats], *, rich: Sequence[Floats]
) -> Noise:
    """Estimate the noise.

    Args:
        rows: the rows.
        residuals: residual of the base model per channel, each of shape (m,).
        friction: columns of friction that may scatter, per channel, each of shape (m, k).
        rich: residual of a rich model per channel, used where there are no repeats.
    """
    models, level, rms = {}, {}, {}
    for joint in rows.joints:
        at = [k for k, c in enumerate(rows.channels) if c.joint == joint]
        stretches = _differences(rows, at, residuals, friction) if rows.repeated else []
        if sum(map(len, stretches)) < 50:
            stretches = [rich[k][run] for k in at for run in rows.channels[k].runs]
        a = burg(stretches, ORDER if sum(map(len, stretches)) > 40 * ORDER else 2)
        models[joint] = a
        white = np.concatenate([_filtered(x, a) for x in stretches if len(x) > len(a)])
        size = np.concatenate(stretches)
        floor = 1e-6 * max(float(np.std(_all(rows, joint))), 1e-9)
        level[joint] = max(clipped_rms(white, USUAL), floor)
        rms[joint] = max(clipped_rms(size, USUAL), floor)
    return Noise("repeats" if rows.repeated else "assumed", models, level, rms)


def _filtered(x: Floats, a: Floats) -> Floats:
    out = x[len(a) :].copy()
    for k, c in enumerate(a, start=1):
        out -= c * x[len(a) - k : len(x) - k]
    return out


def _differences(
    rows: Rows, at: Sequence[int], residuals: Sequence[Floats], friction: Sequence[Floats]
) -> list[Floats]:
    """Return half differences of repeats, the runs' own friction taken out, as unbroken stretches."""
    out = []
    labels = [rows.commands[rows.channels[k].log] for k in at]
    for label in sorted(set(labels)):
        group = [k for k, other in zip(at, labels, strict=True) if other == label]
        for a, b in pairwise(group):
            out += _pair(
                rows.channels[a], rows.channels[b], residuals[a], residuals[b], friction[a], friction[b]
            )
    return out


def _pair(one: Channel, two: Channel, r1: Floats, r2: Floats, f1: Floats, f2: Floats) -> list[Floats]:
    common, i, j = np.intersect1d(one.centres, two.centres, return_indices=True)
    if len(common) < 60:
        return []
    d = (r1[i] - r2[j]) / np.sqrt(2.0)
    S = np.column_stack([f1[i], f2[j], np.ones(len(i))])
    d = (d - S @ np.linalg.lstsq(S, d, rcond=1e-9)[0]) * np.sqrt(len(d) / (len(d) - S.shape[1]))
    step = np.median(np.diff(common))
    cuts = np.flatnonzero(np.diff(common) > 1.5 * step) + 1
    return [x for x in np.split(d, cuts) if len(x) > ORDER]
