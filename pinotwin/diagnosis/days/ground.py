"""What a machine's model leaves of the logs that it was identified from, as cells of the one score.

The columns of the twin are nuisances. Beside a candidate they are fitted again, for they have taken up what they could
of it: those of each axis are compressed to what its rows tell apart, have a wide prior, and are shared by all logs.
Shapes of the twin's effects count by their tangents. The scale of a row is that of the noise, not of what is left: a
cell is Student's t, so what a cause is worth is the ratio of what is left before and after, whatever else is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.data.comparison import Comparison, by_days, thinned_model, within
from pinotwin.diagnosis.data.samples import Sample, sample
from pinotwin.diagnosis.days.score import Cells, density, errors, padded, score, squared
from pinotwin.diagnosis.days.whitening import _spread
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import EFFECTS, Effect
from pinotwin.effects.family import FRICTION
from pinotwin.effects.tree import Tree
from pinotwin.identification.misfit import own_residual
from pinotwin.signals import joined, rms

Tables = Sequence[Mapping[int, Floats]]
"""Columns on every sample: joint -> (m, p)."""


@dataclass(frozen=True, eq=False)
class Part:
    """The rows of one axis in the logs in question, or in those of validation.

    Attributes:
        twin: columns of the twin that its rows tell apart, of RMS one, shape (m, z). day: what a healthy axis may do,
            times its width, shape (m, d). left: measured effort less the twin's, shape (m,) [N or N·m].
        t: time of each row [s]. log: number of its log. edges: where each cell begins, with the end, shape (c + 1,).
        fold: of each cell, shape (c,).
    """

    twin: Floats
    day: Floats
    left: Floats
    t: Floats
    log: Ints
    edges: Ints
    fold: Ints

    @classmethod
    def of(cls, s: Sample, j: int, twin: Floats, day: Floats) -> Part:
        """Return the rows of a joint of a sample."""
        t = s.motion.t[s.samples(j)]
        log = np.zeros(len(t), dtype=np.intp)
        for k, rows in enumerate(joined(t)):
            log[rows] = k
        cell = np.floor(t / SETTINGS.cell).astype(np.intp)
        edges = np.flatnonzero(np.r_[True, (np.diff(cell) != 0) | (np.diff(log) != 0), True])
        fold = (cell + log)[edges[:-1]] % SETTINGS.folds
        return cls(twin, day, s.residual[j], t, log, edges, fold)

    def apart(self, left: Floats) -> float:
        """Return of how many rows of a residual (m,) one is independent; what acts for a while is no noise."""
        middle = np.median(left)
        wide = 4.0 * float(np.median(np.abs(left - middle)))
        left = np.clip(left, middle - wide, middle + wide)
        step = np.diff(self.t)
        broken = np.flatnonzero(np.r_[True, (step < 0.0) | (step > 10.5 * np.median(step)), True])
        return max(_spread(np.concatenate([left[a:b] - left[a:b].mean() for a, b in pairwise(broken)])), 1.0)

    def cells(self, noise: tuple[float, float], columns: Floats) -> Cells:
        """Return the cells of the rows with columns (m, p); ``noise``: of a row, and how many count as one."""
        sigma, spread = noise
        own = np.column_stack([self.twin * SETTINGS.wide * sigma, self.day])
        X = np.column_stack([np.zeros(len(self.left)), own, columns, self.left]) / (sigma * np.sqrt(spread))
        x, rows = padded([X[a:b] for a, b in pairwise(self.edges)]), np.diff(self.edges) / spread
        day, nothing = own.shape[1], np.zeros(len(rows), dtype=np.intp)
        at = {"cause": 1 + day + np.arange(columns.shape[1])}
        return Cells(x, rows, nothing, self.fold, 0.0 * rows, day, at)


@dataclass(frozen=True, eq=False)
class Fit:
    """A candidate on some axes.

    Attributes:
        held: joint -> log density of every cell by numbers that do not know it. full: by numbers that do.
        seen: joint -> log density of every validation cell by the numbers as they are, none without such logs.
        cost: log prior of the healthy day [nats]. left: joint -> what is left, summed squares [N² or N²·m²].
        days: joint -> what is taken off of the twin's columns, and of the healthy day, in standard deviations.
        theta: numbers, shape (p,). covariance: theirs, shape (p, p).
    """

    held: Mapping[int, Floats]
    full: Mapping[int, Floats]
    seen: Mapping[int, Floats]
    cost: float
    left: Mapping[int, float]
    days: Mapping[int, Floats]
    theta: Floats
    covariance: Floats

    @property
    def error(self) -> Floats:
        """Standard errors of the numbers, shape (p,)."""
        return errors(self.covariance)

    @property
    def density(self) -> float:
        """Log density of all cells, and of the healthy day [nats]."""
        return sum(float(x.sum()) for x in self.held.values()) + self.cost


@dataclass(eq=False)
class Ground:
    """All axes of a comparison, with what was found so far among the nuisances.

    Attributes:
        samples: logs in question, then those of validation. parts: joint -> rows of each. noise: joint -> scale of a
            row [N or N·m], and how many count as one. base: joint -> what is left without a further cause.
        past: the same of a twin's own logs, what it leaves of them when it does not know them; None of a machine.
        days: joint -> what a healthy axis does beside its twin, the same whatever was found.
    """

    c: Comparison
    samples: Sequence[Sample]
    own: Sequence[Mapping[int, Floats]]
    found: Sequence[tuple[Tables, int]] = ()
    parts: dict[int, list[Part]] = field(default_factory=dict)
    noise: dict[int, tuple[float, float]] = field(default_factory=dict)
    base: dict[int, Fit] = field(default_factory=dict)
    past: Ground | None = None
    rough: dict[int, tuple[Floats, Floats, Floats]] = field(default_factory=dict)
    days: dict[int, list[Floats]] = field(default_factory=dict)

    @cached_property
    def model(self) -> Tables:
        """Columns of all effects of the twin on every sample: joint -> (m, b)."""
        return thinned_model(self.samples, self.c.twin.effects)

    @classmethod
    def of(cls, c: Comparison, rate: float = SETTINGS.rate) -> Ground:
        """Return the ground of a comparison, at about so many rows a second [Hz]."""
        past = None
        if c.own is not None:
            own = [_thin(c.own, own_residual(c.twin), rate)]
            past = cls(c, own, _known(c, own))
            for j in own[0].joints:
                past._lay(j)
        samples = list[Sample]()
        for s in (c.new, c.unseen):
            if s is not None:
                thin = _thin(s, s.motion.u - c.twin.effort(s.motion), rate)
                samples.append(within(thin, samples[0], c.twin) if samples else thin)
        out = cls(c, samples, _known(c, samples), past=past)
        for j in samples[0].joints:
            out._lay(j)
        return out

    def beside(self, tables: Tables, width: int) -> Ground:
        """Return the ground with a further cause among the nuisances; axes on which it does not act stay."""
        out = replace(self, found=[*self.found, (tables, width)])
        out.parts, out.noise, out.base = dict(self.parts), dict(self.noise), dict(self.base)
        out.rough = dict(self.rough)
        for j in self.parts:
            if j in tables[0]:
                out._lay(j)
        return out

    def _lay(self, j: int) -> None:
        """Compress the nuisances of a joint and measure the noise beside them."""
        self.rough.pop(j, None)
        if j not in self.days:
            self.days[j] = self._day(j)
        each = [self.columns(k, j) for k, s in enumerate(self.samples) if j in s.joints]
        turn = _compressed(each[0])
        self.parts[j] = [
            Part.of(s, j, x @ turn, day)
            for s, x, day in zip([s for s in self.samples if j in s.joints], each, self.days[j], strict=True)
        ]
        p = self.parts[j][0]
        noise = self.c.noise.get(j, 0.0) if self.c.own is None else self.c.own.level(j)
        sigma = np.hypot(noise, SETTINGS.floor * self.samples[0].size(j)) + 1e-300
        left = p.left - p.twin @ (p.twin.T @ p.left) / len(p.left)
        for _ in range(2):  # again by what robust numbers leave
            past = self.past  # as long as in the twin's own logs, whatever the rates
            rows = p.apart(left) if past is None else past.noise[j][1] * past.step / self.step
            self.noise[j] = float(sigma), max(rows, 1.0)
            self.base[j] = self.alone(j)
            left = self.left(j)
        self.settle(j)

    def settle(self, j: int) -> None:
        """Let what is no habit of a healthy axis leave the day of a joint, by its fit without any cause."""
        twin = self.parts[j][0].twin.shape[1]
        if not (usual := np.abs(self.base[j].days[j][twin:]) <= SETTINGS.far).all():
            self.parts[j] = [replace(x, day=x.day * usual) for x in self.parts[j]]
            self.base[j] = self.alone(j)

    def alone(self, j: int) -> Fit:
        """Return the fit of a joint without any cause."""
        return self.fit([{j: np.zeros((len(self.parts[j][0].left), 0))}, {}])

    @property
    def step(self) -> float:
        """Time between two rows [s]."""
        return self.samples[0].motion.step * self.samples[0].motion.decimation

    def as_noisy_as(self, rest: Ground) -> Ground:
        """Return the ground by the noise of what is left beside a cause: numbers are as sure as that is small."""
        other = [j for j in self.parts if rest.parts[j] is not self.parts[j]]
        return self._with_noise({j: (max(rms(rest.left(j)), 1e-300), rest.noise[j][1]) for j in other})

    def fine(self, j: int) -> Ground:
        """Return the ground on which rows of a joint tell more: what lasts a while is no noise here."""
        return self._with_noise({j: (self.noise[j][0], float(np.sqrt(self.noise[j][1])))})

    def _with_noise(self, noise: Mapping[int, tuple[float, float]]) -> Ground:
        out = replace(self, noise={**self.noise, **noise}, base=dict(self.base))
        out.base |= {j: out.alone(j) for j in noise}
        return out

    @cached_property
    def shared(self) -> tuple[Floats, dict[int, Floats]]:
        """What turns all columns into those that all axes together tell apart, shape (b, z), and what each axis tells.

        Joint -> Gram matrix of these and of what is left, over the noise, shape (z + 1, z + 1).
        """
        each = {j: self.columns(0, j) for j in self.parts}
        turn, out = _compressed(np.vstack(list(each.values()))), dict[int, Floats]()
        for j, X in each.items():
            rows = np.c_[X @ turn, self.parts[j][0].left] / self.noise[j][0]
            out[j] = rows.T @ rows / self.noise[j][1]
        return turn, out

    def power(self, j: int, density_: Floats, part: int) -> Floats:
        """Return the squared residual of every cell of a joint from its log density [nats], (c,) [N² or N²·m²]."""
        sigma, spread = self.noise[j]
        return squared(density_, np.diff(self.parts[j][part].edges) / spread) * sigma**2 * spread

    def refitted(self, j: int, fit: Fit) -> Floats:
        """Return how the twin's coefficients move beside a cause, by the rows of one joint, shape (b,)."""
        found = _compressed(self.columns(0, j)) @ -fit.days[j][: self.parts[j][0].twin.shape[1]]
        return np.asarray(found[: len(self.c.twin.theta)] * SETTINGS.wide * self.noise[j][0])

    def instead(self, j: int, columns: Floats, own: Sequence[int]) -> tuple[Floats, Floats, Floats] | None:
        """Return the numbers of columns (m, p) that stand for some of the twin's on a joint; None if they do not.

        What turns the twin's numbers into these, shape (p, len(own)); numbers, shape (p,); their covariance.
        """
        X, p = self.columns(0, j), self.parts[j][0]
        turn = np.linalg.lstsq(columns, X[:, own], rcond=1e-9)[0]
        if np.sum((X[:, own] - columns @ turn) ** 2) > 1e-6 * np.sum(X[:, own] ** 2):
            return None
        rest, size = np.delete(X, own, axis=1), np.sqrt(np.mean(columns**2, axis=0))
        cells = replace(p, twin=rest @ _compressed(rest)).cells(self.noise[j], columns / size)
        got = score([(cells, cells.at["cause"])], len(size), form=False)
        theta = np.asarray(got.theta / size)
        return np.asarray(turn), theta, np.asarray(got.covariance / np.outer(size, size))

    def left(self, j: int) -> Floats:
        """Return what the nuisances alone leave of the rows of a joint, shape (m,) [N or N·m]."""
        p = self.parts[j][0]
        return p.left + np.hstack([p.twin * SETTINGS.wide * self.noise[j][0], p.day]) @ self.base[j].days[j]

    def columns(self, k: int, j: int) -> Floats:
        """Return the columns of the twin, and of what was found, of a joint on a sample, shape (m, b)."""
        found = []
        for tables, width in self.found:
            none = np.zeros((len(self.own[k][j]), width))
            found.append(tables[k].get(j, none) if k < len(tables) else none)
        return np.hstack([self.own[k][j], *found])

    def _day(self, j: int) -> list[Floats]:
        """Return what a healthy axis does beside its twin: its drive holds an effort for a cycle, and a log smooths."""
        c = self.c
        tree = Tree(c.twin.model, c.machine.names, c.machine.rotary)
        late = EFFECTS["delay"].on(tree, c.machine.names[j])
        out = []
        for s, unsure in zip((s for s in self.samples if j in s.joints), self._unsure(j), strict=True):
            before, after = (s.columns(late.shaped([x]))[j] for x in (1e-4, -1e-4))
            blur = (before - after) * s.motion.step * SETTINGS.blur
            out.append(np.hstack([0.5 * (before + after) * SETTINGS.late, blur, unsure]))
        return out

    def _unsure(self, j: int) -> list[Floats]:
        """Return how a twin may be off on logs that it does not know: its coefficients, and the friction of each day.

        Nobody knows the day of the validation logs: theirs is the mean of those in question.
        """
        c, samples = self.c, [s for s in self.samples if j in s.joints]
        if not c.change:
            return [np.zeros((len(s.residual[j]), 0)) for s in samples]
        rub = [w for e, w in zip(c.twin.effects, c.twin.slices, strict=True) if e.family is FRICTION]
        columns = [x[j] for x in self.model if j in x]
        root = _root(c.twin.covariance)
        _, size, V = np.linalg.svd(columns[0] @ root, full_matrices=False)
        off = root @ V[size > 0.01 * np.sqrt(len(columns[0])) * c.floor[j]].T
        logs, days = joined(samples[0].motion.t[samples[0].samples(j)]), list[Floats]()
        for k, X in enumerate(columns):
            one = by_days(c, j) * np.array([X[:, w] @ c.twin.theta[w] for w in rub]).reshape(-1, len(X)).T
            acts = np.full((len(logs), len(X)), 1.0 / len(logs)) if k else np.zeros((len(logs), len(X)))
            for own, rows in zip(acts, logs if k == 0 else (), strict=False):
                own[rows] = 1.0
            days.append(np.hstack([one * own[:, None] for own in acts]))
        kept = days[0].any(axis=0)
        return [np.hstack([x[:, kept], X @ off]) for x, X in zip(days, columns, strict=True)]

    def fit(self, tables: Tables) -> Fit:
        """Return what columns of a cause are worth on the joints that they act on."""
        joints = [j for j in tables[0] if j in self.parts]
        count = tables[0][joints[0]].shape[1]
        use = [self.parts[j][0].cells(self.noise[j], tables[0][j]) for j in joints]
        got = score([(x, x.at["cause"]) for x in use], count, form=False)
        left = {
            j: _least(c) * self.noise[j][0] ** 2 * self.noise[j][1] for j, c in zip(joints, use, strict=True)
        }
        held, every, days = (dict(zip(joints, x, strict=True)) for x in (got.held, got.full, got.days))
        seen = {j: self._seen(j, tables, got.theta, days[j]) for j in joints}
        return Fit(held, every, seen, got.cost, left, days, got.theta, got.covariance)

    def _seen(self, j: int, tables: Tables, theta: Floats, day: Floats) -> Floats:
        """Return the log density of the validation cells of a joint by numbers as they are."""
        if len(self.parts[j]) < 2:
            return np.zeros(0)
        p, none = self.parts[j][1], np.zeros((len(self.parts[j][1].left), len(theta)))
        cells = p.cells(self.noise[j], tables[1].get(j, none) if len(tables) > 1 else none)
        x = np.r_[0.0, day, -theta, 1.0]
        return density(np.sum(np.tensordot(x, cells.x, 1) ** 2, axis=1), cells.rows)

    def explains(self, effects: Sequence[Effect], block: int = 32) -> list[float]:
        """Return about what each effect explains [1], by some rows; -1 if it cannot be. So many share a product."""
        if len(effects) > block:
            return [x for k in range(0, len(effects), block) for x in self.explains(effects[k : k + block])]
        each = [self.samples[0].skimmed(e, self.c.new) for e in effects]
        ends = np.cumsum([0, *(len(e.coefficients()) for e in effects)]).tolist()
        own, N, right = list(map(slice, ends, ends[1:])), np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1])
        for j in {j for columns, _ in each for j in columns if j in self.parts}:
            Q, weight, left = self._some(j, each[0][1][j])
            X = np.zeros((len(left), ends[-1]))
            for (columns, _), at in zip(each, own, strict=True):
                X[:, at] = columns.get(j, 0.0)
            A = weight[:, None] * (X - Q @ (Q.T @ X))
            N, right = N + A.T @ A, right + A.T @ left
        return [_explained(e, N[at, at], right[at]) for e, at in zip(effects, own, strict=True)]

    def _some(self, j: int, rows: Ints) -> tuple[Floats, Floats, Floats]:
        """Return an orthonormal base of the nuisances on some rows, weights (less of loud cells), and what is left."""
        if j not in self.rough:
            p, count = self.parts[j][0], np.diff(self.parts[j][0].edges)
            Q, _ = np.linalg.qr(p.twin[rows])
            cell = np.exp(self.base[j].full[j] / (SETTINGS.freedom + count / self.noise[j][1]))
            weight = np.repeat(cell, count)[rows] / self.noise[j][0]
            left = p.left[rows] - Q @ (Q.T @ p.left[rows])
            self.rough[j] = Q, weight, weight * left
        return self.rough[j]

    def table(self, effect: Effect) -> Tables | None:
        """Return the columns of an effect on every sample; None where it acts on no row, or is infinite."""
        out = [{j: x for j, x in s.columns(effect).items() if j in self.parts} for s in self.samples]
        finite = all(np.isfinite(x).all() for t in out for x in t.values())
        return out if out[0] and finite else None

    def tangents(self, effect: Effect, tables: Tables, theta: Floats) -> Iterator[Tables]:
        """Yield how the effort of coefficients (p,) changes with every shape of an effect."""
        for n, s in enumerate(effect.shapes()):
            values = list(effect.shape_values())
            more = 1.005 * values[n] if s.log else values[n] + 0.005 * (s.upper - s.lower)
            values[n] = float(np.clip(more, s.lower, s.upper))
            moved = values[n] != effect.shape_values()[n]
            other = self.table(effect.shaped(values)) if moved else None
            if other is not None:
                yield [
                    {j: ((o[j] - t[j]) @ theta)[:, None] for j in t if j in o}
                    for o, t in zip(other, tables, strict=True)
                ]

    def spanned(self, effect: Effect, tables: Tables, theta: Floats) -> tuple[Tables, int]:
        """Return columns of a cause with its tangents, for its form stays uncertain, and how many these are."""
        more = list(self.tangents(effect, tables, theta))
        out = [
            {j: np.hstack([x, *(m[k].get(j, np.zeros((len(x), 1))) for m in more)]) for j, x in t.items()}
            for k, t in enumerate(tables)
        ]
        return out, next(iter(out[0].values())).shape[1]

    def least(self, j: int, share: float) -> float:
        """Return the least worth a word, of the variation of a joint's effort [1]: a change is more than the misfit."""
        misfit = 0.0 if self.c.own is None else self.c.own.level(j)
        return max(share, misfit / max(self.samples[0].size(j), 1e-300))

    def loud(self, j: int) -> bool:
        """Whether a joint leaves more than any model does, and the misfit beside it."""
        return self.open(j) > np.hypot(self.least(j, 0.0), self.least(j, SETTINGS.floor))

    def open(self, j: int) -> float:
        """Return what is left of a joint over the variation of its effort, RMS [1]."""
        count, size = len(self.parts[j][0].left), self.samples[0].size(j)
        return float(np.sqrt(max(self.base[j].left[j], 0.0) / count) / max(size, 1e-300))


def _thin(s: Sample, residual: Floats, rate: float) -> Sample:
    own = s.motion.decimation  # whole ones of its rows, for what swings is screened on these
    count = own * max(round(1.0 / (s.motion.step * own * rate)), 1)
    motion = replace(s.motion, decimation=count)
    return sample(motion, residual).only(s.joints)


def _root(covariance: Floats) -> Floats:
    """Return columns whose squares are a covariance, shape (b, b)."""
    d = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    size, V = np.linalg.eigh(covariance / np.outer(d, d))
    return np.asarray(d[:, None] * V * np.sqrt(np.maximum(size, 0.0)))


def _known(c: Comparison, samples: Sequence[Sample]) -> list[dict[int, Floats]]:
    """Return the columns of a machine's twin with the tangents of its shapes, on every sample: joint -> (m, b)."""
    if c.change:
        return [{j: np.zeros((len(x), 0)) for j, x in s.residual.items()} for s in samples]
    out = thinned_model(samples, c.twin.effects)
    bare = Ground(c, samples, out, parts={j: [] for j in samples[0].joints})
    for e, where in zip(c.twin.effects, c.twin.slices, strict=True):
        found = bare.table(e) if e.shapes() else None
        for more in () if found is None else bare.tangents(e, found, c.twin.theta[where]):
            out = [
                {j: np.hstack([x, m.get(j, np.zeros((len(x), 1)))]) for j, x in t.items()}
                for t, m in zip(out, more, strict=True)
            ]
    return out


def _compressed(X: Floats) -> Floats:
    """Return what turns columns (m, b) into those of RMS one that the rows tell apart, shape (b, z)."""
    size = np.sqrt(np.mean(X**2, axis=0))
    if not size.any():
        return np.zeros((X.shape[1], 0))
    on = size > 1e-12 * max(float(size.max()), 1e-300)
    _, s, V = np.linalg.svd(X[:, on] / size[on], full_matrices=False)
    kept = s > 1e-4 * s[0]
    out = np.zeros((X.shape[1], int(kept.sum())))
    out[on] = (V[kept].T / s[kept]) * np.sqrt(len(X)) / size[on][:, None]
    return out


def _explained(effect: Effect, N: Floats, right: Floats) -> float:
    """Return what an effect explains by the normal equations of its columns, (p, p) and (p,); -1 if it cannot be."""
    d = np.sqrt(np.maximum(np.diag(N), 1e-300))
    if not len(d) or not np.isfinite(N).all():
        return -1.0
    theta = np.linalg.solve(N / np.outer(d, d) + 1e-6 * np.eye(len(d)), right / d) / d
    return float(right @ theta) if effect.possible(theta) else -1.0


def _least(c: Cells) -> float:
    """Return what the best numbers leave of all cells, weighed alike."""
    X = c.x.reshape(len(c.x), -1)[1:]
    N = X @ X.T
    own = N[:-1, :-1] + np.diag(np.r_[np.ones(c.day), np.zeros(len(N) - 1 - c.day)])
    d = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    x = np.linalg.solve(own * d * d[:, None] + 1e-10 * np.eye(len(own)), N[:-1, -1] * d)
    return float(N[-1, -1] - (N[:-1, -1] * d) @ x)
