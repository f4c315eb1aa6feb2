"""Patterns without a cause: what the named effects leave over, asked of curves that stand for no effect.

A gap can be nearly closed by a cousin of its cause (a ripple that grows with speed by a plain one), and a
small gap can go with the motion without any effect of the catalogue doing so. Neither leaves much power,
but what it leaves follows something. Three kinds are asked, each on blocks that were not fitted:

- another *form* of a named effect: its own course, louder with speed, acceleration, position or time;
- a *curve* of one axis: over speed, position, position and direction, acceleration, load, time, other axes;
- a *hum*: one frequency, with the phase of each run.

They name nothing; they say that something is left and what it goes with (METHODS A2: flexible probe).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.admission import Judged, admit, measured
from pinotwin.diagnosis.bank import stacked
from pinotwin.diagnosis.context import Context
from pinotwin.diagnosis.curves import Curve, Span, curves, factors
from pinotwin.diagnosis.decide import Decision
from pinotwin.diagnosis.ledger import Ledger, build_ledger, residual_of, sums
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.search import POSITION
from pinotwin.diagnosis.stage import Blocks
from pinotwin.diagnosis.trivial import MATTERS
from pinotwin.diagnosis.worth import worth

LEAST = {"form": 20.0, "curve": 45.0, "hum": 80.0}
"""Deviance that a pattern must bring: a base leaves some of each in health (virtual machines of development
seeds 11 and 12: at most 34 of a curve, 39 of a hum; beside a right name mostly below 20, 47 and 70)."""
LEAST_OF_NAMED = {"form": 0.01, "curve": 0.01, "hum": 0.02}
"""The same over what was named on the axis: a first-order column leaves some of itself."""
LEAST_OF_PUSH = 0.1  # the same of a push, whose course is known by its start and length alone
SLOWEST_HUM = 4.0  # [Hz] below it a hum is not told from slow motion
FORMLESS = ("backlash",)  # play that rattles: any factor makes some impacts fit better
RIDGE = 1e-3  # knots that other blocks hardly visit are not foretold by these


@dataclass(frozen=True)
class Pattern:
    """What the rest of a joint's gap follows.

    Attributes:
        words: what it is.
        share: its deviance over that of all that was found on the joint.
    """

    words: str
    share: float


class Seen(NamedTuple):
    """A pattern that was asked for: what it brings, in words, and its kind."""

    deviance: float
    words: str
    kind: str


def patterns(moving: Ready, decision: Decision) -> dict[int, Pattern]:
    """Return what the rest follows, per joint where it follows anything.

    Args:
        moving: rows in motion.
        decision: what was found, by name or without.
    """
    stage = moving.search_stage
    found = [*decision.quiet, *decision.leavings, *(n.judged for n in decision.named)]
    ledger = measured(build_ledger(admit(stage, found), moving.theta))
    named = [n.judged for n in decision.named if n.calibration is None]
    out = {}
    for joint in stage.rows.joints:
        mine = [j for j in named if joint in j.joints]
        rows = sum(len(p.y) for p in ledger.stage.pieces if p.channel.joint == joint)
        every = asked(moving.context, ledger, joint, mine)
        seen = [x for x in every if x.deviance > max(least(x.kind, mine), MATTERS * rows)]
        if seen:
            best, explained = max(seen), sum(max(j.G, 0.0) for j in mine)
            out[joint] = Pattern(best.words, best.deviance / (best.deviance + explained))
    return out


def least(kind: str, named: Sequence[Judged]) -> float:
    """Return the deviance that a kind of pattern must bring beside what was named on its joint."""
    pushed = any(j.family.local for j in named)
    share = LEAST_OF_PUSH if pushed else LEAST_OF_NAMED[kind]
    return max(LEAST[kind], share * sum(max(j.G, 0.0) for j in named))


def asked(context: Context, ledger: Ledger, joint: int, named: Sequence[Judged]) -> Iterator[Seen]:
    """Yield every pattern of a joint."""
    axis = Span.of(context, joint)
    placed = any(j.key[0] in POSITION for j in named)
    for words, curve in curves(axis):
        if words != "position" or not placed:
            columns: list[Blocks] = [[(joint, curve(s))] for s in context.scenes]
            yield Seen(_deviance(ledger, columns), f"a function of {words}", "curve")
    for judged in named:
        yield from _forms(context, ledger, axis, judged)
    deviance, frequency = hum(ledger, joint)
    yield Seen(deviance, f"time-periodic at {frequency:.3g} Hz", "hum")


def _forms(context: Context, ledger: Ledger, axis: Span, judged: Judged) -> Iterator[Seen]:
    """Yield the other forms of a named effect."""
    effect = judged.key[0]
    if effect in FORMLESS or judged.family.local:
        return
    for words, factor in factors(axis):
        if words != "position" or effect not in POSITION:
            deviance = _deviance(ledger, _times(context, judged, factor))
            yield Seen(deviance, f"{effect} of another form: it varies with {words}", "form")


def _deviance(ledger: Ledger, columns: list[Blocks]) -> float:
    batch = stacked(ledger.stage, [columns])
    return float(worth(ledger, sums(ledger, batch), RIDGE).G[0, 0])


def _times(context: Context, judged: Judged, factor: Curve) -> list[Blocks]:
    """Return the course of a named effect (a ripple's two waves) times a factor."""
    out: list[Blocks] = []
    for scene, blocks in zip(context.scenes, judged.candidate.columns, strict=True):
        by = factor(scene)[:, None]
        out.append([(k, _course(x, judged.theta) * by) for k, x in blocks])
    return out


def _course(x: Floats, theta: Floats) -> Floats:
    return x if x.shape[1] <= 2 else np.asarray(x @ theta)[:, None]


def hum(ledger: Ledger, joint: int) -> tuple[float, float]:
    """Return the deviance of the strongest line in what is left of a joint, and its frequency [Hz].

    Every run has its own phase. What chance reaches among all frequencies is taken off.
    """
    rows = ledger.stage.rows
    step = rows.motions[0].step
    pieces = [p for p in ledger.stage.pieces if p.channel.joint == joint]
    count = 2 * max(len(m) for m in rows.motions)
    frequency = np.fft.rfftfreq(count, step)
    seen = (frequency > SLOWEST_HUM) & (frequency < 0.48 / rows.row_step)
    if not seen.any():
        return 0.0, 0.0
    power = np.zeros(len(frequency))
    for p in pieces:
        left = residual_of(p, ledger.theta)
        course = np.zeros(count)
        course[p.channel.centres[p.kept]] = left
        power += 2.0 * np.abs(np.fft.rfft(course)) ** 2 / len(left)
    top = int(np.argmax(np.where(seen, power, 0.0)))
    return float(power[top]) - 2.0 * len(pieces), float(frequency[top])
