"""The verdict: is there a gap, is it explained, what stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.decide import Decision
from pinotwin.diagnosis.gaps import Gaps
from pinotwin.diagnosis.ledger import build_ledger, residual_of
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.remainder import describe
from pinotwin.diagnosis.result import Found, Verdict
from pinotwin.diagnosis.stage import Piece, Stage, scatter_precision

SIGNIFICANT = {"repeats": 0.10, "assumed": 0.35}
"""Whitened power above the noise that counts as a gap, by how the noise is known."""
STAYS = 0.25  # share of the gap's power above which an explanation is only partial


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


def judge(start: Ready, decision: Decision, gap: Gaps, effects: Sequence[Found]) -> Judgement:
    """Return the verdict of a decision."""
    limit = SIGNIFICANT[start.stage.noise.kind]
    before = excess(start.search_stage, start)
    after = excess(decision.stage, start)
    names = start.stage.rows.motions[0].names
    joints = tuple(j for j, x in before.items() if x > limit)
    stays = {j: min(after[j] / before[j], 1.0) for j in joints if before[j] > 0.0}
    open_ = [j for j in joints if after[j] > limit and stays[j] > STAYS]
    verdict: Verdict
    if effects:
        shrinks = all(any(x.share > 0.0 for x in e.shrink.values()) for e in effects)
        verdict = "partly_explained" if open_ or not shrinks else "explained"
    else:
        verdict = "unexplained" if open_ else "none"
    residuals = list(start.residuals)
    remains = (
        {names[j]: describe(start.stage.rows, residuals, j) for j in open_}
        if not effects
        else {names[j]: describe(start.stage.rows, _after(start, gap), j) for j in open_}
    )
    unexplained = {names[j]: {"u": float(max(stays[j], 0.0))} for j in joints}
    advice = [f"{axis}: what stays is {words}" for axis, words in remains.items()]
    return Judgement(
        verdict, sentence(verdict, effects, remains), unexplained, remains, advice, joints
    )


def _after(start: Ready, gap: Gaps):  # type: ignore[no-untyped-def]
    """Return the errors after the effects laid on the channels' rows, zero where none was kept."""
    out = [np.zeros(len(c.y)) for c in start.stage.rows.channels]
    places = {id(c): k for k, c in enumerate(start.stage.rows.channels)}
    for piece, error in zip(gap.after.stage.pieces, gap.after.error, strict=True):
        out[places[id(piece.channel)]][piece.kept] = error
    return out


def excess(stage: Stage, start: Ready) -> dict[int, float]:
    """Return the whitened power above the noise per joint, run-to-run scatter of friction taken out."""
    ledger = build_ledger(stage, start.theta)
    precision = scatter_precision(stage.base, stage.noise, np.resize(start.theta, stage.base.count))
    out = {}
    for joint in stage.rows.joints:
        parts = [
            _steady(p, residual_of(p, ledger.theta), precision)
            for p in stage.pieces
            if p.channel.joint == joint
        ]
        out[joint] = float(np.mean(np.concatenate(parts) ** 2)) - 1.0
    return out


def _steady(piece: Piece, r: Floats, precision: Floats) -> Floats:
    """Return a residual without what this run's own friction explains."""
    scattered = np.isfinite(precision[piece.columns])
    if not scattered.any():
        return r
    S = piece.B[:, scattered]
    M = S.T @ S + np.diag(precision[piece.columns[scattered]])
    return np.asarray(r - S @ np.linalg.solve(M, S.T @ r))


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
    share = max((x.share for x in e.shrink.values()), default=0.0)
    how_far = (
        f"{share:.0%} of the gap" if share > 0.0 else "the held-out gap does not shrink by it yet"
    )
    return f"{e.effect}{where} ({how_far}; confidence {e.confidence:.0%}, not calibrated)"
