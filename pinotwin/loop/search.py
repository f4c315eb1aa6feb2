"""The search for the poles: bounded, deterministic, in logarithms, so that every point of it is stable.

Halton points over where servo loops live, and a plain guess, start on the liveliest piece; the best end on all data.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.loop.data import LoopData
from pinotwin.loop.layout import Layout
from pinotwin.loop.projection import Projection, Scales
from pinotwin.solve.descent import End, Remembered, rival, trust_region


def polish(projection: Projection, theta: Floats, tolerance: float = 1e-7, most: int = 40) -> End:
    """Return the end of one bounded search from ``theta``, logarithms of the parameters, shape (np,)."""
    evaluate = Remembered(lambda x: projection.evaluate(x)[:2])
    tolerances = {"xtol": tolerance, "ftol": tolerance}
    box = projection.layout.box
    return trust_region(evaluate, theta, box, 1e-6, x_scale=0.5, max_nfev=most, **tolerances)


def starting_points(layout: Layout, count: int = 12) -> Floats:
    """Return starts for theta, shape (count, np)."""
    low, high = layout.box
    points = scipy.stats.qmc.Halton(len(low), scramble=False).random(count + 1)[1:]
    usual = np.log([np.multiply(p.scale, p.guess) for p in layout.parameters]).T
    lowest, plain, highest = np.clip(usual, low, high)
    starts = np.asarray(lowest + points * (highest - lowest))
    starts[0] = plain
    return starts


def search(
    data: LoopData, layout: Layout, starts: Floats | None = None, further: int = 4, near: float = 1.1
) -> tuple[End, tuple[float, ...]]:
    """Return the best poles from ``starts``, shape (k, np), on all data, and the costs of other ends."""
    scales = Scales.of(data)
    whole = Projection(data, layout, scales)
    begin = starting_points(layout) if starts is None else np.atleast_2d(starts)
    if len(begin) == 1:  # where another search ended
        return polish(whole, begin[0]), (1.0,)
    piece = liveliest(data)
    short = whole if piece is None else Projection(data.within((piece,)), layout, scales)
    tried = [polish(short, x, 1e-4, 10) for x in begin]
    first = _different(tried)
    ended = [polish(short, f.x, 1e-5) for f in first[:further]]
    ends = _different([*ended, *first[further:]])
    finals = [polish(whole, ends[0].x)]
    if short is not whole and len(ends) > 1:
        finals += rival(partial(polish, whole), ends[1].x, finals[0], near)
    best = min(finals, key=lambda f: f.cost)
    evaluations = sum(f.evaluations for f in (*tried, *ended, *finals))
    lowest = max(ends[0].cost, 1e-300)
    return replace(best, evaluations=evaluations), tuple(e.cost / lowest for e in ends)


def _different(ends: list[End], same: float = 0.02) -> list[End]:
    """Return ends, the best first, without those as near as ``same`` to one that a better one has found."""
    out: list[End] = []
    for end in sorted(ends, key=lambda f: f.cost):
        if all(np.max(np.abs(end.x - other.x), initial=0.0) > same for other in out):
            out.append(end)
    return out


def liveliest(data: LoopData, rows: int = 5000, seconds: float = 2.5) -> slice | None:
    """Return the short piece with most change of the command's velocity, None if all is short."""
    length = max(rows, int(seconds / data.step))
    if data.rows <= 1.5 * length:
        return None
    best, found = -1.0, None
    change = np.diff(data.vr, prepend=data.vr[0]) ** 2
    change += 1e-3 * np.mean(change) * (np.diff(data.d[:, 0], prepend=data.d[0, 0]) != 0)
    for s in data.segments:
        energy = np.cumsum(change[s])
        size = min(length, len(energy))
        for k in range(0, len(energy) - size + 1, max(size // 4, 1)):
            gain = float(energy[k + size - 1] - energy[k])
            if gain > best:
                best, found = gain, slice(s.start + k, s.start + k + size)
    return found
