"""The noise of what a model leaves: what two runs of one command do not leave alike, and what is rough."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.samples import Sample, judged_rows
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.logs.repeats import labels
from pinotwin.motion import Motion
from pinotwin.signals import rms, roughness


def repeats(motions: Sequence[Motion]) -> list[tuple[int, int]]:
    """Return the places of every two logs of one command."""
    known = labels(motions)
    return [(a, b) for b, label in enumerate(known) for a in range(b) if known[a] == label]


def residual_noise(new: Sample, residual: Floats, motions: Sequence[Motion]) -> dict[int, float]:
    """Return joint -> RMS of the noise of what is left, (n, nv) [N or N·m]; of single runs none is known."""
    parts = np.split(residual, np.cumsum([len(m) for m in motions])[:-1])
    return noises(new, motions, parts) if repeats(motions) else {}


def noises(new: Sample, motions: Sequence[Motion], parts: Sequence[Floats]) -> dict[int, float]:
    """Return joint -> RMS of the noise [N or N·m] by which repeats differ, of channels (m, nv) of every log.

    Noise locked to the position, as of an encoder's steps, is the same in both runs: what is rough counts in any case.
    """
    pairs, out = repeats(motions), dict[int, float]()
    for j in new.joints:
        each = [difference(motions[a], motions[b], parts[a][:, j], parts[b][:, j], j) for a, b in pairs]
        out[j] = max([rough(new, j), *([rms(np.array(each))] if each else [])])
    return out


def rough(new: Sample, joint: int) -> float:
    """Return the noise of what is left from row to row; where no rows follow each other, that of the effort."""
    rows, left = new.samples(joint), new.residual[joint]
    breaks = np.flatnonzero(np.diff(rows) > 1) + 1
    parts = [x for x in np.split(left, breaks) if len(x) > 3]
    if sum(map(len, parts)) > 0.5 * len(rows):
        return min(roughness(parts), rms(left))
    u = new.motion.u[:, joint]
    return roughness([u[s] for s in new.motion.segments if np.isfinite(u[s]).all()] or [np.zeros(4)])


def difference(a: Motion, b: Motion, x: Floats, y: Floats, joint: int) -> float:
    """Return the noise of one channel by which two runs differ, x of one and y of the other, on rows in motion.

    What comes and goes within a tenth of the time, as a push in one of them, is no noise.
    """
    n = min(len(a), len(b))
    rows = judged_rows(a, joint)[:n] & judged_rows(b, joint)[:n] & np.isfinite(x[:n]) & np.isfinite(y[:n])
    if not rows.any():
        return 0.0
    begins = np.flatnonzero(np.diff(np.floor(a.t[:n][rows] / SETTINGS.cell), prepend=-np.inf))
    power = [rms(part) ** 2 for part in np.split((x[:n] - y[:n])[rows], begins[1:])]
    return float(np.sqrt(0.5 * np.mean(np.sort(power)[: int(np.ceil(0.9 * len(power)))])))
