"""Are the least changes that a diagnosis says it would have seen found, if they are put into the healthy logs?

Each limit is stated for nine of ten logs. A change of that size is added to what the equations leave of a healthy day,
and the question is asked again.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinotwin as pt
from benchmarks.train.rows import stretches_of
from pinotwin.diagnosis.days.causes import Place, effect_of, unit_of
from pinotwin.diagnosis.days.decision import known, trained
from pinotwin.diagnosis.days.detectable import PLAIN, detectable
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.judge import evidence
from pinotwin.diagnosis.days.mechanisms import Acts
from pinotwin.diagnosis.days.reference import reference
from pinotwin.diagnosis.days.row import Question

RATE, EACH = 0.02, 4
"""False-alarm rate at which is asked, and limits of each machine that are tried."""


def _with(
    left: Sequence[Left], columns: Sequence[dict[str, Acts]], cause: str, axis: str, size: float
) -> list[Left]:
    """Return what equations leave of some stretches, (n,) each, with a cause of one number in an axis."""
    more = [{(axis, e): size * column.ravel() for e, column in acts[cause].items()} for acts in columns]
    return [{**x, **{key: x[key] + y for key, y in add.items()}} for x, add in zip(left, more, strict=True)]


def asked(base: Path, rng: np.random.Generator) -> list[tuple[str, bool, bool]]:
    """Return cause, whether something is said, and whether it is that cause, of some limits of a machine."""
    twin, decision, out = pt.Twin.load(base / "twin"), trained(), []
    r = reference(twin, list(twin.machine.names))
    logs = [pt.read(base / "none" / f"{k}.csv") for k in ("train", "repeat", "valid")]
    if r is None:
        return []
    q = Question.of(r, stretches_of(r, logs[:2]), stretches_of(r, logs[2:]))
    _, _, first = evidence(q)
    causes = {effect_of(x): x for x in reversed(PLAIN)}
    every = [x for x in detectable(first, decision.bars[known(r.days)]) if _possible(x)]
    for limit in (every[k] for k in rng.permutation(len(every))[:EACH]):
        cause, axis = causes[limit["effect"]], limit["axis"]
        size = limit["size"] / abs(unit_of(cause, Place(r, axis, q.logs))[2])
        left = _with(q.left, first.tried.columns[axis], cause, axis, size)
        seen = _with(q.valid_left, first.tried.unseen[axis], cause, axis, size)
        case, _, _ = evidence(Question(r, q.logs, left, q.valid, seen))
        P = decision.probabilities(case)
        said, best = bool(P[0] < decision.limit(RATE, r.days)), int(np.argmax(P[1:])) - 1
        row = case.causes[best] if said and best >= 0 else None
        named = row is not None and (effect_of(row.name), row.axis) == (limit["effect"], axis)
        out.append((cause, said, named))
    return out


def _possible(x: Mapping[str, Any]) -> bool:
    """Whether a change is put in: of a factor less than itself, and none that acts on several axes."""
    factors = ("friction_scale", "position_gain", "velocity_feedforward")
    return x["effect"] != "zero" and (x["effect"] not in factors or x["size"] < 1.0)


def main(words: Sequence[str]) -> None:
    """Ask some limits of every machine folder of CASES."""
    rng, every = np.random.default_rng(0), list[tuple[str, bool, bool]]()
    for base in sorted(p for p in Path(words[0]).iterdir() if (p / "none").exists()):
        every += asked(base, rng)
        print(base.name, file=sys.stderr, flush=True)
    for cause in [*sorted({c for c, _, _ in every}), ""]:
        rows = [x for x in every if cause in ("", x[0])]
        said, named = (sum(x[k] for x in rows) for k in (1, 2))
        print(f"{cause or 'all':26} asked {len(rows):3}  said {said:3}  named {named:3}")
