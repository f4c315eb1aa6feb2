"""What the numbers of one channel give away: resolution, rounding, flat tops, spikes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pinotwin.arrays import Floats, Mask

_MOST = 200_000  # rows looked at for the resolution: unique values settle long before
_FLOAT = 1e-9  # numbers closer than this (relative) are equal but for rounding in the conversion


def quantisation_step(x: Floats) -> float | None:
    """Return the step of which 95 % of the differences between values are multiples within a tenth, or None."""
    values = np.unique(x[np.isfinite(x)][:_MOST])
    if len(values) < 4:
        return None
    gaps = np.diff(values)
    gaps = gaps[gaps > _FLOAT * np.abs(values).max()]
    if len(gaps) < 3:
        return None
    least = np.percentile(gaps, 1, method="lower")
    guess = float(np.median(gaps[gaps < 1.5 * least]))
    near = gaps[gaps < 50.0 * guess] / guess
    whole = np.round(near)
    if len(near) < 3 or np.mean(np.abs(near - whole) < 0.1) < 0.95:
        return None
    whole = np.maximum(whole, 1.0)
    return float(guess * (near @ whole) / (whole @ whole))


def lattice(x: Floats) -> tuple[float, float] | None:
    """Return step and origin of the lattice on which 95 % of a channel's values lie to a tenth of a step, or None."""
    step = quantisation_step(x)
    if step is None:
        return None
    values = np.unique(x[np.isfinite(x)])
    near = float(values[len(values) // 2])
    far, span = np.abs(values - near), 50.0
    while True:
        within = values[far < span * step] - near
        whole = np.round(within / step)
        if whole @ whole > 0.0:
            step = float((within @ whole) / (whole @ whole))
        if span * step > far.max():
            break
        span *= 10.0
    rest = (values - near) / step
    off = rest - np.round(rest)
    middle = float(np.median(off))
    if step <= 0.0 or np.mean(np.abs(off - middle) < 0.1) < 0.95:
        return None
    return step, near + middle * step


def significant_digits(x: Floats) -> int | None:
    """Return to how many digits the numbers were rounded, None where their steps are no finer for smaller ones."""
    values = np.unique(np.abs(x[np.isfinite(x)][:_MOST]))
    values = values[values > 1e-290]  # what has died away has no digits left
    if len(values) < 10:
        return None
    decade = np.floor(np.log10(values * (1 + _FLOAT)))
    for digits in range(2, 7):
        unit = 10.0 ** (decade - digits + 1)
        off = np.abs(values / unit - np.round(values / unit))
        if np.mean(off > 1e-3) <= 0.001:
            below = values[decade < decade.max()]
            coarse = below / 10.0 ** (decade.max() - digits + 1)
            finer = np.abs(coarse - np.round(coarse)) > 1e-3
            return digits if len(below) and np.mean(finer) > 0.05 else None
    return None


def saturated_rows(x: Floats) -> Mask:
    """Return the rows on a flat top or bottom: 0.1 % of all, 3 in a row, four times as many as beside it."""
    flat = np.zeros(len(x), dtype=bool)
    good = np.isfinite(x)
    if good.sum() < 10 or np.ptp(x[good]) == 0:
        return flat
    known = x[good]
    low, high = known.min(), known.max()
    span = float(high - low)
    for extreme, beyond in ((high, known[known < high].max()), (low, known[known > low].min())):
        at = np.abs(x - extreme) <= _FLOAT * span
        at[~good] = False
        near = max(0.02 * span, 1.01 * abs(float(extreme - beyond)))
        beside = (np.abs(x - extreme) <= near) & ~at & good
        held = (at[2:] & at[1:-1] & at[:-2]).any()
        if held and at.sum() >= max(5, 0.001 * len(x)) and at.sum() > 4 * beside.sum():
            flat |= at
    return flat


def jump_rows(q: Floats) -> Mask:
    """Return the rows of a position that stand 50 usual changes apart from both neighbours, which agree."""
    apart = np.zeros(len(q), dtype=bool)
    middle = np.median(np.stack([q[:-2], q[1:-1], q[2:]]), axis=0)
    with np.errstate(invalid="ignore"):
        apart[1:-1] = np.abs(q[1:-1] - middle) > _jump(q, 50.0, 0.01)
    return apart


def _jump(q: Floats, steps: float, share: float) -> float:
    """Return the larger of so many usual changes a row and a share of the range; inf where too few rows change."""
    step = np.abs(np.diff(q))
    usual = step[np.isfinite(step) & (step > 0)]
    if len(usual) < 10:
        return np.inf
    return max(steps * float(np.median(usual)), share * float(np.nanmax(q) - np.nanmin(q)))


def sentinel(q: Floats) -> tuple[float, int, Mask] | None:
    """Return a value beyond all others that a channel jumps to and leaves by jumps, how often, and its rows."""
    jump = np.abs(np.diff(q)) > _jump(q, 20.0, 0.2)
    landed, counts = np.unique(q[1:][jump], return_counts=True)
    if not len(landed) or counts.max() < 3:
        return None
    value = float(landed[np.argmax(counts)])
    left = int(np.sum(q[:-1][jump] == value))
    rows = np.asarray(q == value)
    if left < 3 or not _stands_alone(q, value, rows, jump):
        return None
    return value, int(counts.max()), rows


def _stands_alone(q: Floats, value: float, rows: Mask, jump: Mask) -> bool:
    others = q[~rows & np.isfinite(q)]
    if not len(others):
        return False
    low, high = float(others.min()), float(others.max())
    if np.mean(np.abs(others - value) < 0.05 * (high - low)) > 0.02:
        return False
    edges = np.diff(rows.astype(int)) != 0  # where the value is reached and left
    return not low < value < high or bool(np.mean(jump[edges]) > 0.9)


def repeated_rows(x: Floats) -> tuple[Mask, Mask]:
    """Return which rows of a table (n, k) are exact copies of another, and of the one before."""
    keys = _hashes(x)
    order = np.sort(keys)
    stale = np.zeros(len(x), dtype=bool)
    stale[1:] = keys[1:] == keys[:-1]
    return np.isin(keys, np.unique(order[1:][order[1:] == order[:-1]])), stale


def _hashes(x: Floats) -> NDArray[np.uint64]:
    """Return a number of 64 bits for every row of a table (n, k): sorting rows themselves takes ten times as long."""
    keys = np.zeros(len(x), dtype=np.uint64)
    for column in x.T:
        keys ^= (column + 0.0).view(np.uint64)  # -0.0 becomes 0.0
        for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):  # the finaliser of MurmurHash3
            keys ^= keys >> np.uint64(33)
            keys *= np.uint64(factor)
        keys ^= keys >> np.uint64(33)
    return keys


def has_more_values(x: Floats, count: int) -> bool:
    """Whether a channel has more than ``count`` different finite values; a sample of it tells mostly."""
    x = x[np.isfinite(x)]
    few = x[:: max(1, len(x) // 5000)]
    return len(np.unique(few)) > count or len(np.unique(x)) > count
