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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.admission import Judged, admit, measured
from pinotwin.diagnosis.bank import stacked
from pinotwin.diagnosis.context import Context, Scene
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

Curve = Callable[[Scene], Floats]


@dataclass(frozen=True)
class Pattern:
    """What the rest of a joint's gap follows.

    Attributes:
        words: what it is.
        share: its deviance over that of all that was found on the joint.
    """

    words: str
    share: float


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
        explained = sum(max(j.G, 0.0) for j in mine)
        seen = [x for x in _every(moving.context, ledger, joint, mine) if x[0] > _least(x[2], mine)]
        seen = [x for x in seen if x[0] > MATTERS * _rows(ledger, joint)]
        if seen:
            deviance, words, _ = max(seen)
            out[joint] = Pattern(words, deviance / (deviance + explained))
    return out


def _least(kind: str, named: Sequence[Judged]) -> float:
    """Return the deviance that a kind of pattern must bring beside what was named."""
    pushed = any(j.family.local for j in named)
    share = LEAST_OF_PUSH if pushed else LEAST_OF_NAMED[kind]
    return max(LEAST[kind], share * sum(max(j.G, 0.0) for j in named))


def _rows(ledger: Ledger, joint: int) -> int:
    return sum(len(p.y) for p in ledger.stage.pieces if p.channel.joint == joint)


def _every(
    context: Context, ledger: Ledger, joint: int, named: Sequence[Judged]
) -> Iterator[tuple[float, str, str]]:
    """Yield (deviance, words, kind) of every pattern of a joint."""
    placed = any(j.key[0] in POSITION for j in named)
    for words, curve in _curves(context, joint):
        if words == "position" and placed:
            continue
        columns: list[Blocks] = [[(joint, curve(s))] for s in context.scenes]
        yield _deviance(ledger, columns), f"a function of {words}", "curve"
    for judged in named:
        if judged.key[0] in FORMLESS or judged.family.local:
            continue
        for words, louder in _loudness(context, joint):
            if words != "position" or judged.key[0] not in POSITION:
                columns = _modulated(context, judged, louder)
                yield (
                    _deviance(ledger, columns),
                    f"{judged.key[0]} of another form: it varies with {words}",
                    "form",
                )
    deviance, frequency = hum(ledger, joint)
    yield deviance, f"time-periodic at {frequency:.3g} Hz", "hum"


def _deviance(ledger: Ledger, columns: list[Blocks]) -> float:
    batch = stacked(ledger.stage, [columns])
    return float(worth(ledger, sums(ledger, batch), RIDGE).G[0, 0])


def _curves(context: Context, joint: int) -> Iterator[tuple[str, Curve]]:
    """Yield the curves of one axis, in words and as columns of a scene."""
    low, high = context.travel(joint)
    top, hard = context.speed(joint), _hardest(context, joint)
    others = [k for k in range(context.machine.nv) if k != joint]

    def place(s: Scene) -> Floats:
        return np.asarray(2.0 * (s.motion.q[:, joint] - low) / max(high - low, 1e-12) - 1.0)

    yield "speed", lambda s: _hats(s.motion.v[:, joint] / top, 9)
    yield "position", lambda s: _hats(place(s), 12)
    yield "position and direction", lambda s: _hats(place(s), 5) * s.direction[:, [joint]]
    yield "acceleration", lambda s: _hats(s.motion.a[:, joint] / hard, 7)
    yield "load and direction", lambda s: _load(s, joint)
    yield "time", lambda s: _drift(s, joint, top)
    if others:
        yield "other axes' motion", lambda s: _elsewhere(s, others)


def _load(s: Scene, joint: int) -> Floats:
    effort, rigid = np.abs(s.effort[:, joint]), np.abs(s.rigid[:, joint])
    turns = s.direction[:, joint]
    return np.column_stack([effort * turns, rigid * turns, rigid * s.motion.v[:, joint]])


def _drift(s: Scene, joint: int, top: float) -> Floats:
    t = np.linspace(-1.0, 1.0, len(s.motion))
    return np.column_stack([t * s.motion.v[:, joint] / top, t * s.direction[:, joint], t])


def _elsewhere(s: Scene, others: list[int]) -> Floats:
    v, a = s.motion.v[:, others], s.motion.a[:, others]
    sizes = [np.maximum(np.abs(x).max(axis=0), 1e-12) for x in (v, a)]
    return np.column_stack([v / sizes[0], a / sizes[1], s.direction[:, others]])


def _hats(x: Floats, count: int) -> Floats:
    """Return hat functions on evenly spaced knots over [-1, 1], shape (n, count)."""
    knots = np.linspace(-1.0, 1.0, count)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(x[:, None] - knots) * (count - 1) / 2.0))


def _hardest(context: Context, joint: int) -> float:
    return max(float(np.abs(s.motion.a[:, joint]).max()) for s in context.scenes)


def _loudness(context: Context, joint: int) -> Iterator[tuple[str, Curve]]:
    """Yield by what an effect may be louder, in words and as a factor (n,) of a scene."""
    low, high = context.travel(joint)
    top, hard = context.speed(joint), _hardest(context, joint)

    def place(s: Scene) -> Floats:
        return np.asarray(2.0 * (s.motion.q[:, joint] - low) / max(high - low, 1e-12) - 1.0)

    yield "speed", lambda s: np.abs(s.motion.v[:, joint]) / top
    yield "speed", lambda s: (s.motion.v[:, joint] / top) ** 2
    yield "speed", lambda s: 1.0 / (np.abs(s.motion.v[:, joint]) / top + 0.1)
    yield "acceleration", lambda s: np.abs(s.motion.a[:, joint]) / hard
    yield "position", place
    yield "position", lambda s: place(s) ** 2
    yield "time", lambda s: np.linspace(-1.0, 1.0, len(s.motion))


def _modulated(context: Context, judged: Judged, louder: Curve) -> list[Blocks]:
    """Return the course of a named effect (a ripple's two waves) times a factor."""
    out: list[Blocks] = []
    for scene, blocks in zip(context.scenes, judged.candidate.columns, strict=True):
        factor = louder(scene)[:, None]
        out.append([(k, _course(x, judged.theta) * factor) for k, x in blocks])
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
