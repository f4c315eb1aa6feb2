"""What healthy days of a machine are like: its equations, what they leave of days that they do not know, and widths."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.law import Law, solved
from pinotwin.diagnosis.days.stretch import Columns, Stretch, stretches
from pinotwin.diagnosis.days.whitening import COUNTED, Whitening, settled
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects.scene import with_model_effort
from pinotwin.identification.misfit import own_residual
from pinotwin.signals import rms
from pinotwin.twin import Twin

EQUATIONS = ("plant", "law", "encoders")
SEVERAL = 3
"""Logs of a twin from which on each is held against the others; of fewer, thirds stand for them."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A twin and its healthy days.

    Attributes:
        twin: the plant. axes: that are judged.
        top: axis -> highest speed [m/s or rad/s].
        logs: stretches of the twin's own logs. days: how many logs these are.
        laws: axis -> law of its controller; only of axes whose law foretells a log left out.
        twists: axis -> what moves its two encoders against each other, (6,), SI.
        zeros: axis -> where its load stands by them beside that [m or rad]; only of several days.
        whitenings: axis, equation -> spectrum of the misfit.
        widths: axis -> what a healthy day does. law_widths: axis -> the same of every number of the law.
        tables: axis, equation -> place and misfit that healthy logs share there.
        lacked: axis -> size of that of the plant over the effort's, and its share of the squared misfit, both [1].
    """

    twin: Twin
    axes: tuple[str, ...]
    top: Mapping[str, float]
    logs: tuple[Stretch, ...]
    laws: Mapping[str, Law]
    twists: Mapping[str, Floats]
    zeros: Mapping[str, float] = field(default_factory=dict)
    whitenings: Mapping[tuple[str, str], Whitening] = field(default_factory=dict)
    widths: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    law_widths: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    tables: Mapping[tuple[str, str], tuple[Floats, Floats]] = field(default_factory=dict)
    lacked: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    days: int = SEVERAL

    def twist(self, name: str, c: Columns) -> Floats:
        """Return how far the spring between two encoders gives, (n,) [m or rad]."""
        return _between(c)[:, :3] @ self.twists[name][:3]

    def residuals(self, s: Stretch, only: Collection[str] | None = None) -> dict[tuple[str, str], Floats]:
        """Return what each equation of every axis leaves of a stretch, shape (n,) each."""
        out = {}
        for name in self.axes if only is None else only:
            c = s.axes[name]
            out[name, "plant"] = c["left"] - self._shared(name, "plant", c)
            if name in self.laws and "e" in c:
                r = c["u"] - self.laws[name].effort(c)
                out[name, "law"] = r - np.median(r)
            if name in self.twists and "gap" in c:
                r = c["gap"] - _between(c) @ self.twists[name] - self._shared(name, "encoders", c)
                out[name, "encoders"] = self.centred(name, r - self.zeros.get(name, 0.0))
        return out

    def beyond(self, name: str, logs: Sequence[Stretch]) -> float:
        """Return how much further or faster the twin's own logs and others go than its own [1]; a misfit grows so."""
        own, every = (np.array([s.axes[name]["reach"] for s in x]) for x in (self.logs, [*self.logs, *logs]))
        (travel, speed), (far, fast) = ((np.ptp(x[:, :2]), x[:, 2].max()) for x in (own, every))
        return max([1.0, *(float(y / x) for x, y in ((travel, far), (speed, fast)) if x > 0.0)])

    def centred(self, name: str, gap: Floats) -> Floats:
        """Return a gap between two encoders, (n,), less its median where nobody knows how their zeros were set."""
        return gap if name in self.zeros else gap - np.median(gap)

    def _shared(self, name: str, equation: str, c: Columns) -> Floats:
        """Return the misfit that healthy logs share at each row's place, shape (n,)."""
        return np.interp(c["q"], *self.tables.get((name, equation), (np.zeros(1), np.zeros(1))))

    def left(self, logs: Sequence[Stretch], name: str, equation: str) -> list[Floats]:
        """Return what one equation of an axis leaves of every stretch, shape (n,) each."""
        return [self.residuals(s, [name])[name, equation] for s in logs]


def reference(twin: Twin, axes: Sequence[str]) -> Reference | None:
    """Return what healthy days of a twin are like; None of a twin of too few logs, whose days nobody has seen."""
    if twin.misfit is None:
        return None
    motion = with_model_effort(twin.misfit.motion, twin.effects, twin.theta)
    own, logs = own_residual(twin), list[Stretch]()
    edges = [0, *(np.flatnonzero(np.diff(twin.misfit.log)) + 1).tolist(), len(motion)]
    index = {k: twin.machine.names.index(k) for k in axes}
    top = {k: float(np.quantile(np.abs(motion.v[:, j]), 0.99)) for k, j in index.items()}
    for k, (start, stop) in enumerate(pairwise(edges)):
        logs += stretches(twin, motion.cut(start, stop), own[start:stop], k, axes, top)
    if not logs:
        return None
    bare = Reference(twin, tuple(axes), top, tuple(logs), {}, {}, days=len({s.log for s in logs}))
    if bare.days < SEVERAL:  # the prior stands for the scatter between days
        logs = [part for s in logs for part in s.thirds()]
    # What an axis does on one log alone can be held against no other.
    axes = tuple(k for k in axes if len(moved([s.axes[k] for s in logs])) > 1)
    if not axes:
        return None
    bare = replace(bare, axes=axes)
    others = {day: _fitted(bare, [s for s in logs if s.log != day]) for day in {s.log for s in logs}}
    unseen = [(s, others[s.log].residuals(s)) for s in logs]
    return _measured(_fitted(bare, logs), unseen)


def moved(columns: Sequence[Columns]) -> list[Columns]:
    """Return the logs in which an axis moves long enough to be judged."""
    return [c for c in columns if settled(c["moving"]).any()]


def _between(c: Columns) -> Floats:
    """Return what moves two encoders against each other, shape (n, 6): the spring's load is in the first three.

    It is the effort less what rotor and friction keep of it on the motor's side, of the dry one half.
    """
    return np.column_stack([c["u"] - 0.5 * c["dry"], *(c[k] for k in ("a", "v", "j", "q", "memory"))])


def _fitted(bare: Reference, logs: Sequence[Stretch]) -> Reference:
    """Return the reference with laws and twists of some logs."""
    laws, twists, zeros = {}, {}, {}
    for name in bare.axes:
        columns = [s.axes[name] for s in logs]
        if all("e" in c for c in columns):
            laws[name] = Law.fitted(columns)
        if all("gap" in c for c in columns):
            X = np.concatenate([_between(c) for c in columns])
            own = np.concatenate([np.full(len(c["u"]), k) for k, c in enumerate(columns)])
            X = np.column_stack([X, own[:, None] == np.arange(len(columns))])
            bounds = np.tile([[-np.inf], [np.inf]], X.shape[1])
            bounds[1, 0] = bounds[0, 1] = 0.0  # a stiffness and a rotor's inertia are not below zero
            found = solved(X, np.concatenate([c["gap"] for c in columns]), bounds)
            twists[name] = found[:6]
            if bare.days >= SEVERAL:
                zeros[name] = float(found[6:].mean())
    return replace(bare, laws=laws, twists=twists, zeros=zeros)


def _measured(r: Reference, unseen: Sequence[tuple[Stretch, dict[tuple[str, str], Floats]]]) -> Reference:
    """Return the reference with what its equations leave of days that they do not know."""
    whitenings, widths, law_widths, laws = {}, {}, {}, dict(r.laws)
    tables, lacked = dict[tuple[str, str], tuple[Floats, Floats]](), dict[str, tuple[float, float]]()
    for name in r.axes:
        columns = [s.axes[name] for s, _ in unseen]
        left = [x[name, "plant"] for _, x in unseen]
        widths[name], left = _day(r, columns, left)
        table = tables[name, "plant"] = shared_shape(columns, left)
        rows = np.concatenate([c["moving"] for c in columns]) > 0.0
        before, u = (np.concatenate(x)[rows] for x in (left, [c["u"] for c in columns]))
        left = [x - np.interp(c["q"], *table) for c, x in zip(columns, left, strict=True)]
        shared = before - np.concatenate(left)[rows]
        size, apart = rms(shared) / max(rms(u), 1e-300), rms(before - shared) / max(rms(before), 1e-300)
        lacked[name] = size, 1.0 - apart**2
        w = Whitening.measured(left, [c["moving"] for c in columns]).turns(left, columns)
        count = sum(float(settled(c["moving"]).sum()) for c in columns) / w.spread
        left_over = max(count - 5.0 * len(moved(columns)), 1.0)  # of every log `_day` has taken five numbers
        whitenings[name, "plant"] = replace(w, sigma=w.sigma * float(np.sqrt(max(count / left_over, 1.0))))
        for equation in EQUATIONS[1:]:
            if (name, equation) in unseen[0][1]:
                rest = [x[name, equation] for _, x in unseen]
                if equation == "encoders":
                    more, rest = _between_days(r, name, columns, rest)
                    widths[name] |= more
                    table = tables[name, equation] = shared_shape(columns, rest)
                    rest = [x - np.interp(c["q"], *table) for c, x in zip(columns, rest, strict=True)]
                whitenings[name, equation] = Whitening.measured(rest, [c[COUNTED[equation]] for c in columns])
        if name in laws:
            effort = float(np.std(np.concatenate([c["u"] for c in columns])))
            if not (laws[name].stable and whitenings[name, "law"].sigma <= 0.1 * effort):
                del laws[name]  # it copies the plant, or foretells no log
            else:
                law_widths[name] = _law_widths(laws[name], columns, [x[name, "law"] for _, x in unseen])
    r = replace(r, laws=laws, whitenings=whitenings, widths=widths, law_widths=law_widths)
    return replace(r, tables=tables, lacked=lacked)


def _day(
    r: Reference, columns: Sequence[Columns], left: Sequence[Floats]
) -> tuple[dict[str, float], list[Floats]]:
    """Return how far friction, offset, inertia and snap are off on days left out, and what those do not take up."""
    size = rms(np.concatenate([c["u"] for c in columns]))
    each = [np.column_stack([c["dry"], c["viscous"], c["one"] * size, c["a"], c["s"]]) for c in columns]
    (dry, viscous, offset, inertia, snap), rest = _taken_off(each, left, [c["moving"] for c in columns])
    seen = {"dry": dry, "viscous": viscous, "friction": 0.5 * (dry + viscous), "offset": offset}
    seen = {k: min(x, (3.0 * SETTINGS.widths[k]) ** 2) for k, x in seen.items()}
    own = {"inertia": float(np.sqrt(inertia)), "snap": float(np.sqrt(snap)), "effort": size}
    return {**SETTINGS.widths, **_mixed(r, seen), **own}, rest


def _between_days(
    r: Reference, name: str, columns: Sequence[Columns], left: Sequence[Floats]
) -> tuple[dict[str, float], list[Floats]]:
    """Return how far zero, scale and give between two encoders are off on days left out, and what is left then."""
    each = [np.column_stack([c["one"], c["q"] - c["q"].mean(), r.twist(name, c)]) for c in columns]
    (zero, scale, give), rest = _taken_off(each, left, [c["one"] for c in columns])
    return _mixed(r, {"zero": zero, "scale": scale, "give": give}), rest


def _taken_off(
    columns: Sequence[Floats], left: Sequence[Floats], counts: Sequence[Floats]
) -> tuple[Floats, list[Floats]]:
    """Return the mean squares of what each log needs of columns (n, p) on rows that count, and what is left."""
    numbers, rest = [], []
    for X, y, m in zip(columns, left, counts, strict=True):
        A = X * m[:, None]
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        A /= scale
        numbers.append(np.linalg.solve(A.T @ A + 1e-6 * np.eye(A.shape[1]), A.T @ (y * m)) / scale)
        rest.append(y - X @ numbers[-1])
    return np.asarray(np.mean(np.square(numbers), axis=0)), rest


def _mixed(r: Reference, seen: Mapping[str, float]) -> dict[str, float]:
    """Return widths from the mean squares that several days show, and the prior, which counts for some days itself."""
    days, count = r.days if r.days >= SEVERAL else 0, SETTINGS.prior_days

    def width(x: float, prior: float) -> float:
        return float(np.sqrt((days * x + count * prior**2) / (days + count)))

    return {k: width(x, SETTINGS.widths[k]) for k, x in seen.items()}


def _law_widths(law: Law, columns: Sequence[Columns], left: Sequence[Floats]) -> dict[str, float]:
    """Return how far each number of a law is off on a log left out."""
    out, each = {}, [law.columns(c) for c in columns]
    for name in ("position_gain", "loop_gain", "velocity_feedforward", "acceleration_feedforward", "lead"):
        pairs = zip((x[name] - x[name].mean() for x in each), left, strict=True)
        off = [float(z @ y) / max(float(z @ z), 1e-300) for z, y in pairs]
        out[name] = min(1.5 * rms(np.array(off)) + 1e-5, 1.0)  # of one near none anything would be a multiple
    return out


def shared_shape(
    columns: Sequence[Columns], left: Sequence[Floats], count: int = 60
) -> tuple[Floats, Floats]:
    """Return places and the misfit that logs share there, shape (count,) each, shrunk by how far they agree."""
    q = [c["q"][c["moving"] > 0.0] for c in columns]
    q = [x if len(x) else np.zeros(1) for x in q]
    edges = np.linspace(min(x.min() for x in q), max(x.max() for x in q) + 1e-12, count + 1)
    mean = np.full((len(columns), count), np.nan)
    for i, (c, r) in enumerate(zip(columns, left, strict=True)):
        rows = c["moving"] > 0.0
        at = np.clip(np.digitize(c["q"][rows], edges) - 1, 0, count - 1)
        n = np.bincount(at, minlength=count)
        mean[i] = np.where(n > 0, np.bincount(at, r[rows], count) / np.maximum(n, 1), np.nan)
    n = np.isfinite(mean).sum(axis=0)
    level = np.nansum(mean, axis=0) / np.maximum(n, 1)
    many = n > 1  # where one log was alone nothing is shared
    noise = float(np.nansum((mean - level) ** 2)) / max(int((n - 1)[many].sum()), 1)
    power, logs = (float(np.sum(x[many])) / max(int(many.sum()), 1) for x in (level**2, n))
    signal = max(power - noise / max(logs, 1.0), 0.0)
    shrunk = level * many * signal / (signal + noise / np.maximum(n, 0.5) + 1e-300)
    return 0.5 * (edges[1:] + edges[:-1]), shrunk
