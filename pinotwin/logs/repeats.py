"""Which logs are repeats of one command, told from the command or, without one, from the measured motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.motion import Motion

_LATEST = 0.25  # that one run may begin later than the other [s]


def same_motion(a: Motion, b: Motion, commanded: float = 0.01, measured: float = 0.05) -> bool:
    """Whether two prepared logs are repeats: alike to a share of a standard deviation, in command, else in position."""
    x, y, allowed = a.q, b.q, measured
    if a.qr is not None and b.qr is not None:
        x, y, allowed = a.qr, b.qr, commanded
    n = min(len(x), len(y))
    if a.names != b.names or n < 0.9 * max(len(x), len(y)) or abs(a.step - b.step) > 0.01 * a.step:
        return False
    x, y = _scaled(x, y)
    if not x.size:
        return False
    shift = _shift(x, y, round(_LATEST / a.step))
    x, y = (x[shift:], y) if shift >= 0 else (x, y[-shift:])
    n = min(len(x), len(y))
    off = np.sqrt(np.mean((x[:n] - y[:n]) ** 2, axis=0))
    return bool(off.max() < allowed)


def labels(motions: Sequence[Motion]) -> tuple[int, ...]:
    """Return a label per log; repeats of one motion share that of the first of them."""
    out: list[int] = []
    for k, motion in enumerate(motions):
        same = (out[j] for j in range(k) if same_motion(motions[j], motion))
        out.append(next(same, k))
    return tuple(out)


def shift_between(a: Motion, b: Motion) -> int:
    """Return by how many rows repeat ``a`` runs later than ``b``, told from their measured positions."""
    x, y = _scaled(a.q, b.q)
    return _shift(x, y, round(_LATEST / a.step)) if x.size else 0


def _scaled(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the columns of the axes that move in either, over their standard deviation."""
    size = np.maximum(x.std(axis=0), y.std(axis=0))
    moving = size > 1e-3 * size.max(initial=0.0)
    return x[:, moving] / size[moving], y[:, moving] / size[moving]


def _shift(x: Floats, y: Floats, reach: int, most: int = 2000) -> int:
    """Return by how many rows ``x`` runs later than ``y``: where they differ least, both of shape (n, k)."""
    n = min(len(x), len(y)) - 2 * reach
    if n < 50:
        return 0
    rows = reach + np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))
    best = 0
    for width in (max(1, reach // 25), 1):  # coarse, then fine around it
        near = range(best - 25 * width, best + 25 * width + 1, width)
        shifts = [best, *(s for s in near if abs(s) <= reach)]
        best = min(shifts, key=lambda s: float(np.mean((x[rows + s] - y[rows]) ** 2)))
    return best
