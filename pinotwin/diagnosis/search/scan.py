"""Every candidate on the ground as it stands: what it closes on rows that it was not fitted to."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.data.comparison import Comparison, thinned_model
from pinotwin.diagnosis.evidence.held_out import FREE, HELD, Ground, Judged, judged
from pinotwin.diagnosis.evidence.moments import Base, Products, base_of, products
from pinotwin.diagnosis.rules import Rules
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_slices
from pinotwin.solve.jackknife import jackknife

Table = Sequence[Mapping[int, Floats]]  # Columns of one effect on every sample: joint -> (m, p)
SMOOTH = ((0.05, 24),)
"""Steps by which shapes are polished [of their logarithm or range], and how often a candidate is scored meanwhile."""
ROUGH = ((0.3, 60), (0.05, 24))
"""The same of effects of :data:`RUGGED` shapes: play that meets its faces a moment earlier is another course."""
RUGGED = 3  # [shapes that are searched] From here the way to the best is no smooth one


@dataclass(frozen=True, eq=False)
class Scored:
    """One candidate with what it is worth."""

    effect: Effect  # at its shapes
    table: Table = field(repr=False)  # its columns on every sample
    judged: Judged = field(repr=False)  # coefficients and what is left
    gain: float  # squared residual closed on rows not fitted, in units of the floor
    share: float  # the same over the squared residual of the joints it acts on
    joint: int  # the joint whose effort it moves most, against its floor
    order: int = 0  # place of its axis in the tree

    @property
    def key(self) -> tuple[str, str | None]:
        """Name of its effect and its axis."""
        effect = named(self.effect)
        return effect.name, effect.axis

    @property
    def numbers(self) -> int:
        """How many numbers it has: coefficients, and shapes that were searched."""
        return len(self.judged.theta) + type(self.effect).searched


class Searcher:
    """The candidates of a comparison, scored beside the causes found so far."""

    def __init__(self, comparison: Comparison, found: Sequence[Scored] = ()) -> None:
        self.comparison = comparison
        self.found = tuple(found)

    @cached_property
    def ground(self) -> Ground:
        """The model with the causes found so far among its columns."""
        c = self.comparison
        samples = c.samples
        tables = thinned_model(samples, c.model_columns)
        for one in self.found:
            for s, table, part in zip(samples, tables, one.table, strict=True):
                p = len(one.judged.theta)
                for j in s.joints:
                    more = part.get(j, np.zeros((len(s.residual[j]), p)))
                    table[j] = np.hstack([table[j], more])
        width = next(iter(tables[0].values())).shape[1]
        bases = [base_of(s, t, c.floor, width) for s, t in zip(samples, tables, strict=True)]
        own = bases[1] if c.own is not None else None
        unseen = bases[-1] if c.unseen is not None else None
        diagonal = np.einsum("kjbb->b", bases[0].XX)
        held = np.zeros(width, dtype=bool)
        held[: len(c.held)] = c.held_beside({named(one.effect).axis for one in self.found} - {None})
        diagonal = np.where(held, HELD * diagonal, FREE * diagonal)
        belief, pull = np.zeros((width, width)), np.zeros(width)
        for effect, where in zip(c.model_columns, effect_slices(c.model_columns), strict=True):
            if (said := effect.belief()) is not None:
                belief[where, where] = said[0].T @ said[0]
                pull[where] = belief[where, where] @ c.twin.theta[where]
        return Ground(bases[0], own, unseen, diagonal + 1e-300, held, belief, pull)

    def residual(self) -> dict[int, Floats]:
        """Return what the model leaves of the logs in question with all its columns fitted, floor units."""
        delta = self.ground.alone.base
        base = self.ground.new
        return {j: base.residual[j] - base.columns[j] @ delta for j in base.sample.joints}

    def table(self, effect: Effect, *, screen: bool = False) -> Table | None:
        """Return an effect's columns on every sample (``screen``: thinned); None on no row or where infinite."""
        samples = self.comparison.samples
        tables = [s.screened(effect) if screen else s.columns(effect) for s in samples]
        if not tables[0] or not all(np.isfinite(x).all() for t in tables for x in t.values()):
            return None
        power = sum(float(np.sum(x * x)) for x in tables[0].values())
        return tables if power > 0.0 else None

    def score(self, effect: Effect, table: Table | None = None) -> Scored | None:
        """Return what an effect is worth; None if the model's own columns leave nothing of it."""
        table = table or self.table(effect)
        return None if table is None else self._scored(effect, table, self._fitted(effect, table))

    def bounded(self, one: Scored, low: Floats, high: Floats) -> Scored | None:
        """Return a candidate with the change of its coefficients held within bounds, as uncertain as it was."""
        found = self._fitted(one.effect, one.table, (low, high))
        own = one.judged.covariance - jackknife(found.folds)
        return self._scored(one.effect, one.table, replace(found, own=own))

    def _fitted(self, effect: Effect, table: Table, span: tuple[Floats, Floats] | None = None) -> Judged:
        bases = (self.ground.new, self.ground.own, self.ground.unseen)
        rest = iter(table)
        parts = [None if base is None else _products(base, next(rest)) for base in bases]
        assert parts[0] is not None
        return judged(self.ground, parts[0], parts[1], parts[2], self._hold(effect), span)

    def _scored(self, effect: Effect, table: Table, found: Judged) -> Scored | None:
        if not found.determined or not np.isfinite(found.left).all():
            return None
        alone = self.ground.alone
        gain = float((alone.left - found.left).sum() + (alone.unseen - found.unseen).sum())
        names, floor = self.comparison.machine.names, self.comparison.floor
        joint = max(table[0], key=lambda j: float(np.sum((table[0][j] @ found.theta) ** 2)) / floor[j] ** 2)
        order = names.index(effect.axis) if effect.axis in names else 0
        return Scored(effect, table, found, gain, gain / max(self.power(table[0]), 1e-300), joint, order)

    def _hold(self, effect: Effect) -> float:
        """Return the precision that keeps knots which hardly a row tells within their axis' effort [1 / unit²]."""
        axis = self.comparison.machine.axes.get(effect.axis or "")
        if axis is None or not effect.held:
            return 0.0
        return 1.0 / max(self.comparison.new.size(axis.index), 1e-300) ** 2

    def main_gains(self, one: Scored) -> tuple[Floats, Floats]:
        """Return what a candidate closes of its main joint alone, floor units: blocks (K,), validation blocks (L,).

        A body on a link moves every joint before it: what it closes in all is no share of one joint's gap.
        """
        if len(one.table[0]) > 1:
            return self.gains_at(one, one.joint)
        alone = self.ground.alone
        return alone.left - one.judged.left, alone.unseen - one.judged.unseen

    def gains_at(self, one: Scored, joint: int) -> tuple[Floats, Floats]:
        """Return what a candidate closes of one of its joints: blocks (K,), validation blocks (L,)."""
        ground, found = self.ground, one.judged
        new = self._closed_at(ground.new, one.table[0], joint, found.folds, found.base_folds, 0)
        if ground.unseen is None or joint not in ground.unseen.sample.joints:
            return new, np.zeros(len(found.unseen))
        L = ground.unseen.sample.blocks
        theta, delta = (np.repeat(x[None], L, axis=0) for x in (found.theta, found.base))
        return new, self._closed_at(ground.unseen, one.table[-1], joint, theta, delta, 1)

    def _closed_at(
        self, base: Base, columns: Mapping[int, Floats], joint: int, theta: Floats, delta: Floats, part: int
    ) -> Floats:
        block = base.sample.block[joint]
        said = np.einsum("mp,mp->m", columns[joint] / base.floor[joint], theta[block])
        said += np.einsum("mb,mb->m", base.columns[joint], delta[block])
        left = np.bincount(block, (base.residual[joint] - said) ** 2, base.sample.blocks)
        before = self.alone_by_joint[part][:, base.sample.joints.index(joint)]
        return np.asarray(before - left)

    def power_beyond_noise(self, joints: Collection[int], most: float) -> float:
        """Return :meth:`power` without the noise that repeats tell, at most this share of it."""
        c, power = self.comparison, self.power(joints)
        samples = (c.new,) if c.unseen is None else (c.new, c.unseen)
        rows = [(j, len(s.residual[j])) for s in samples for j in joints if j in s.joints]
        noise = sum(n * (c.noise.get(j, 0.0) / c.floor[j]) ** 2 for j, n in rows)
        return power - min(noise, most * power)

    def power(self, joints: Collection[int]) -> float:
        """Return the squared residual, not fitted, at some joints, floor units."""
        total = 0.0
        for base, left in zip((self.ground.new, self.ground.unseen), self.alone_by_joint, strict=True):
            at = [] if base is None else [k for k, j in enumerate(base.sample.joints) if j in joints]
            total += sum(float(left[:, k].sum()) for k in at)
        return total

    @cached_property
    def alone_by_joint(self) -> tuple[Floats, Floats]:
        """Squared residual of every block and joint without a candidate: new logs, validation logs."""
        return _alone(self.ground)

    def polished(self, scored: Scored) -> Scored:
        """Return a candidate with its shapes moved to where it closes most."""
        shapes = scored.effect.shapes()
        if not shapes or type(scored.effect).searched == 0:
            return scored
        best = scored
        low = np.array([np.log(s.lower) if s.log else s.lower for s in shapes])
        high = np.array([np.log(s.upper) if s.log else s.upper for s in shapes])
        log = np.array([s.log for s in shapes])

        def values(x: Floats) -> list[float]:
            x = np.clip(x, low, high)
            return [float(np.exp(v)) if g else float(v) for v, g in zip(x, log, strict=True)]

        def loss(x: Floats) -> float:
            nonlocal best
            try:
                one = self.score(scored.effect.shaped(values(x)))
            except (ValueError, FloatingPointError):
                return 0.0
            if one is None or not one.effect.possible(one.judged.theta):
                return 0.0
            if one.gain > best.gain:
                best = one
            return -one.gain

        for size, most in ROUGH if type(scored.effect).searched >= RUGGED else SMOOTH:
            start = np.array(
                [np.log(v) if g else v for v, g in zip(best.effect.shape_values(), log, strict=True)]
            )
            steps = np.diag(np.where(log, size, size * (high - low)))
            simplex = np.vstack([start, *(start + steps)])
            minimize(loss, start, method="Nelder-Mead", options={"maxfev": most, "initial_simplex": simplex})
        return best


def _products(base: Base, part: Mapping[int, Floats]) -> Products | None:
    usable = {j: x for j, x in part.items() if j in base.sample.joints and j in base.floor}
    return products(base, usable) if usable else None


def _alone(ground: Ground) -> tuple[Floats, Floats]:
    found = ground.alone
    new = _by_joint(ground.new, found.base_folds)
    if ground.unseen is None:
        return new, np.zeros((0, 0))
    return new, _by_joint(ground.unseen, np.repeat(found.base[None], ground.unseen.sample.blocks, axis=0))


def _by_joint(base: Base, delta: Floats) -> Floats:
    both = np.einsum("kb,kjbc,kc->kj", delta, base.XX, delta)
    return base.rr - 2.0 * np.einsum("kb,kjb->kj", delta, base.Xr) + both


def listed_elsewhere(one: Scored, searcher: Searcher, rules: Rules) -> bool:
    """Whether a cause stands for an effect that the machine lists, whose shape was fitted to something larger."""
    c, effect = searcher.comparison, named(one.effect)
    axis = c.machine.axes.get(effect.axis or "")
    if c.change or axis is None or not any(e.name == effect.name and e.shapes() for e in axis.effects):
        return False
    pairs = zip(c.twin.effects, c.twin.slices, strict=True)
    own = [where for e, where in pairs if (e.name, e.axis) == (effect.name, effect.axis)]
    return any(_worth(searcher, c.twin.theta, where) < rules.needless * one.gain for where in own)


def _worth(searcher: Searcher, theta: Floats, where: slice) -> float:
    """Return how much more the model would leave without some of its columns, floor units squared."""
    value = theta[where] + searcher.ground.alone.base[where]
    return float(value @ np.linalg.solve(searcher.ground.folds[-1][where, where], value))
