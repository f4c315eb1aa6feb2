"""The floors at our own false-alarm rate, on the same cases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.bench.answers import Answer
from pinotwin.bench.scoring import FAINT, VISIBLE
from pinotwin.bench.statistics import Share

WORDS = {"stepwise_bic": "stepwise BIC", "pursuit": "orthogonal matching pursuit"}


@dataclass(frozen=True)
class FloorScore:
    """One method on all cases.

    Attributes:
        name: method.
        threshold: of its own score; None for ours.
        alarms: healthy machines of which it names an effect.
        visible: first answer right, rho at least 0.1, classes merged.
        faint: the same for 0.02 to 0.1.
    """

    name: str
    threshold: float | None
    alarms: Share
    visible: Share
    faint: Share


def floor_scores(answers: Sequence[Answer]) -> list[FloorScore]:
    """Return our line and that of every floor, its threshold set to our rate of named healthy machines.

    The threshold is the lowest that accuses no more healthy cases than we do, read off these very cases:
    kinder to the floors than to us, whose thresholds never saw them.
    """
    healthy = [a for a in answers if a.kind == "healthy"]
    single = [a for a in answers if a.kind == "single"]
    ours = Share.over([bool(a.named) for a in healthy])
    out = [FloorScore("pinotwin", None, ours, *_shares(single, lambda a: a.right()))]
    for name in sorted({k for a in answers for k in a.floors}):
        known = sorted((a.floors[name][2] for a in healthy if name in a.floors), reverse=True)
        level = known[min(ours.hits, len(known) - 1)] if known else 0.0

        def right(a: Answer, name: str = name, level: float = level) -> bool:
            pick = a.floors.get(name)
            return pick is not None and pick[2] > level and a.agrees(pick[:2], a.truth[0])

        alarms = Share.over([name in a.floors and a.floors[name][2] > level for a in healthy])
        words = WORDS.get(name, name)
        out.append(FloorScore(words, float(level), alarms, *_shares(single, right)))
    return out


def _shares(single, right) -> tuple[Share, Share]:  # type: ignore[no-untyped-def]
    visible = [a for a in single if a.size >= VISIBLE]
    faint = [a for a in single if FAINT <= a.size < VISIBLE]
    return Share.over([right(a) for a in visible]), Share.over([right(a) for a in faint])


def beaten(scores: Sequence[FloorScore]) -> bool | None:
    """Whether our line is above every floor; None where there is nothing to compare."""
    values = [s.visible.value for s in scores]
    if len(values) < 2 or any(v is None for v in values):
        return None
    return bool(values[0] > np.max(np.array(values[1:], dtype=float)))  # type: ignore[operator]
