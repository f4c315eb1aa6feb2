"""What was said about a case, and when that is right."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pinotwin.bench.cases import Case, truth_of
from pinotwin.bench.catalogue import EXACT
from pinotwin.bench.produce import Produced
from pinotwin.diagnosis import Diagnosis

Key = tuple[str, str | None]  # effect and axis
FLAGS = ("unexplained", "partly_explained")
"""Verdicts that say: there is something that the catalogue does not know."""


@dataclass(frozen=True)
class Answer:
    """What was said about one case; plain types, so that it can be written as a line of JSON."""

    number: int  # of the case
    machine: str  # machine
    situation: str  # structure or change
    kind: str  # see :class:`Case`
    truth: tuple[Key, ...]  # right answers (effect, axis)
    sizes: tuple[float, ...]  # rho of each of them
    verdict: str  # verdict, or error
    named: tuple[tuple[str, str | None, float], ...] = ()  # (effect, axis, confidence), best first
    stated: tuple[Key, ...] = ()  # (effect, axis) of the stated 90 % set of the first one
    confusable: tuple[tuple[str, ...], ...] = ()  # groups called inseparable, as axis.effect
    # of the first one, or None: delivered share, its 90 % interval, promised share
    shrink: Mapping[str, Any] | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)  # stage -> time it took [s]
    oracle: float | None = None  # of the weakest effect, over the least asked for; see bench.oracle
    error: str = ""  # what went wrong, if anything did

    @property
    def size(self) -> float:
        """Power over the noise of the largest effect; that of the weaker of two is ``weaker``."""
        return max(self.sizes, default=0.0)

    @property
    def weaker(self) -> float:
        """Power over the noise of the weakest effect."""
        return min(self.sizes, default=0.0)

    @property
    def accused(self) -> bool:
        """Whether anything is said to be wrong at all."""
        return self.verdict != "none" or bool(self.named)

    @property
    def flagged(self) -> bool:
        """Whether something outside the catalogue is said to be there."""
        return self.verdict in FLAGS

    def right(self, k: int = 0, *, strict: bool = False) -> bool:
        """Whether the k-th named effect is the (first) true one; strictly, or with its classes merged."""
        if k >= len(self.named) or not self.truth:
            return False
        said, true = self.named[k][:2], self.truth[0]
        return said == true if strict else self.agrees(said, true)

    def agrees(self, said: Key, true: Key) -> bool:
        """Whether an answer is the truth, or in one class with it by physics or as the diagnosis says."""
        if same_class(said, true):
            return True
        pair = {label(said), label(true)}
        return said[1] == true[1] and any(pair <= set(group) for group in self.confusable)


def same_class(said: Key, true: Key) -> bool:
    """Whether two answers can never be told apart; a load may be named on any axis."""
    group = next((g for g in EXACT if true[0] in g), frozenset({true[0]}))
    return said[0] in group and (said[1] == true[1] or "payload" in group)


def label(key: Key) -> str:
    """Return an answer as one word, as ``confusable`` writes it."""
    return key[0] if key[1] is None else f"{key[1]}.{key[0]}"


def noted(
    case: Case, found: Diagnosis, made: Produced, seconds: Mapping[str, float], oracle: float | None = None
) -> Answer:
    """Return what a diagnosis said about a case."""
    return dataclasses.replace(
        failed(case, None),
        sizes=made.sizes,
        verdict=found.verdict,
        named=tuple((e.effect, e.axis, float(e.confidence)) for e in found.effects),
        stated=_stated(found),
        confusable=tuple(tuple(g) for g in found.confusable),
        shrink=_shrink(found),
        seconds=seconds,
        oracle=oracle,
    )


def failed(case: Case, error: BaseException | None) -> Answer:
    """Return the answer of a case whose diagnosis did not come to an end."""
    asked = case.number, case.machine, case.situation, case.kind, truth_of(case)
    text = "" if error is None else f"{type(error).__name__}: {error}"
    return Answer(*asked, sizes=(), verdict="error", error=text)


def _stated(found: Diagnosis, level: float = 0.9) -> tuple[Key, ...]:
    """Return the fewest answers whose stated probabilities reach a level."""
    if not found.effects:
        return ()
    first = found.effects[0]
    options = [(float(first.confidence), (first.effect, first.axis))]
    options += [
        (float(a.get("probability", 0.0)), (str(a["effect"]), a.get("axis"))) for a in first.alternatives
    ]
    out: list[Key] = []
    total = 0.0
    for p, key in sorted(options, key=lambda x: -x[0]):
        if p <= 0.0 or total >= level:
            break
        out.append(key)
        total += p
    return tuple(out)


def _shrink(found: Diagnosis) -> dict[str, Any] | None:
    """Return the shrink of the first effect in the signal that it shrinks most."""
    if not found.effects or not found.effects[0].shrink:
        return None
    of = found.effects[0].shrink
    signal = "u" if "u" in of else next(iter(of))
    x = of[signal]
    return {
        "signal": signal,
        "delivered": float(x.share),
        "interval": [float(v) for v in x.interval],
        "promised": float(x.promised),
        "on": x.on,
    }
