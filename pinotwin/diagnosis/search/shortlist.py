"""Which shapes of an effect are worth a close look: those that fit the residual best on thinned rows.

A plain fit without the model's columns ranks the instances of one name on one axis well; the best few are then scored
on unseen rows. More coefficients always fit better, so tables of several sizes are not ranked here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.scan import Searcher, Table
from pinotwin.effects import Effect
from pinotwin.effects.effect import AxisEffect

KEPT = 2  # Instances of one name on one axis, of each number of coefficients, that are scored on unseen rows
CLOSE = 24  # Instances in all, the best of those, whose columns are computed at the log's own rate


class Shortlist:
    """The candidates of a search, and the columns of those that were looked at."""

    def __init__(self, candidates: Sequence[Effect], rules: Rules = RULES) -> None:
        self.rules = rules
        self.groups: dict[tuple[str, str | None], list[Effect]] = defaultdict(list)
        for effect in candidates:
            self.groups[effect.name, effect.axis].append(effect)
        self.tables: dict[Effect, Table | None] = {}
        self.thinned: dict[Effect, Table | None] = {}
        self.chosen: dict[tuple[str, str | None], tuple[bytes, list[Effect]]] = {}

    def of(self, searcher: Searcher) -> list[tuple[Effect, Table]]:
        """Return the instances worth a close look on this ground, with their columns on every sample."""
        residual = searcher.residual()
        quiet = quiet_joints(searcher, self.rules)
        near: list[tuple[float, Effect]] = []
        for key, group in self.groups.items():
            if (
                isinstance(named(group[0]), AxisEffect)
                and searcher.comparison.machine.axes[str(key[1])].index in quiet
            ):
                continue
            for effect in group if len(group) <= KEPT else self._best(key, group, searcher, residual):
                if effect not in self.thinned:
                    self.thinned[effect] = searcher.table(effect, screen=True)
                table = self.thinned[effect]
                one = None if table is None else searcher.score(effect, table)
                if one is not None:
                    near.append((one.gain, effect))
        near.sort(key=lambda pair: -pair[0])
        return [pair for _, effect in near[:CLOSE] if (pair := self._exact(effect, searcher)) is not None]

    def _exact(self, effect: Effect, searcher: Searcher) -> tuple[Effect, Table] | None:
        if effect not in self.tables:
            self.tables[effect] = searcher.table(effect)
        table = self.tables[effect]
        return None if table is None else (effect, table)

    def _best(
        self,
        key: tuple[str, str | None],
        group: Sequence[Effect],
        searcher: Searcher,
        residual: Mapping[int, Floats],
    ) -> list[Effect]:
        """Return the best instances of one name on one axis; as before where its residual is as before."""
        sample = searcher.comparison.new
        axis = searcher.comparison.machine.axes[str(key[1])].index
        stamp = residual[axis].tobytes() if axis in residual else b""
        if key in self.chosen and self.chosen[key][0] == stamp:
            return self.chosen[key][1]
        floor = searcher.comparison.floor
        fits = [closes(sample, effect, residual, floor) for effect in group]
        best: dict[int, list[Effect]] = defaultdict(list)
        for k in sorted(range(len(group)), key=lambda k: -fits[k][0]):
            alike = best[fits[k][1]]
            if len(alike) < KEPT:
                alike.append(group[k])
        chosen = [effect for alike in best.values() for effect in alike]
        self.chosen[key] = (stamp, chosen)
        return chosen


def quiet_joints(searcher: Searcher, rules: Rules) -> set[int]:
    """Return the joints whose residual, without noise that repeats tell, is less than a cause must close of it."""
    c = searcher.comparison
    out = set()
    for at, j in enumerate(c.new.joints):
        power, rows = float(searcher.alone_by_joint[0][:, at].sum()), len(c.new.residual[j])
        if c.unseen is not None and j in c.unseen.joints:
            power += float(searcher.alone_by_joint[1][:, c.unseen.joints.index(j)].sum())
            rows += len(c.unseen.residual[j])
        size = c.new.size(j) / c.floor[j]
        least = rules.excess if c.change else (rules.size_structure * size) ** 2
        if j in c.noise:
            apart = rules.complete * searcher.power_beyond_noise((j,), rules.noise_part)
            least = least if apart < (rules.complete_size * size) ** 2 * rows else 0.0
        if power < least * rows:
            out.add(j)
    return out


def closes(
    sample: Sample, effect: Effect, residual: Mapping[int, Floats], floor: Mapping[int, float]
) -> tuple[float, int]:
    """Return how much of the squared residual, in units of the floor, a plain fit closes with how many coefficients."""
    columns, rows = sample.skimmed(effect)
    joints = [j for j in columns if j in residual]
    if not joints:
        return 0.0, 0
    C = np.concatenate([columns[j] / floor[j] for j in joints])
    r = np.concatenate([residual[j][rows[j]] for j in joints])
    if not np.isfinite(C).all():
        return 0.0, C.shape[1]
    g = C.T @ r
    N = C.T @ C
    scale = np.sqrt(np.maximum(np.diag(N), 1e-300))
    N = N / np.outer(scale, scale) + 1e-6 * np.eye(len(N))
    theta = np.linalg.solve(N, g / scale) / scale
    return (float(g @ theta) if effect.possible(theta) else 0.0), C.shape[1]
