"""The verdict: is there a gap, is it explained, what stays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pinotwin.diagnosis.admission import admit
from pinotwin.diagnosis.calibration import STAYS
from pinotwin.diagnosis.decide import Decision
from pinotwin.diagnosis.gaps import Gaps
from pinotwin.diagnosis.ledger import build_ledger, residual_of
from pinotwin.diagnosis.patterns import Pattern
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.remainder import describe
from pinotwin.diagnosis.result import Found, Verdict
from pinotwin.diagnosis.shrinking import foretold
from pinotwin.diagnosis.stage import Stage, scatter_precision, steady

SIGNIFICANT = {"repeats": 0.35, "assumed": 0.45}
"""Whitened power above the noise that counts as a gap, by how the noise is known."""
STAYS_PUSHED = 0.5  # the same where a push was found, whose course is not known
FORETOLD = 0.88  # share of a gap that goes on a validation log: the rest is no matter then
STAYS_UNSEEN = 0.5  # the same as STAYS on a log that was not fitted, where travel and speed differ
FORETOLD_LEAST = 0.5  # of what effects foretell of such a log that must be there


BEYOND = (
    "{}: on data that were not fitted the effects hold what they promise, but {:.0%} of the gap there is "
    "the model's own: it foretells that motion badly; identify it on a richer one"
)


NEVER = (
    "{}: these logs show {}, of which the twin's own logs told nothing: not a change, but identify it again "
    "with these"
)


@dataclass(frozen=True)
class Judgement:
    """The verdict and what it rests on.

    Attributes:
        verdict: of the contract.
        sentence: in words.
        unexplained: axis -> signal -> share of the gap's power that stays.
        remains: axis -> what the remainder looks like.
        advice: further sentences.
        joints: joints with a gap.
    """

    verdict: Verdict
    sentence: str
    unexplained: dict[str, dict[str, float]]
    remains: dict[str, str]
    advice: list[str]
    joints: tuple[int, ...]


@dataclass(frozen=True)
class Left:
    """What the named effects leave of the gaps, on the fitted logs.

    Attributes:
        stays: joint with a gap -> share of its power that stays.
        open: joints of which more than noise and more than a small share stays.
        words: joint -> what else is open about it, that a model of the plant cannot show.
        beyond: joint -> share of an unseen log's gap that stays though the effects hold what they
            promise there: the model itself foretells that motion badly.
    """

    stays: dict[int, float]
    open: tuple[int, ...]
    words: dict[int, str] = field(default_factory=dict)
    beyond: dict[int, float] = field(default_factory=dict)

    def following(self, patterns: Mapping[int, Pattern]) -> Left:
        """Return the same with joints whose rest follows a pattern, however small it is."""
        words = {j: p.words for j, p in patterns.items()}
        share = {j: max(p.share, self.stays.get(j, 0.0)) for j, p in patterns.items()}
        return replace(self.beside(words), stays={**self.stays, **share})

    def beside(self, words: Mapping[int, str]) -> Left:
        """Return the same with joints that are open for another reason."""
        stays = {**dict.fromkeys(words, 1.0), **self.stays}
        return replace(
            self, stays=stays, open=tuple(sorted({*self.open, *words})), words={**self.words, **words}
        )


def left_over(start: Ready, decision: Decision, gap: Gaps) -> Left:
    """Return what the named effects leave, on the fitted logs and on validation logs if there are any.

    What the columns of a named effect leave over counts here; what is too small to matter, or was never
    known to a twin, is part of the base.
    """
    found = _in_motion(start, decision, gap)
    stays, open_, beyond = dict(found.stays), set(found.open), dict(found.beyond)
    for j, share in _at_rest(start, decision, gap).items():
        if 1.0 - share > STAYS_UNSEEN and not _unfulfilled(gap, j):
            beyond[j] = 1.0 - max(share, 0.0)
            continue
        stays[j] = max(stays.get(j, 0.0), 1.0 - max(share, 0.0))
        if 1.0 - share > STAYS_UNSEEN:
            open_.add(j)
    return Left(stays, tuple(sorted(open_)), beyond=beyond)


def _in_motion(start: Ready, decision: Decision, gap: Gaps) -> Left:
    """Return what stays of the gaps that rows in motion show."""
    limit = SIGNIFICANT[start.stage.noise.kind]
    plain = admit(decision.searched, decision.quiet)
    before = excess(plain, start)
    after = excess(admit(plain, [n.judged for n in decision.named]), start)
    stays = {j: float(np.clip(after[j] / x, 0.0, 1.0)) for j, x in before.items() if x > limit}
    pushed = _local(decision)
    open_: list[int] = []
    beyond: dict[int, float] = {}
    for j, share in stays.items():
        delivered = None if j in pushed else _delivered(start, gap, j)
        most = STAYS_PUSHED if j in pushed else STAYS
        if after[j] > limit and share > most and not (delivered or 0.0) > FORETOLD:
            open_.append(j)
        elif delivered is not None and 1.0 - delivered > STAYS_UNSEEN:
            if _unfulfilled(gap, j):
                stays[j] = max(share, 1.0 - max(delivered, 0.0))
                open_.append(j)
            else:
                beyond[j] = 1.0 - max(delivered, 0.0)
    return Left(stays, tuple(open_), beyond=beyond)


def _at_rest(start: Ready, decision: Decision, gap: Gaps) -> dict[int, float]:
    """Return the shrink of the joints whose friction was found at rest: rows in motion do not show it."""
    names = start.stage.rows.motions[0].names
    found = [n.judged for n in decision.named if n.calibration is not None]
    joints = {joint for x in found for joint in x.joints}
    shrinks = {j: gap.together.get(names[j], {}).get("u") for j in joints}
    return {j: x.share for j, x in shrinks.items() if x is not None}


def _local(decision: Decision) -> set[int]:
    """Return the joints that were pushed and no more: another log cannot foretell that."""
    joints: dict[bool, set[int]] = {True: set(), False: set()}
    for n in decision.named:
        joints[n.judged.family.local] |= n.judged.joints
    return joints[True] - joints[False]


def _delivered(start: Ready, gap: Gaps, joint: int) -> float | None:
    """Return the shrink on validation logs: 1 where only noise is left, None where they show no gap."""
    axis = start.stage.rows.motions[0].names[joint]
    found = gap.together.get(axis, {}).get("u")
    if found is None or found.on != "validation":
        return None
    noise = (1.0 + 2.0 * SIGNIFICANT[start.stage.noise.kind]) * start.stage.noise.rms[joint] ** 2
    if found.after**2 > noise:
        return found.share
    return 1.0 if found.before**2 > noise else None


def _unfulfilled(gap: Gaps, joint: int) -> bool:
    """Whether an unseen log does not hold what the effects foretell of it."""
    return foretold(gap.before, gap.after, joint)[0] < FORETOLD_LEAST


def judge(start: Ready, decision: Decision, gap: Gaps, left: Left, effects: Sequence[Found]) -> Judgement:
    """Return the verdict of a decision."""
    names = start.stage.rows.motions[0].names
    open_, stays = left.open, left.stays
    verdict: Verdict
    if effects:
        stated = [e.shrink.values() for e in effects if e.shrink]  # a drive's limit states none
        shrinks = not stated or any(x.share > 0.0 for of in stated for x in of)
        verdict = "partly_explained" if open_ or not shrinks else "explained"
    else:
        verdict = "unexplained" if open_ else "none"
    residuals = _after(start, gap) if effects else list(start.residuals)
    remains = {names[j]: left.words.get(j) or describe(start.stage.rows, residuals, j) for j in open_}
    driven = start.stage.rows.joints
    unexplained = {names[j]: {"u" if j in driven else "v": x} for j, x in stays.items()}
    advice = [f"{axis}: what stays is {words}" for axis, words in remains.items()]
    advice += [BEYOND.format(names[j], share) for j, share in left.beyond.items() if j not in open_]
    advice += [NEVER.format(*q.key[::-1]) for q in decision.quiet if q.key in start.stage.base.unknown]
    return Judgement(verdict, sentence(verdict, effects, remains), unexplained, remains, advice, tuple(stays))


def _after(start: Ready, gap: Gaps):  # type: ignore[no-untyped-def]
    """Return the errors after the effects laid on the channels' rows, zero where none was kept."""
    out = [np.zeros(len(c.y)) for c in start.stage.rows.channels]
    places = {id(c): k for k, c in enumerate(start.stage.rows.channels)}
    for piece, error in zip(gap.after.delivered.stage.pieces, gap.after.delivered.values, strict=True):
        out[places[id(piece.channel)]][piece.kept] = error
    return out


def excess(stage: Stage, start: Ready) -> dict[int, float]:
    """Return the whitened power above the noise per joint, run-to-run scatter of friction taken out."""
    ledger = build_ledger(stage, start.theta)
    precision = scatter_precision(stage.base, stage.noise, np.resize(start.theta, stage.base.count))
    out = {}
    for joint in stage.rows.joints:
        parts = [
            steady(p, residual_of(p, ledger.theta), precision)
            for p in stage.pieces
            if p.channel.joint == joint
        ]
        out[joint] = float(np.mean(np.concatenate(parts) ** 2)) - 1.0
    return out


def sentence(verdict: Verdict, effects: Sequence[Found], remains: dict[str, str]) -> str:
    """Return the verdict in one sentence."""
    if verdict == "none":
        return "Log and model agree: what differs is noise, or too small to matter."
    if verdict == "unexplained":
        what = "; ".join(f"{a} ({w})" for a, w in remains.items())
        return f"Log and model differ and nothing in the catalogue explains it: {what}."
    names = " and ".join(_words(e) for e in effects)
    tail = "" if verdict == "explained" else ", and part of the gap stays open"
    return f"The model misses {names}{tail}."


def _words(e: Found) -> str:
    where = "" if e.axis is None else f" on axis {e.axis}"
    if not e.shrink:  # a drive's limit leaves no gap of effort
        return f"{e.effect}{where} (confidence {e.confidence:.0%})"
    share = max(x.share for x in e.shrink.values())
    how_far = f"{share:.0%} of the gap" if share > 0.0 else "the held-out gap does not shrink by it yet"
    return f"{e.effect}{where} ({how_far}; confidence {e.confidence:.0%})"
