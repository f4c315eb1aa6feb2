"""What acts at a few instants or places: pushes, cuts, teeth, snags; each costs the price of its search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from scipy.ndimage import convolve1d
from scipy.special import gammaln

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.days.healthy import Shapes, healthy_day
from pinotwin.diagnosis.days.mechanisms import one_program
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.score import density
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.days.whitening import Whitening
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import Effect

Felt = dict[str, Floats]  # axis -> columns of a cause there
Span = tuple[int, float, float]
"""Stretch, begin and end [s]."""


@dataclass(frozen=True, eq=False)
class Sought:
    """A cause that is sought, where it explains most: its course, place, instants or shape.

    Attributes:
        columns: of every stretch axis -> columns, (n,) or (n, p): its own, and of those that feel it through their
            inertia. price: of the search [nats]. equation: on which it acts.
        place: centre and width [m or rad], where it is one. spans: when it acts, where it is bound to time.
        since: instant at which it begins in every stretch; or how long it acts after a start, and the stand [s].
        form, scale: the effect whose columns these are, and what each was multiplied with, shape (p,).
        again: the same in any stretch, of what does not hang on these.
    """

    columns: list[Felt] = field(default_factory=list)
    price: float = 0.0
    equation: str = "plant"
    place: tuple[float, float] | None = None
    spans: list[Span] = field(default_factory=list)
    since: list[float] = field(default_factory=list)
    form: Effect | None = None
    scale: Floats = field(default_factory=lambda: np.ones(1))
    again: Callable[[Stretch], Felt] | None = None


@dataclass(frozen=True, eq=False)
class Whitened:
    """Stretches with the whitened residual that a healthy day leaves of the plant of one axis.

    Attributes:
        whitening: by the misfit's spectrum. counts: what each whitened row is multiplied with, of every stretch, (n,).
        left: the residual as weighed, of every stretch, (n,). effort: RMS of the axis' effort [N or N·m].
    """

    logs: Sequence[Stretch]
    name: str
    whitening: Whitening
    counts: list[Floats]
    left: list[Floats]
    effort: float

    def weighed(self, k: int, x: Floats) -> Floats:
        """Return columns (n, p) of a stretch as whitened, each row by what it counts."""
        return self.whitening(x) * self.counts[k][:, None]

    def gain(self, k: int, before: Floats, after: Floats) -> float:
        """Return what a stretch gains [nats] if less is left of it, by the density of its cells."""
        cell = self.logs[k].cell
        rows = np.bincount(cell, (self.counts[k] * self.whitening.sigma) ** 2).astype(float)
        old, new = (density(np.bincount(cell, x**2).astype(float), rows) for x in (before, after))
        return float(np.sum(new - old))

    @cached_property
    def response(self) -> Floats:
        """What low-pass and whitening make of one row, shape (k,), k odd: from as many rows before it to after it."""
        reach = 2 * len(self.whitening.rho)
        one = self.logs[0].low(np.eye(1, 10 * reach + 1, 5 * reach)[0])
        return self.whitening(one)[4 * reach : 6 * reach + 1]

    def passed(self, k: int, x: Floats) -> Floats:
        """Return columns (n, p) of a stretch before the low-pass as weighed."""
        return convolve1d(x, self.response, axis=0, mode="constant") * self.counts[k][:, None]


def local(r: Reference, w: Whitened) -> dict[str, Sought]:
    """Return the pushes, cuts, teeth and snags of an axis that are worth a look; columns of shape (n, p)."""
    logs, name, out = w.logs, w.name, dict[str, Sought]()
    if pushes := pulses(w, [(k,) for k in range(len(logs))], 8):
        out["push"] = _timed(w, pushes)
    if one_program(r, logs) and (cuts := pulses(w, [tuple(range(len(logs)))], 12)):
        out["cut"] = _timed(w, cuts)
    q = np.concatenate([s.axes[name]["q"] for s in logs])
    return {**out, **_at_places(w, float(q.min()), float(q.max()))}


def whitened(
    r: Reference,
    logs: Sequence[Stretch],
    left: Sequence[dict[tuple[str, str], Floats]],
    name: str,
    found: Shapes,
) -> Whitened:
    """Return what is left of an axis beside a healthy day, whitened."""
    whitening = r.whitenings[name, "plant"]
    counts = [whitening.counts(s.axes[name], "plant") / whitening.weight for s in logs]
    rest = []
    for s, x, c in zip(logs, left, counts, strict=True):
        day = whitening(healthy_day(r, s, name, found)["plant"]) * c[:, None]
        y = whitening(x[name, "plant"]) * c
        known = np.linalg.solve(day.T @ day + np.eye(day.shape[1]), day.T @ np.clip(y, -6.0, 6.0))
        rest.append(y - day @ known)
    return Whitened(logs, name, whitening, counts, rest, r.widths[name]["effort"])


Waves = list[dict[int, Floats]]
"""Half waves: stretch -> column."""
LONG = (0.1, 0.2, 0.4, 0.8)
"""Lengths [s] of the pushes that are tried first."""


def pulses(
    w: Whitened, groups: Sequence[tuple[int, ...]], most: int, lengths: Sequence[float] = LONG
) -> Waves:
    """Return pushes in time of about these lengths [s], the strongest first; each is alike in a group's stretches."""
    left, found, least = [x.copy() for x in w.left], list[dict[int, Floats]](), 0.0
    while len(found) < most:
        both = [_without(w, left, _finest(w, left, groups, lengths, box=box)) for box in (False, True)]
        gain, columns, left = max(both, key=lambda x: x[0])
        least = max(least, SETTINGS.trace**2 * gain)  # the rest of a form is no push of its own
        if gain < max(least, instants(len(found) + 1) - instants(len(found))):
            break
        found.append(columns)
    return found


def _without(
    w: Whitened, left: Sequence[Floats], push: _Push
) -> tuple[float, dict[int, Floats], list[Floats]]:
    """Return what a push gains by the density of the cells [nats], its columns, and what is left beside it."""
    columns, gain, rest = {}, 0.0, list(left)
    for k in push.group:
        x = np.zeros(len(w.logs[k].t))
        x[push.at : push.at + len(push.wave)] = push.wave[: len(x) - push.at]
        columns[k] = x
        b = w.whitening(x) * w.counts[k]
        rest[k] = left[k] - b * float(left[k] @ b) / max(float(b @ b), 1e-9)
        gain += w.gain(k, left[k], rest[k])
    return gain, columns, rest


FINER = ((0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.35), (0.95, 0.975, 1.025, 1.05))
"""By what the length of the best is multiplied then."""


@dataclass(frozen=True, eq=False)
class _Push:
    """A push where it explains most: gain [nats], stretches, first row, course, and how many rows it was made of."""

    gain: float
    group: tuple[int, ...]
    at: int
    wave: Floats
    long: float


def _finest(
    w: Whitened,
    left: Sequence[Floats],
    groups: Sequence[tuple[int, ...]],
    lengths: Sequence[float],
    *,
    box: bool,
) -> _Push:
    """Return the strongest push of all lengths, a half wave or a ``box`` that comes and goes at once."""
    second = 1.0 / w.logs[0].step
    best = max(
        (_strongest(w, left, g, x * second, box=box) for g in groups for x in lengths), key=lambda x: x.gain
    )
    for steps in FINER:
        finer = [_strongest(w, left, best.group, best.long * x, box=box) for x in steps]
        best = max([best, *finer], key=lambda x: x.gain)
    return best


def _strongest(
    w: Whitened, left: Sequence[Floats], group: tuple[int, ...], long: float, *, box: bool
) -> _Push:
    """Return a push of so many rows where it explains most in a group of stretches."""
    n = max(2, int(long))
    edge = np.array([0.25, 0.5, 0.25])  # about what the low-pass leaves of a step
    wave = np.convolve(np.ones(n), edge) if box else np.sin(np.pi * np.arange(n + 2) / (n + 1))
    b = np.convolve(wave, np.r_[1.0, -w.whitening.rho])
    short = min(len(left[k]) for k in group)
    if short <= len(b):
        return _Push(0.0, group, 0, wave, long)
    num = sum(np.correlate((left[k] * w.counts[k])[:short], b, "valid") for k in group)
    den = sum(np.correlate(w.counts[k][:short] ** 2, b**2, "valid") for k in group)
    whole = len(group) * float(b @ b) / w.whitening.weight**2
    seen = den > 0.5 * whole  # a push that lies in rows that do not count is none
    gain = np.where(seen, num**2 / np.maximum(den, 0.5 * whole) / 2.0, 0.0)
    at = int(np.argmax(gain))
    return _Push(float(gain[at]), group, at, wave, long)


def instants(count: int) -> float:
    """Return what the search for so many instants costs, in whatever order they were found [nats]."""
    return float(SETTINGS.place * count - gammaln(count + 1))


def _timed(w: Whitened, pulses: Waves) -> Sought:
    still = [np.zeros(len(s.t)) for s in w.logs]
    columns = [
        {w.name: np.column_stack([p.get(k, x) * w.effort for p in pulses])} for k, x in enumerate(still)
    ]
    rows = [(k, np.flatnonzero(x)) for p in pulses for k, x in p.items() if x.any()]
    spans = [(k, float(w.logs[k].t[x[0]]), float(w.logs[k].t[x[-1]])) for k, x in rows]
    return Sought(columns, instants(len(pulses)), spans=spans)


@dataclass(frozen=True, eq=False)
class _Bump:
    """The best place of a scan: gain [nats], centre, width, and for a snag the passes on which it drags."""

    gain: float = 0.0
    at: float = 0.0
    width: float = 0.0
    passes: tuple[tuple[int, int, int], ...] = ()  # stretch, first and last row
    drags: Floats = field(default_factory=lambda: np.zeros(0))


def _at_places(w: Whitened, low: float, high: float) -> dict[str, Sought]:
    """Return a bump at a place, and a drag at a place on some passes."""
    tooth, snag = _scan(w, low, high)
    out = {}
    if tooth.gain > SETTINGS.place + 4.0:
        at, width = _finer(w, tooth, [np.ones(len(s.t)) for s in w.logs])
        bump = partial(_bump, w, at=at, width=width)
        out["tooth"] = Sought([bump(s) for s in w.logs], SETTINGS.place, place=(at, width), again=bump)
    if snag.gain > SETTINGS.place:
        keep = [np.zeros(len(s.t)) for s in w.logs]
        for (k, a, b), drags in zip(snag.passes, snag.drags, strict=True):
            keep[k][a:b] = drags
        keep = [x * s.axes[w.name]["sg"] for x, s in zip(keep, w.logs, strict=True)]
        at, width = _finer(w, snag, keep)
        pairs = zip(w.logs, keep, strict=True)
        columns = [{k: y * x[:, None] for k, y in _bump(w, s, at, width).items()} for s, x in pairs]
        count = float(snag.drags.sum())
        price = SETTINGS.place + count * np.log(1 / 0.4) + (len(snag.passes) - count) * np.log(1 / 0.6)
        on = [x for x, drags in zip(snag.passes, snag.drags, strict=True) if drags]
        spans = [(k, float(w.logs[k].t[a]), float(w.logs[k].t[b - 1])) for k, a, b in on]
        out["snag"] = Sought(columns, float(price), place=(at, width), spans=spans)
    return out


def _bump(w: Whitened, s: Stretch, at: float, width: float) -> Felt:
    bump = s.low(np.exp(-(((s.axes[w.name]["q"] - at) / width) ** 2)))
    return {w.name: bump[:, None] * w.effort}


def _scan(w: Whitened, low: float, high: float) -> tuple[_Bump, _Bump]:
    """Return the best tooth and the best snag on a grid of places and widths."""
    tooth, snag, span = _Bump(), _Bump(), high - low
    for share in (0.006, 0.015, 0.04):
        width = share * span
        places = np.arange(low + 2.0 * width, high - 2.0 * width, max(width, span / 120.0))
        if not len(places):
            continue
        E = [np.exp(-(((s.axes[w.name]["q"][:, None] - places) / width) ** 2)) for s in w.logs]
        X = np.concatenate([w.passed(k, x) for k, x in enumerate(E)])
        num, den = np.concatenate(w.left) @ X, np.sum(X**2, axis=0)
        gain = num**2 / np.maximum(den, 0.05 / w.whitening.weight**2) / 2.0
        n = int(np.argmax(gain))
        if gain[n] > tooth.gain:
            tooth = _Bump(float(gain[n]), float(places[n]), width)
        snag = max(snag, _best_snag(w, places, width, E), key=lambda x: x.gain)
    return tooth, snag


def _best_snag(w: Whitened, places: Floats, width: float, bumps: Sequence[Floats]) -> _Bump:
    """Return the place at which dry friction rises on some passes: each is on (0.4) or off (0.6)."""
    sums, edges = [], list[Ints]()
    for k, (s, x, left) in enumerate(zip(w.logs, bumps, w.left, strict=True)):
        zero = np.zeros((1, len(places)))
        drag = w.passed(k, x * s.axes[w.name]["sg"][:, None])
        sums.append([np.vstack([zero, np.cumsum(y, axis=0)]) for y in (left[:, None] * drag, drag**2)])
        inside = np.pad((x > 0.05).astype(np.intp), ((1, 1), (0, 0)))
        edges.append(inside[1:] - inside[:-1])
    best = _Bump()
    for n in range(len(places)):
        passes = [
            (k, int(a), int(b))
            for k, d in enumerate(edges)
            for a, b in zip(np.flatnonzero(d[:, n] == 1), np.flatnonzero(d[:, n] == -1), strict=True)
        ]
        if len(passes) < 3:
            continue
        p, z = (np.array([sums[k][i][b, n] - sums[k][i][a, n] for k, a, b in passes]) for i in (0, 1))
        if z.sum() <= 0.0:
            continue
        top = float(np.max(p / np.maximum(z, 0.3 * z.max())))
        for size in top * np.array([0.4, 0.6, 1.0]) if top > 0.0 else ():
            on = size * p - size * size * z / 2.0
            gain = float(np.logaddexp(np.log(0.6), np.log(0.4) + on).sum())
            if gain > best.gain and (on > 0.4).sum() >= 2:
                best = _Bump(gain, float(places[n]), width, tuple(passes), (on > 0.4).astype(float))
    return best


def _finer(w: Whitened, bump: _Bump, keep: Sequence[Floats]) -> tuple[float, float]:
    """Return place and width between those of the scan; ``keep`` is what counts of each row, signed for a drag."""
    shifts, factors = np.meshgrid([-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75], [0.6, 0.8, 1.0, 1.3, 1.7])
    at, width = bump.at + shifts.ravel() * bump.width, factors.ravel() * bump.width
    num, den = np.zeros(len(at)), np.zeros(len(at))
    for k, (s, x, c) in enumerate(zip(w.logs, w.left, keep, strict=True)):
        bumps = s.low(np.exp(-(((s.axes[w.name]["q"][:, None] - at) / width) ** 2)))
        b = w.weighed(k, bumps * c[:, None])
        num, den = num + x @ b, den + (b**2).sum(axis=0)
    n = int(np.argmax(num**2 / np.maximum(den, 1e-9)))
    return float(at[n]), float(width[n])
