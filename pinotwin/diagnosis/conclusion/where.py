"""Where the gap lies: share of the squared gap against share of time, in every regime of the motion.

A concentration must beat the largest that circular shifts of the gap reach: looking everywhere is paid for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.result import Found, Region
from pinotwin.motion import Motion
from pinotwin.units import of_axis

SHIFTS = 99
MOST = 5  # regions of an axis
REVERSAL = 0.05  # share of the top speed that counts as reversal


@dataclass(frozen=True)
class Cell:
    """A candidate region: which rows belong to it."""

    kind: str
    range: tuple[float, float]
    unit: str
    mask: Mask
    other: str | None = None


def localise(sample: Sample, residual: Floats, joint: int, rng: np.random.Generator) -> list[Region]:
    """Return the regions of an axis in which its gap, ``residual`` at the joint's rows, shape (m,), concentrates."""
    power = residual**2
    cells = regimes(sample.motion, sample.samples(joint), joint, np.abs(sample.effort[joint]))
    if power.sum() <= 0.0 or not cells:
        return []
    axis = sample.motion.names[joint]
    found = [*concentrated(cells, power, axis, "u", rng), *_bands(sample, residual, joint, axis)]
    return sorted(found, key=lambda r: -(r.share - r.time_share))[:MOST]


def concentrated(
    cells: Sequence[Cell], power: Floats, axis: str, signal: str, rng: np.random.Generator
) -> list[Region]:
    """Return the cells in which a squared gap (n,) concentrates, tested against circular shifts."""
    inside = np.stack([c.mask for c in cells]).astype(float)
    share_of_time = inside.mean(axis=1)
    spread = np.sqrt(share_of_time * (1.0 - share_of_time))
    score = (inside @ power / power.sum() - share_of_time) / spread
    top = np.empty(SHIFTS)
    for k in range(SHIFTS):
        moved = np.roll(power, int(rng.integers(len(power) // 20, len(power))))
        top[k] = ((inside @ moved / power.sum() - share_of_time) / spread).max()
    found = []
    for cell, s, when in zip(cells, score, share_of_time, strict=True):
        p = (1.0 + float((top >= s).sum())) / (SHIFTS + 1.0)
        share = float(power[cell.mask].sum() / power.sum())
        if p <= 0.05 and share > 1.3 * when:
            found.append(
                Region(axis, signal, cell.kind, cell.range, cell.unit, share, float(when), p, cell.other)
            )
    return found


def regimes(m: Motion, rows: Ints, joint: int, load: Floats | None = None) -> list[Cell]:
    """Return the regimes of a joint's motion: time, position, speed, standstill, acceleration, others."""
    x, t = of_axis("x", m.rotary[joint]), m.t[rows]
    q, v, a = (y[rows, joint] for y in (m.q, m.v, m.a))
    out = bins("time", t, "s", 8) + bins("position", q, x, 8) + bins("acceleration", a, f"{x}/s²", 6)
    slow = REVERSAL * float(np.abs(v).max())
    out += [Cell("velocity", (-slow, slow), f"{x}/s", np.abs(v) <= slow)]
    out += bins("velocity", v, f"{x}/s", 6)
    if load is not None:
        out += bins("load", load, of_axis("F", m.rotary[joint]), 5)
    for other, name in enumerate(m.names):
        if other != joint:
            w = np.abs(m.v[rows, other])
            unit, fast = of_axis("x/s", m.rotary[other]), max(float(w.max()), 1e-12)
            out.append(Cell("other_axis", (0.05 * fast, fast), unit, w > 0.05 * fast, name))
    return [c for c in out if 0.01 < c.mask.mean() < 0.95]


def bins(kind: str, x: Floats, unit: str, count: int) -> list[Cell]:
    """Return cells of equal width over the range of a quantity."""
    edges = np.linspace(float(x.min()), float(x.max()) + 1e-12, count + 1)
    return [Cell(kind, (float(a), float(b)), unit, (x >= a) & (x < b)) for a, b in pairwise(edges)]


def _bands(sample: Sample, residual: Floats, joint: int, axis: str) -> list[Region]:
    """Return the frequency band that holds most for its width; p is not tested here."""
    rate = 1.0 / (sample.motion.step * sample.motion.decimation)
    edges = np.array([0.0, 1.0, 3.0, 8.0, 16.0, 30.0, 0.5 * rate])
    edges = np.unique(edges[edges <= 0.5 * rate])
    power = np.zeros(len(edges) - 1)
    at = sample.samples(joint)
    breaks = np.flatnonzero(np.diff(at) != sample.motion.decimation) + 1
    for r in np.split(residual, breaks):
        if len(r) >= 32:
            spectrum = np.abs(np.fft.rfft((r - r.mean()) * np.hanning(len(r)))) ** 2
            power += np.histogram(np.fft.rfftfreq(len(r), 1.0 / rate), edges, weights=spectrum)[0]
    if power.sum() <= 0.0:
        return []
    share = power / power.sum()
    width = np.diff(edges) / edges[-1]
    k = int(np.argmax(share - width))
    if share[k] < 1.5 * width[k]:
        return []
    where = (float(edges[k]), float(edges[k + 1]))
    return [Region(axis, "u", "frequency", where, "Hz", float(share[k]), float(width[k]), None)]


def telling(regions: Sequence[Region], axes: Sequence[str]) -> list[Region]:
    """Return the regions in the order that helps: axes with a cause first, in turn; slow changes of a gap last."""

    def rank(r: Region) -> tuple[int, bool, bool, float]:
        place = axes.index(r.axis) if r.axis in axes else len(axes)
        band = r.kind == "frequency"
        return place, band and r.range[0] == 0.0, band, -(r.share - r.time_share)

    once = {(r.axis, r.signal, r.kind, r.range): r for r in reversed(regions)}  # repeats show it twice
    return sorted(reversed(once.values()), key=rank)


def along(found: Found, regions: Sequence[Region]) -> Region | None:
    """Return the place along the travel at which an effort appeared; None for another cause."""
    at = (r for r in regions if r.kind == "position" and r.axis == found.axis)
    return next(at, None) if found.effect == "position_table" and len(found.size) == 1 else None
