r"""Pushes from outside: stretches of time in which the residual stands away from what it is elsewhere.

A constant force of any length, found where sum(r)^2 / n is far beyond what the same search reaches on the twin's own
logs. A cause that returns with the motion explains other logs as well and is preferred if it closes as much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.rules import RULES, Rules

WIDTHS = np.geomspace(0.04, 6.0, 15)  # Lengths of an episode that are tried [s]
MOST = 40  # Most episodes of one axis


@dataclass(frozen=True)
class Episode:
    """One push."""

    start: float  # [s]
    end: float  # [s]. segment: stretch of the motion it lies in
    segment: int
    force: float  # its mean [N or N·m], with the sign of a load on the axis
    error: float  # standard error of that


@dataclass(frozen=True, eq=False)
class Episodes:
    """The pushes on one axis."""

    joint: int  # its column
    episodes: Sequence[Episode]  # in order of time
    # squared residual that they close, each half of an episode predicted by the other, floor units
    gain: float
    share: float  # the same over the squared residual of the axis
    gains: Floats  # the gain of every block, shape (K,)
    t: Floats  # time of every row of the axis [s], shape (m,)
    rows: Mask  # which of them lie in an episode, shape (m,)
    # what the pushes add to the residual; a strong part of a longer push is an episode within another one, so
    # that it is no sum of the episodes' forces [N or N·m], shape (m,)
    course: Floats

    @property
    def times(self) -> int:
        """How often the axis was pushed: parts of one push, one way and without a pause, count once."""
        count = 0
        ends = {1.0: (-1, -np.inf), -1.0: (-1, -np.inf)}
        for e in sorted(self.episodes, key=lambda e: (e.segment, e.start)):
            way = 1.0 if e.force >= 0.0 else -1.0
            segment, end = ends[way]
            goes_on = segment == e.segment and e.start <= end
            count += not goes_on
            ends[way] = (e.segment, max(end, e.end) if goes_on else e.end)
        return count

    def spans(self) -> list[tuple[float, float]]:
        """Return when the axis was pushed [s], from and to, in order; the same time of several logs is one span."""
        out: list[tuple[float, float]] = []
        for e in sorted(self.episodes, key=lambda e: e.start):
            if out and e.start < out[-1][1]:
                out[-1] = out[-1][0], max(e.end, out[-1][1])
            else:
                out.append((e.start, e.end))
        return out

    @property
    def swinging(self) -> float:
        """Share of the pushes within whose own length there is one the other way, half as strong or more."""
        return float(np.mean([any(_swings(e, other) for other in self.episodes) for e in self.episodes]))


def _swings(e: Episode, other: Episode) -> bool:
    apart = max(other.start - e.end, e.start - other.end)
    near = e.segment == other.segment and apart < e.end - e.start
    return near and e.force * other.force < 0.0 and abs(other.force) > 0.5 * abs(e.force)


def episodes(
    sample: Sample,
    residual: Mapping[int, Floats],
    own: Mapping[int, Floats] | None,
    own_sample: Sample | None,
    floor: Mapping[int, float],
    joint: int,
    rules: Rules = RULES,
) -> Episodes | None:
    """Return the pushes on one axis, None if there are none.

    ``residual`` and, on the twin's ``own`` logs, that of ``own_sample`` are by joint in units of the ``floor``.
    """
    r, t, segment = residual[joint], *_time(sample, joint)
    if own is not None and own_sample is not None and joint in own:
        usual = max(_best(own[joint], *_time(own_sample, joint))[0], 1e-300)
    else:
        usual = _typical(r, t, segment)
    left = r.copy()
    found: list[tuple[int, int]] = []
    far = 0.0
    while len(found) < MOST:
        gain, a, b = _best(left, t, segment)
        if gain < rules.push_also * usual:
            break
        far += gain
        moved = _edges(left, segment, a, b)
        a, b = (a, b) if moved in found else moved
        found.append((a, b))
        left[a:b] -= left[a:b].mean()
    if far < rules.push * usual:
        return None
    inside = np.zeros(len(r), dtype=bool)
    for a, b in found:
        inside[a:b] = True
    if inside.mean() > rules.most_of_time:
        return None
    left = _closed(r, found)
    block = sample.block[joint]
    before, after = (np.bincount(block, x * x, sample.blocks).astype(float) for x in (r, left))
    gain = float(before.sum() - after.sum())
    listed = [_episode(sample, floor[joint], r, t, segment, a, b) for a, b in sorted(found)]
    share = gain / max(float(r @ r), 1e-300)
    course = floor[joint] * (r - _levelled(r, found))
    return Episodes(joint, listed, gain, share, before - after, t, inside, course)


def _time(sample: Sample, joint: int) -> tuple[Floats, Ints]:
    """Return the time of every row of a joint, and the stretch of the motion it lies in."""
    at = sample.samples(joint)
    kept = sample.rows.kept[sample.rows.joints.index(joint)]
    return sample.motion.t[at], sample.rows.block[kept]


def _windows(r: Floats, t: Floats, segment: Ints, width: float) -> tuple[Floats, Ints, Ints]:
    """Return gain, first row and row after the last of every window of one width."""
    ends = np.searchsorted(t + 1e6 * segment, t + 1e6 * segment + width)
    total = np.concatenate([[0.0], np.cumsum(r)])
    starts = np.arange(len(r))
    count = ends - starts
    full = count >= 4
    gain = np.where(full, (total[ends] - total[starts]) ** 2 / np.maximum(count, 1), 0.0)
    return gain, starts, ends


def _best(r: Floats, t: Floats, segment: Ints) -> tuple[float, int, int]:
    best = (0.0, 0, 0)
    for width in WIDTHS:
        gain, starts, ends = _windows(r, t, segment, float(width))
        k = int(np.argmax(gain))
        if gain[k] > best[0]:
            best = (float(gain[k]), int(starts[k]), int(ends[k]))
    return best


def _edges(r: Floats, segment: Ints, a: int, b: int) -> tuple[int, int]:
    """Return the edges of an episode moved to where its gain is largest."""
    size = max(b - a, 4)
    low, high = max(0, a - size), min(len(r), b + size)
    same = np.flatnonzero(segment[low:high] == segment[a]) + low
    low, high = int(same[0]), int(same[-1]) + 1
    total = np.concatenate([[0.0], np.cumsum(r[low:high])])
    for _ in range(3):
        for k in np.arange(low, b - 3)[:: max(1, (b - low) // 200)]:
            if _gain(total, low, int(k), b) > _gain(total, low, a, b):
                a = int(k)
        for k in np.arange(a + 4, high + 1)[:: max(1, (high - a) // 200)]:
            if _gain(total, low, a, int(k)) > _gain(total, low, a, b):
                b = int(k)
    return a, b


def _gain(total: Floats, low: int, a: int, b: int) -> float:
    return float((total[b - low] - total[a - low]) ** 2 / (b - a))


def _typical(r: Floats, t: Floats, segment: Ints) -> float:
    """Return what the largest window of a residual without pushes may reach: from its quieter windows."""
    gains = (_windows(r, t, segment, float(width))[0] for width in WIDTHS)
    return max(6.0 * max(float(np.quantile(gain, 0.75)) for gain in gains), 1e-300)


def _levelled(r: Floats, found: Sequence[tuple[int, int]], told: Mask | None = None) -> Floats:
    """Return what the mean of one episode after the other leaves, as they were found; ``told`` by these rows alone."""
    left, by = r.copy(), np.ones(len(r), dtype=bool) if told is None else told
    for a, b in found:
        left[a:b] -= left[a:b][by[a:b]].mean()
    return left


def _closed(r: Floats, found: Sequence[tuple[int, int]]) -> Floats:
    """Return what constants leave, every other pair of rows predicted from those between them.

    Of a strong part within a longer push, the constant is told by what that leaves of the same rows.
    """
    half = (np.arange(len(r)) // 2) % 2 == 0
    return np.where(half, _levelled(r, found, ~half), _levelled(r, found, half))


def _episode(sample: Sample, floor: float, r: Floats, t: Floats, segment: Ints, a: int, b: int) -> Episode:
    part = r[a:b] * floor
    force = -float(part.mean())
    pieces = np.array_split(part, max(2, min(8, len(part) // 2)))
    means = np.array([p.mean() for p in pieces])
    error = float(means.std(ddof=1) / np.sqrt(len(means)))
    step = sample.motion.step * sample.motion.decimation
    return Episode(float(t[a]), float(t[b - 1] + step), int(segment[a]), force, error)
