"""The confusion matrix: what was put in against what was said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pinotwin.bench.answers import Answer

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
