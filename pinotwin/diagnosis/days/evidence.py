"""From columns to cells: what was recorded of one axis, whitened, weighed and summed up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
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
    spoilt: Sequence[Mask] | None = None,
) -> dict[str, Cells]:
    """Return equation -> cells of one axis, from what the equations leave of stretches in question.

    ``acting``: of every stretch cause -> equation -> columns. ``found``: axis and equation -> size of causes found.
    ``spoilt``: of every stretch the rows without an effort; only plant and law are asked then.
    """
    days = [healthy_day(r, s, name, found or {}) for s in logs]
    asked = [e for e in EQUATIONS if (name, e) in left[0] and (spoilt is None or e != "encoders")]
    out = {}
    for equation in asked:
        columns, at = _beside(logs, days, acting or [{} for _ in logs], equation)
        counts = "moving" if equation == "plant" else "one"
        got = _Cellar(r.whitenings[name, equation], [settled(s.axes[name][counts]) for s in logs])
        for k, s in enumerate(logs):
            x = np.column_stack([columns[k], left[k][name, equation]])
            gone = None
            if spoilt is not None:
                gone = _without_effort(r, name, equation, days[k], left[k], x.shape)
            got.add(s, k, x, None if spoilt is None else spoilt[k], gone, name)
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


def _without_effort(
    r: Reference, name: str, equation: str, day: Mapping[str, Floats], left: Left, shape: tuple[int, ...]
) -> Floats:
    """Return what stands on rows without an effort: in the plant law less twin, in the law nothing."""
    out = np.zeros(shape)
    if equation == "plant":
        plant, law = r.whitenings[name, "plant"], r.whitenings[name, "law"]
        y = np.zeros(shape)
        y[:, 1 : 1 + day["plant"].shape[1]] = day["plant"]
        y[:, -1] = left[name, "plant"] - left[name, "law"]
        out = plant(y) / np.hypot(plant.sigma, law.sigma)
    return out


class _Cellar:
    """Collects the cells of one equation."""

    def __init__(self, whitening: Whitening, masks: Sequence[Floats]) -> None:
        self.whitening, self.masks = whitening, masks
        self.grams: list[Floats] = []
        self.rows: list[float] = []
        self.log: list[int] = []
        self.fold: list[int] = []
        self.constant: list[float] = []

    def add(self, s: Stretch, k: int, x: Floats, bad: Mask | None, gone: Floats | None, name: str) -> None:
        """Add the cells of a stretch from its columns, residual last."""
        w, mask = self.whitening, self.masks[k]
        x = w(x) / w.sigma
        silent = np.zeros(len(x), dtype=bool)
        if bad is not None and gone is not None and bad.any():
            x[bad] = gone[bad]
            silent = bad if not gone.any() else silent
        x = x * mask[:, None] / np.sqrt(w.spread)
        wide = float(np.std(s.axes[name]["u"]))
        edges = np.flatnonzero(np.r_[True, np.diff(s.cell) != 0, True])
        for a, b in pairwise(edges):
            count, lost = float(mask[a:b].sum()) / w.spread, float(silent[a:b].sum()) / w.spread
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
