"""A drive at its limit: an effort that rests at a largest size while the axis is left behind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import median_abs_deviation

from pinotwin.arrays import Floats, Mask
from pinotwin.motion import Motion
from pinotwin.signals import rms, roughness, runs

LIMITED = 2e-3  # share of rows at the limit that is worth a name
WORSE = 8.0  # tracking error there over the error elsewhere: hard acceleration alone reaches 7
OVER = 0.06  # of the rows at a limit: rows above it that a filter leaves; acceleration leaves more
SPIKE = 40.0  # density of sizes at the limit over that below it, if it is FLAT and the error LEFT_BEHIND
ALWAYS = 0.9  # of the rows that move: from here nothing in a log tells how an axis follows without the limit
LEFT_BEHIND = 1.3  # the tracking error there over that elsewhere then
FLAT = 1.1  # spread of the effort there over its noise then (medians): steady acceleration leaves 1.4 to 2.8
ASKED = 10.0  # or spread there of the effort that the command asks for, over that of the reading; no limit: about 1
STANDING = 0.01  # of the top speed: below it an axis stands
OVER_LEVEL = 1.05  # of a limit: what a log may show above it, its current loop's overshoot
HOLD = 0.02  # [s] an effort must rest at its largest size to be at a drive's limit
AFTER = 0.05  # [s] that a limit is felt in the tracking error once it is left


@dataclass(frozen=True)
class Limit:
    """The limit of one drive, reached."""

    level: float  # largest effort [N or N·m]
    share: float  # of the samples that are at it
    worst: float  # tracking error there over that elsewhere
    samples: tuple[Mask, ...]  # per log, samples at the limit or just after it, each of shape (n,)


def reached(
    motions: Sequence[Motion],
    joint: int,
    usual: float = np.inf,
    asked: Callable[[Motion], Floats] | None = None,
) -> Limit | None:
    """Return the limit that the drive in column ``joint`` reached, None if it did not, or no command tells.

    ``usual`` is the RMS of its tracking error in logs that meet no limit, for a drive that is at its limit whenever it
    moves; ``asked`` gives the effort (n,) that a motion's command asks of it, for a reading that something slower than
    its noise moves while it rests.
    """
    if not motions or any(m.vr is None for m in motions):
        return None
    efforts = [m.u[:, joint] for m in motions]
    if not all(np.isfinite(u).any() for u in efforts):
        return None
    noise = float(np.mean([_noise(m, u) for m, u in zip(motions, efforts, strict=True)]))
    going = [_moving(m, joint) for m in motions]
    low = lowest(efforts, noise)
    near = [rests(u, low, m.step) & x for m, u, x in zip(motions, efforts, going, strict=True)]
    after = [followed(x, round(AFTER / m.step)) for m, x in zip(motions, near, strict=True)]
    at, late = np.concatenate(near), np.concatenate(after)
    size = np.abs(np.nan_to_num(np.concatenate(efforts)))
    e = np.concatenate([m.error[:, joint] for m in motions])
    share = float(np.mean(at))
    if share < LIMITED:
        return None
    always = share > ALWAYS * float(np.mean(np.concatenate(going)))
    worst = rms(e) / usual if always else rms(e[late]) / max(rms(e[~late]), 1e-300)
    level = float(np.median(size[at]))
    over, spike = _plateau(size[np.concatenate(going)], level, noise)
    clear = worst > WORSE or (spike > SPIKE and worst > LEFT_BEHIND)
    if over > OVER * share or not clear:
        return None
    if worst <= WORSE and not _holds(motions, joint, at, noise, asked):
        return None
    return Limit(level, share, float(worst), tuple(after))


def _holds(
    motions: Sequence[Motion], joint: int, at: Mask, noise: float, asked: Callable[[Motion], Floats] | None
) -> bool:
    """Return whether an effort stays where it rests, but for its noise or while its command asks for other ones."""
    u = np.concatenate([m.u[:, joint] for m in motions])[at]
    spread = _spread(np.abs(u))
    if spread < FLAT * noise:
        return True
    if asked is None:
        return False
    return _spread(np.concatenate([asked(m) for m in motions])[at] * np.sign(u)) >= ASKED * spread


def _spread(x: Floats) -> float:
    return float(median_abs_deviation(x, scale="normal"))


def exceeded(efforts: Sequence[Floats], level: float) -> bool:
    """Return whether efforts, (n,) a log, exceed a level [N or N·m] for longer than noise takes them there."""
    logs = [u for u in (u[np.isfinite(u)] for u in efforts) if len(u) > 3]
    return any(np.mean(np.abs(u) > OVER_LEVEL * level + 4.0 * roughness([u])) > LIMITED for u in logs)


def _noise(m: Motion, u: Floats) -> float:
    """Return the noise of an effort; of a filtered one at the rows that are fitted: from row to row it is smooth."""
    parts = [u[s][:: m.decimation] for s in m.segments]
    return roughness([x[np.isfinite(x)] for x in parts])


def _moving(m: Motion, joint: int) -> Mask:
    """Return where an axis or its command moves: an effort that rests while both stand holds a weight."""
    assert m.vr is not None
    speeds = [np.abs(np.nan_to_num(v[:, joint])) for v in (m.v, m.vr)]
    return np.logical_or.reduce([v > STANDING * v.max(initial=0.0) for v in speeds])


def _plateau(size: Floats, level: float, noise: float) -> tuple[float, float]:
    """Return the share of samples above a level, and how much denser sizes are at it than below it."""
    width = max(4.0 * noise, 0.01 * level)
    at = np.count_nonzero(np.abs(size - level) < width)
    below = np.count_nonzero((size > level - 4.0 * width) & (size < level - 2.0 * width))
    return float(np.mean(size > level + width)), float(at) / float(max(int(below), 1))


def followed(mask: Mask, samples: int) -> Mask:
    """Return the mask with the samples that follow each true one."""
    out = mask.copy()
    for k in range(1, samples + 1):
        out[k:] |= mask[:-k]
    return out


def lowest(efforts: Sequence[Floats], noise: float) -> float:
    """Return the least size near the largest that an effort rests at in all logs, [N or N·m].

    Noise and the current loop overshoot a limit: the level is the size met most often among the largest fifth.
    """
    size = np.abs(np.nan_to_num(np.concatenate(efforts)))
    top = float(size.max(initial=0.0))
    counts, edges = np.histogram(size, np.linspace(0.8 * top, top * (1.0 + 1e-12) + 1e-300, 21))
    return float(edges[int(np.argmax(counts))]) - 5.0 * noise - 0.005 * top


def rests(u: Floats, low: float, step: float) -> Mask:
    """Return where an effort u (n,) stays for a while at a size ``low`` [N or N·m] or beyond; ``step`` in [s]."""
    out = np.zeros(len(u), dtype=bool)
    for part in runs(np.abs(np.nan_to_num(u)) >= low):
        length = part.stop - part.start
        out[part] = length * step >= HOLD and length >= 3
    return out
