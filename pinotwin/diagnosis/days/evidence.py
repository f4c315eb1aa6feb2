"""From columns to cells: what was recorded of one axis, whitened, weighed and summed up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.days.healthy import Shapes, healthy_day
from pinotwin.diagnosis.days.reference import EQUATIONS, Reference
from pinotwin.diagnosis.days.score import Cells
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.days.whitening import Whitening, settled
from pinotwin.diagnosis.settings import SETTINGS

Left = dict[tuple[str, str], Floats]
Acting = Mapping[str, Mapping[str, Floats]]


def cells(
    r: Reference,
    logs: Sequence[Stretch],
    left: Sequence[Left],
    name: str,
    acting: Sequence[Acting] | None = None,
    *,
    found: Shapes | None = None,
    read: bool = True,
) -> dict[str, Cells]:
    """Return equation -> cells of one axis, from what the equations leave of stretches in question.

    ``acting``: of every stretch cause -> equation -> columns. ``found``: axis and equation -> size of causes found.
    ``read``: whether the effort is of this run; only plant and law are asked otherwise.
    """
    days = [healthy_day(r, s, name, found or {}) for s in logs]
    asked = [e for e in EQUATIONS if (name, e) in left[0] and (read or e != "encoders")]
    out = {}
    for equation in asked:
        columns, at = _beside(logs, days, acting or [{} for _ in logs], equation)
        counts = "moving" if equation == "plant" else "one"
        got = _Cellar(r.whitenings[name, equation], [settled(s.axes[name][counts]) for s in logs])
        for k, s in enumerate(logs):
            w, x = got.whitening, np.column_stack([columns[k], left[k][name, equation]])
            sigma, silent = w.sigma, not read and equation == "law"
            if not read:  # without its effort the law tells nothing, and the plant what is between both
                x[:, -1] -= left[k][name, "law"]
                x *= not silent
                sigma = float(np.hypot(sigma, r.whitenings[name, "law"].sigma))
            got.add(s, k, w(x) / sigma, name, silent=silent)
        if got.rows:
            out[equation] = got.cells(days[0][equation].shape[1], at)
    return out


def _beside(
    logs: Sequence[Stretch], days: Sequence[Mapping[str, Floats]], acting: Sequence[Acting], equation: str
) -> tuple[list[Floats], dict[str, Ints]]:
    """Return a zero, the columns of the day and those of every cause side by side, and where each cause is."""
    parts = [[np.zeros((len(s.t), 1)), d[equation]] for s, d in zip(logs, days, strict=True)]
    at, where = 1 + days[0][equation].shape[1], {}
    for name in acting[0]:
        if equation in acting[0][name]:
            for k, x in enumerate(acting):
                parts[k].append(np.asarray(x[name][equation]).reshape(len(logs[k].t), -1))
            where[name] = np.arange(at, at + parts[0][-1].shape[1])
            at += parts[0][-1].shape[1]
    return [np.column_stack(p) for p in parts], where


class _Cellar:
    """Collects the cells of one equation."""

    def __init__(self, whitening: Whitening, masks: Sequence[Floats]) -> None:
        self.whitening, self.masks = whitening, masks
        self.grams: list[Floats] = []
        self.rows: list[float] = []
        self.log: list[int] = []
        self.fold: list[int] = []
        self.constant: list[float] = []

    def add(self, s: Stretch, k: int, white: Floats, name: str, *, silent: bool) -> None:
        """Add the cells of a stretch from its whitened columns, residual last; ``silent``: its rows tell nothing."""
        w, mask = self.whitening, self.masks[k]
        x = white * mask[:, None] / np.sqrt(w.spread)
        wide = float(np.std(s.axes[name]["u"]))
        edges = np.flatnonzero(np.r_[True, np.diff(s.cell) != 0, True])
        for a, b in pairwise(edges):
            count, lost = float(mask[a:b].sum()) / w.spread, silent * (b - a) / w.spread
            if count < 0.5:
                continue
            self.grams.append(x[a:b].T @ x[a:b])
            self.rows.append(max(count - lost, 0.0))
            self.log.append(k)
            self.fold.append((int(s.cell[a]) + k) % SETTINGS.folds)
            self.constant.append(-lost * (np.log(max(wide / w.sigma, 1.0)) + 0.5))

    def cells(self, day: int, at: dict[str, Ints]) -> Cells:
        """Return what was collected."""
        return Cells(
            np.array(self.grams),
            np.array(self.rows),
            np.array(self.log),
            np.array(self.fold),
            np.array(self.constant),
            day,
            at,
        )
