"""From columns to cells: what was recorded of one axis, whitened, weighed and summed up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.diagnosis.days.healthy import Shapes, healthy_day
from pinotwin.diagnosis.days.reference import EQUATIONS, Reference
from pinotwin.diagnosis.days.score import Cells, padded
from pinotwin.diagnosis.days.stretch import Stretch
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
    days, wide = [healthy_day(r, s, name, found or {}) for s in logs], r.beyond(name, logs)
    asked = [e for e in EQUATIONS if (name, e) in left[0] and (read or e != "encoders")]
    out = {}
    for equation in asked:
        columns, at = _beside(logs, days, acting or [{} for _ in logs], equation)
        w, parts, silent = r.whitenings[name, equation], list[_Cell](), not read and equation == "law"
        sigma = wide * (w.sigma if read else float(np.hypot(w.sigma, r.whitenings[name, "law"].sigma)))
        for k, s in enumerate(logs):
            x = np.column_stack([columns[k], left[k][name, equation]])
            if not read:  # without its effort the law tells nothing, and the plant what is between both
                x[:, -1] = (x[:, -1] - left[k][name, "law"]) * (not silent)
            counts = w.counts(s.axes[name], equation)
            x = w(x) / sigma * counts[:, None] / np.sqrt(w.spread)
            loud = float(np.std(s.axes[name]["u"])) / (wide * w.sigma)
            lost = np.log(max(loud, 1.0)) + 0.5 if silent else None
            for on in (counts == 1.0, (counts > 0.0) & (counts < 1.0)):
                parts += _summed(x, on, s.cell, k, w.spread, lost)
        if parts:
            each, *rest = zip(*parts, strict=True)
            rows, log, fold, constant = map(np.array, rest)
            out[equation] = Cells(padded(each), rows, log, fold, constant, days[0][equation].shape[1], at)
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


_Cell = tuple[Floats, float, int, int, float]
"""Rows, how many of them are independent, log, fold, and what is added to the log density [nats]."""


def _summed(x: Floats, on: Mask, cell: Ints, log: int, spread: float, lost: float | None) -> Iterator[_Cell]:
    """Yield the cells of one kind of rows of a stretch from its whitened columns, residual last.

    ``cell``: of every row; ``lost``: what a row costs that tells nothing [nats].
    """
    for a, b in pairwise(np.flatnonzero(np.r_[True, np.diff(cell) != 0, True])):
        rows, count = on[a:b], float(on[a:b].sum()) / spread
        if count >= 0.5:
            silent, own = 0.0 if lost is None else (b - a) / spread, x[a:b][rows]
            fold = (int(cell[a]) + log) % SETTINGS.folds
            yield own, max(count - silent, 0.0), log, fold, -silent * (lost or 0.0)
