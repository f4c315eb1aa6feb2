"""What the named causes close of the gap of every axis, on rows that they were not fitted to.

Each is measured beside those named before it, as a share of the whole residual of its axis: shares of causes add up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.episodes import Episodes
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.evidence.bootstrap import share_interval
from pinotwin.diagnosis.result import Found, Gap, Shrink, shrunk
from pinotwin.diagnosis.rules import Rules
from pinotwin.diagnosis.search.forward import Found as Search
from pinotwin.diagnosis.search.forward import Step
from pinotwin.diagnosis.search.scan import Scored, Searcher


@dataclass(frozen=True, eq=False)
class Closed:
    """What is closed of the squared residual of one axis, in units of its floor."""

    before: Floats  # the whole of it by block, shape (K,)
    gained: Floats  # what goes of that, shape (K,)
    promised: float  # share that goes of the blocks that were held out
    on: str  # which rows these are

    @property
    def share(self) -> float:
        """Share of the whole that goes; below zero where it grows."""
        return _share(self.before, self.gained)

    @property
    def bounded(self) -> float:
        """The share from 0 to 1: what makes a gap larger closes nothing."""
        return min(max(self.share, 0.0), 1.0)

    def shrink(self, level: float, axis: str) -> Shrink:
        """Return how far the gap of an axis shrinks, from its RMS [N or N·m]."""
        interval = share_interval(self.before, self.before - self.gained)
        return shrunk(level, self.share, interval, self.promised, self.on, axis)

    def beside(self, other: Closed) -> Closed:
        """Return what two causes close together."""
        both = self.promised + other.promised
        return Closed(self.before, self.gained + other.gained, both, self.on)


def _share(before: Floats, gained: Floats) -> float:
    return float(gained.sum() / max(float(before.sum()), 1e-300))


@dataclass(frozen=True, eq=False)
class Turn:
    """One cause beside those that were named before it."""

    step: Step  # of the search
    sure: float  # its confidence
    ground: Searcher  # with the causes before it
    worth: Scored  # what it is worth there


@dataclass(frozen=True, eq=False)
class Account:
    """The residual that every share is stated of, and the causes in the order in which they were named."""

    whole: Searcher  # the ground on all rows, without any cause
    found: Search  # the search beside the pushes
    sure: Sequence[float]  # confidence of each of its causes
    pushed: Sequence[tuple[Episodes, float]]  # pushes with theirs
    rules: Rules  # thresholds

    @property
    def comparison(self) -> Comparison:
        """What was searched for causes beside the pushes."""
        return self.found.first.comparison

    @property
    def named(self) -> Searcher:
        """The ground beside all causes that are named."""
        return self._beside([turn.step.chosen for turn in self.turns if turn.sure >= self.rules.named])

    def _beside(self, causes: Sequence[Scored]) -> Searcher:
        """Return the ground beside some causes, and beside what the machine lists already."""
        steps = {id(step.chosen) for step in self.found.steps}
        listed = [one for one in self.found.searcher.found if id(one) not in steps]
        if not causes and not listed:
            return self.found.first
        return Searcher(self.comparison, [*causes, *listed])

    @cached_property
    def turns(self) -> tuple[Turn, ...]:
        """Every cause of the search, patterns left out, those first that are named."""
        pairs = zip(self.found.steps, self.sure, strict=True)
        causes = [(step, x) for step, x in pairs if not isinstance(step.chosen.effect, Pattern)]
        before: list[Scored] = []
        out = []
        for step, sure in sorted(causes, key=lambda pair: pair[1] < self.rules.named):
            ground, one = self._beside(before), step.chosen
            if ground.found == step.searcher.found:
                out.append(Turn(step, sure, step.searcher, one))
            elif (again := ground.score(one.effect, one.table)) is not None:
                out.append(Turn(step, sure, ground, again))
            if sure >= self.rules.named:
                before.append(one)
        return tuple(out)

    def closed(self, searcher: Searcher, one: Scored, joint: int) -> Closed:
        """Return what a cause closes of the whole residual of an axis beside those on a ground."""
        c, at = self.whole.comparison, self.whole.comparison.new.joints.index(joint)
        fitted, beyond = self.whole.alone_by_joint
        gains, unseen = searcher.gains_at(one, joint)
        promised = _share(fitted[:, at], gains)
        pushed = any(p.joint == joint for p, _ in self.pushed)
        if c.unseen is None or joint not in c.unseen.joints or pushed:
            return Closed(fitted[:, at], gains, promised, "held-out blocks")
        return Closed(beyond[:, c.unseen.joints.index(joint)], unseen, promised, "validation")

    def all_of(self, turn: Turn) -> dict[int, Closed]:
        """Return joint -> what a cause closes of its gap: of the one it moves most, and where it is worth a word."""
        every = {j: self.closed(turn.ground, turn.worth, j) for j in turn.worth.table[0]}
        return {j: x for j, x in every.items() if j == turn.step.chosen.joint or x.share >= self.rules.share}

    def pushes(self, pushed: Episodes) -> Closed:
        """Return what pushes close of the whole residual of their axis, pushes included."""
        at = self.whole.comparison.new.joints.index(pushed.joint)
        before = self.whole.alone_by_joint[0][:, at]
        return Closed(before, pushed.gains, _share(before, pushed.gains), "held-out rows of the disturbances")

    @cached_property
    def together(self) -> dict[int, Closed]:
        """Return joint -> what all named causes close together."""
        out: dict[int, Closed] = {}
        parts = [self.all_of(turn) for turn in self.turns if turn.sure >= self.rules.named]
        parts += [{p.joint: self.pushes(p)} for p, sure in self.pushed if sure >= self.rules.named]
        for part in parts:
            for j, x in part.items():
                out[j] = out[j].beside(x) if j in out else x
        return out


def at_one_gap(effects: Sequence[Found], gaps: Mapping[str, Mapping[str, Gap]]) -> list[Found]:
    """Return effects with every share stated of the gap of its axis and signal; a vibration's is above its noise."""
    out = []
    for e in effects:
        row = gaps.get(str(e.axis), {})
        shrink = {s: stated_of(row[s].rms, x) if s in row else x for s, x in e.shrink.items()}
        out.append(replace(e, shrink=shrink))
    return out


def stated_of(level: float, x: Shrink) -> Shrink:
    """Return a shrink as one of the whole gap of a signal, from its RMS."""
    share = (x.before**2 - x.after**2) / max(level**2, 1e-300)
    part = share / x.share if x.share > 0.0 else 0.0
    interval = (part * x.interval[0], part * x.interval[1])
    return shrunk(level, share, interval, part * x.promised, x.on, x.axis)
