"""Confusion matrices: what was put in against what was said, measured and as isolability predicts it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from pinotwin.bench.answers import Answer
from pinotwin.bench.statistics import rank_correlation

Matrix = dict[str, dict[str, float]]
"""True effect -> answer -> count, or share."""
OTHER_AXIS = " (other axis)"


def measured(singles: Sequence[Answer]) -> Matrix:
    """Return true effect -> answer -> count; an answer that names none is its verdict."""
    out: dict[str, Counter[str]] = {}
    for a in singles:
        out.setdefault(a.truth[0][0], Counter())[said(a)] += 1
    return {true: dict(row) for true, row in sorted(out.items())}


def said(a: Answer) -> str:
    """Return the first answer as the matrix names it."""
    if not a.named:
        return a.verdict
    effect, axis, _ = a.named[0]
    true = a.truth[0]
    return effect + OTHER_AXIS if effect == true[0] and axis != true[1] and not a.right() else effect


def predicted(singles: Sequence[Answer]) -> Matrix | None:
    """Return true effect -> answer -> mean probability; None where no diagnosis predicted any."""
    sums: Matrix = {}
    counts: Counter[str] = Counter()
    for a in singles:
        if not a.predicted:
            continue
        true = a.truth[0][0]
        counts[true] += 1
        row = sums.setdefault(true, {})
        for name, p in a.predicted.items():
            effect = name.rpartition(".")[2]
            row[effect] = row.get(effect, 0.0) + p
    if not sums:
        return None
    return {t: {k: v / counts[t] for k, v in row.items()} for t, row in sorted(sums.items())}


def agreement(
    left: Mapping[str, Mapping[str, float]], right: Mapping[str, Mapping[str, float]]
) -> float | None:
    """Return the rank correlation of two matrices over the cells of the rows that both have."""
    names = sorted({k for m in (left, right) for row in m.values() for k in row})
    rows = sorted(set(left) & set(right))
    if not rows:
        return None
    a, b = (np.array([[m[r].get(k, 0.0) for k in names] for r in rows], dtype=float) for m in (left, right))
    a = a / np.maximum(a.sum(axis=1, keepdims=True), 1e-12)
    return rank_correlation(a.ravel(), b.ravel())
