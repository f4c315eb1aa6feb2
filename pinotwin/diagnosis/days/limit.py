"""A drive at its limit: the effort that its law asks for, clipped at one number, is what the motor gave.

The limit is ``|u| = level - slope |v|`` while the motor drives, from an instant on. A controller at its limit does not
integrate: after each time there the law is off by another constant, which is free, and paid for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.evidence import cells
from pinotwin.diagnosis.days.recording import again
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import Row
from pinotwin.diagnosis.days.rows import Asked
from pinotwin.diagnosis.days.score import Cells, density
from pinotwin.diagnosis.days.stretch import Stretch, corner
from pinotwin.diagnosis.days.whitening import Whitening
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.signals import rms, roughness, runs

SLOPES = np.linspace(0.0, 1.4, 8)
"""What is lost of a limit at the highest speed at which the motor drives, over the largest effort."""
TRIED = 16
"""How many levels are tried with each."""
LATELY = 3
"""How many short times beyond a level may be the last without it."""
Clipped = tuple[Floats, Floats]
"""What a clipped law leaves of a stretch, and its constants, nan on rows at the limit, shape (n,) each."""


@dataclass(frozen=True, eq=False)
class Bound:
    """A limit of a drive in all logs: ``level`` [N or N·m], ``slope`` [the same per m/s or rad/s], ``gain`` [nats]."""

    level: float
    slope: float
    gain: float
    price: float
    parts: Sequence[Clipped | None]


@dataclass(frozen=True, eq=False)
class Drive:
    """What an axis gave in a stretch, what its law leaves of it (n,), the misfit's spectrum, and noise [N or N·m].

    ``feedback``: whether the law knows the tracking error and its integral, and so when it asks for more than a limit.
    """

    s: Stretch
    name: str
    left: Floats
    w: Whitening
    noise: float
    feedback: bool = True

    @cached_property
    def raw(self) -> tuple[Floats, Floats, Floats]:
        """Time, size of the effort, and speed while the motor drives, on every row of the log, shape (m,) each."""
        m, c = self.s.motion, self.s.axes[self.name]
        t, u = m.t - m.t[0], np.nan_to_num(m.u[:, m.names.index(self.name)])
        v = np.interp(t, self.s.t, c["v"])
        return t, np.abs(u), np.abs(v) * (u * v > 0.0)

    @cached_property
    def speed(self) -> Floats:
        """Speed while the motor drives, shape (n,)."""
        c = self.s.axes[self.name]
        return np.asarray(np.abs(c["v"]) * (c["u"] * c["v"] > 0.0))

    @cached_property
    def plain(self) -> float:
        """Log density without a limit [nats]."""
        return self.total(self.left - np.median(self.left))

    @cached_property
    def surprise(self) -> Floats:
        """How unlikely each row is by the law and the rows before it, over the average [nats], shape (n,)."""
        out = -density(self._square(self.left), np.array(1.0 / self.w.spread))
        return np.asarray(out - out.mean())

    def total(self, left: Floats) -> float:
        """Return the log density of what is left (n,), but for a constant [nats]."""
        squares = np.asarray(np.bincount(self.s.cell, self._square(left)), dtype=float)
        return float(np.sum(density(squares, np.bincount(self.s.cell) / self.w.spread)))

    def _square(self, left: Floats) -> Floats:
        return np.asarray((self.w(left[:, None])[:, 0] / self.w.weight) ** 2)

    def last(self, level: float, slope: float) -> list[float]:
        """Return times after which a limit may begin [s], -1 for all the time.

        For less than a period of the low-pass a reading may overshoot.
        """
        t, u, v = self.raw
        over = runs(u + slope * v > level + 4.0 * self.noise)
        ends = [float(t[x.stop - 1]) for x in over]
        real = [k for k, x in enumerate(over) if ends[k] - t[x.start] > 1.0 / corner(1.0 / self.s.cycle)]
        first = real[-1] if real else -1
        return [-1.0 if first < 0 else ends[first], *ends[first + 1 :][-LATELY:]]

    def clipped(self, level: float, slope: float, since: float) -> Clipped | None:
        """Return the stretch with its law clipped since an instant; None where the effort does not get there."""
        t, u, v = self.raw
        rows = t[(u + slope * v > level - 4.0 * self.noise) & (t > since)]
        at = np.zeros(len(self.left), dtype=bool)
        at[np.clip(np.round((rows - self.s.t[0]) / self.s.step).astype(int), 0, len(at) - 1)] = True
        for x in runs(~at):
            at[x] |= x.stop - x.start < 3  # too short to know a constant by
        if not at.any():
            return None
        bound, constants = np.maximum(level - slope * self.speed, 0.0), np.where(at, np.nan, 0.0)
        for _ in range(2 * self.feedback):  # again, for an end smears through the low-pass
            left = self.left_by(constants, bound)
            for x in runs(~at):
                constants[x] += np.median(left[x])
        return self.left_by(constants, bound), constants

    def left_by(self, constants: Floats, bound: Floats | float = np.inf) -> Floats:
        """Return what the law leaves with constants, nan where it is clipped, and bounds, shape (n,) each."""
        at, n, u = np.isnan(constants), np.arange(len(constants)), self.s.axes[self.name]["u"]
        before = constants[np.maximum.accumulate(np.where(at, 0, n))]
        after = constants[np.minimum.accumulate(np.where(at, len(n) - 1, n)[::-1])[::-1]]
        law, side = u - self.left, np.sign(u)
        # The integral goes from one to the other meanwhile; of a log all at the limit nobody knows what is asked.
        asks = self.feedback or not np.all(np.isfinite(bound))
        most = np.fmin(np.fmax(side * (law + before), side * (law + after)) if asks else np.inf, bound)
        gave = np.where(at, np.where(np.isfinite(most), side * most, law), law + constants)
        left = self.left - self.s.low(gave - law)
        # Within a limit the law may ask for far more than the motor gave: even the rest of a low-pass would count.
        period = round(1.0 / (corner(1.0 / self.s.cycle) * self.s.step))
        within = np.convolve(~at, np.ones(2 * period + 1), "same") < 0.5
        return np.where(within, u - gave, left)


def bounded(each: Sequence[Drive]) -> Bound | None:
    """Return the limit that explains most of some stretches, None where constants of the law explain it as well."""
    best: Bound | None = None
    top, fast = (max(float(d.raw[k].max()) for d in each) for k in (1, 2))
    unit = top / max(fast, 1e-300)
    slopes = SLOPES if each[0].feedback else SLOPES[:1]
    for near in (slopes, SLOPES[1] * np.array([-0.5, 0.5]), SLOPES[1] * np.array([-0.25, 0.25])):
        if near[0] and (best is None or not best.slope):
            break
        for slope in near * unit + (best.slope if best is not None and near[0] else 0.0):
            for level in _levels(each, float(slope)):
                best = _better(each, level, float(slope), best)
    return best


def _better(each: Sequence[Drive], level: float, slope: float, best: Bound | None) -> Bound | None:
    """Return a limit if it explains more than the best so far, else that."""
    found = [_since(d, level, slope) for d in each]
    gain, over = sum(x[1] for x in found), sum(x[2] for x in found)
    price = sum(x[3] for x in found) + SETTINGS.place * (1 + (slope > 0.0))
    if over > price and gain - price > (0.0 if best is None else best.gain - best.price):
        return Bound(level, slope, gain, price, [x[0] for x in found])
    return best


def _since(d: Drive, level: float, slope: float) -> tuple[Clipped | None, float, float, float]:
    """Return a stretch that is clipped since its best instant, what that gains, over constants alone, and its price."""
    best: tuple[Clipped | None, float, float, float] = (None, 0.0, 0.0, 0.0)
    for since in d.last(level, slope)[: 1 if slope else None]:  # that of the speed has no beginning
        one = d.clipped(level, slope, since)
        if one is not None:
            won = d.total(one[0]) - d.plain
            constants = max(len(runs(np.isfinite(one[1]))) - 1, 0) * d.feedback
            price = SETTINGS.number * constants + SETTINGS.place * (since >= 0.0)
            if won - price > best[1] - best[3]:
                best = one, won, won + d.plain - d.total(d.left_by(one[1])), price
    return best


def _levels(each: Sequence[Drive], slope: float) -> set[float]:
    """Return levels at which efforts stand while the law is most surprised."""
    wide, odd = 4.0 * each[0].noise, np.concatenate([d.surprise for d in each])
    size = [d.raw[1] + slope * d.raw[2] for d in each]
    rows = np.concatenate([x[d.s.rows] for x, d in zip(size, each, strict=True)])
    order, top = np.argsort(rows), max(float(x.max()) for x in size)
    summed = np.r_[0.0, np.cumsum(odd[order])]
    edges = np.arange(top, 0.3 * top, -wide)
    spans = np.searchsorted(rows[order], [edges - wide, edges + wide])
    spans = spans[:, spans[0] < spans[1]]
    most = np.argsort(-np.diff(summed[spans], axis=0)[0])[:TRIED]
    return {float(np.median(rows[order[a:b]])) for a, b in spans[:, most].T}


def limit_row(each: Sequence[Drive], before: Mapping[str, Cells], r: Reference) -> Row | None:
    """Return the row of a drive's limit, if any; it closes what the law with its constants and no limit leaves."""
    found, name = bounded(each), each[0].name
    if found is None:
        return None
    pairs = list(zip(each, found.parts, strict=True))
    parts = [(d.left, d.left) if x is None else (d.left_by(x[1]), x[0]) for d, x in pairs]
    free, after = (
        cells(r, [d.s for d in each], [{(name, "law"): x[k]} for x in parts], name) for k in (0, 1)
    )
    most = min(found.level, max(float(d.raw[1].max()) for d in each))
    rows = [again("limit", name, ({name: x}, {name: after}), most, found.price) for x in (before, free)]
    spans = [
        (k, float(d.s.t[rows.start]), float(d.s.t[rows.stop - 1]))
        for k, (d, x) in enumerate(pairs)
        for rows in (() if x is None else runs(np.isnan(x[1])))
    ]
    since = [min(a for n, a, _ in spans if n == k) for k in sorted({n for n, _, _ in spans})]
    return replace(rows[0], closed=rows[1].closed, group="limit", since=since, spans=spans)


def limit_rows(asked: Asked) -> list[Row]:
    """Return the rows of drives at their limit."""
    r, q, out = asked.r, asked.q, list[Row | None]()
    for name in (k for k in r.axes if (k, "law") in q.left[0]):
        own = np.concatenate([x - x.mean() for x in r.left(r.logs, name, "law")])
        j, w = r.logs[0].motion.names.index(name), r.whitenings[name, "law"]
        noise = np.hypot(roughness([np.nan_to_num(s.motion.u[:, j]) for s in r.logs]), rms(own))
        pairs = zip(q.logs, q.left, strict=True)
        each = [Drive(s, name, x[name, "law"], w, float(noise)) for s, x in pairs]
        out.append(limit_row(each, asked.cells[name], r))
    return [x for x in out if x is not None]
