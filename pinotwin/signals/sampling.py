"""The clock of a recording: its step, its breaks, and interpolation onto a uniform one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError


def joined(t: Floats, pause: float = np.inf) -> list[slice]:
    """Return the rows of every log that was joined: time (n,) falls back between two or a ``pause`` [s] is longer."""
    step = np.diff(t)
    ends = np.flatnonzero((step < 0.0) | (step > pause)) + 1
    return [slice(a, b) for a, b in pairwise([0, *ends.tolist(), len(t)])]


def since_start(t: Floats) -> Floats:
    """Return the time since the start of the log, where logs are joined since that of each [s], shape (n,)."""
    return np.concatenate([t[part] - t[part][:1] for part in joined(t)])


def runs(mask: Mask) -> list[slice]:
    """Return the unbroken stretches of true rows, mask of shape (n,)."""
    edges = np.flatnonzero(np.diff(np.r_[0, mask.astype(np.int8), 0]))
    return [slice(a, b) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)]


@dataclass(frozen=True)
class Clock:
    """What the time stamps say."""

    step: float  # median interval [s]
    jitter_rms: float  # scatter of the intervals about the step [s], breaks left out
    jitter_max: float  # largest deviation of an interval from the step [s], breaks left out
    duplicated: tuple[int, ...]  # rows whose stamp equals the one before
    backward: tuple[int, ...]  # rows whose stamp is below the one before
    gaps: tuple[int, ...]  # rows before which more than (1 + tol) steps passed
    missing: int  # samples that the gaps swallowed, in steps
    longest: float  # longest gap [s], 0 for none

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.step


def clock(t: Floats, tol: float = 0.5) -> Clock:
    """Describe a time axis of shape (n,) [s]; ``tol`` is the share of a step that makes a gap."""
    dt = np.diff(np.asarray(t, dtype=float))
    forward = dt[dt > 0]
    if not len(forward):
        raise DataError("the time axis does not advance; check column and unit of t")
    step = float(np.median(forward))
    regular = dt[(dt > 0) & (dt <= (1 + tol) * step)] - step
    gaps = np.flatnonzero(dt > (1 + tol) * step)
    lost = dt[gaps] / step - 1
    return Clock(
        step=step,
        jitter_rms=float(np.sqrt(np.mean(regular**2))),
        jitter_max=float(np.abs(regular).max()),
        duplicated=_rows(dt == 0),
        backward=_rows(dt < 0),
        gaps=tuple(int(i) + 1 for i in gaps),
        missing=int(np.round(lost[np.isfinite(lost)]).sum()),
        longest=float(dt[gaps].max(initial=0.0)),
    )


def _rows(breaks: Mask) -> tuple[int, ...]:
    return tuple(int(i) + 1 for i in np.flatnonzero(breaks))


def segments(t: Floats, valid: Mask | None = None) -> tuple[slice, ...]:
    """Return the ``valid`` stretches in which every interval of t (n,) [s] is within half a step of the median one."""
    dt = np.diff(t)
    step = clock(t).step
    good = np.isfinite(t) if valid is None else np.isfinite(t) & valid
    joined = (np.abs(dt - step) <= 0.5 * step) & good[1:] & good[:-1]
    bounds = [0, *(np.flatnonzero(~joined) + 1).tolist(), len(t)]
    return tuple(slice(a, b) for a, b in pairwise(bounds) if good[a])


def lagrange_error(t: Floats, x: Floats) -> Floats:
    """Return how far samples (n, k) at times (n,) lie from the cubic through two neighbours each side, (n - 4, k)."""
    near = [t[k : len(t) - 4 + k] for k in (0, 1, 3, 4)]
    error = np.array(x[2:-2], dtype=float)
    for i, k in enumerate((0, 1, 3, 4)):
        weight = np.ones(len(t) - 4)
        for j, other in enumerate(near):
            if j != i:
                weight *= (t[2:-2] - other) / (near[i] - other)
        error -= weight[:, None] * x[k : len(x) - 4 + k]
    return error


def uniform(
    t: Floats, x: Floats, rate: float, stretches: Sequence[slice]
) -> tuple[Floats, Floats, tuple[slice, ...]]:
    """Return times (m,) [s] and samples (m, k) on a grid of ``rate`` [Hz] in each stretch, and the new stretches."""
    times, values, parts = [], [], []
    done = 0
    for part in stretches:
        span = t[part.stop - 1] - t[part.start]
        grid = t[part.start] + np.arange(int(np.floor(span * rate + 1e-6)) + 1) / rate
        columns = [np.interp(grid, t[part], x[part, j]) for j in range(x.shape[1])]
        times.append(grid)
        values.append(np.column_stack(columns) if columns else np.empty((len(grid), 0)))
        parts.append(slice(done, done + len(grid)))
        done += len(grid)
    if not times:
        raise DataError("no unbroken stretch to resample; check the time axis")
    return np.concatenate(times), np.concatenate(values), tuple(parts)


def hats(x: Floats, low: float, high: float, count: int) -> Floats:
    """Return the weights of knots from ``low`` to ``high``, beyond them those of the last knot, shape (n, count)."""
    place = np.clip((x - low) / max(high - low, 1e-300), 0.0, 1.0) * (count - 1)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(count))))
