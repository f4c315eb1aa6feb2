"""The gap of every axis on data that were not fitted, before and after, with arrays for plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.diagnosis.admission import Judged
from pinotwin.diagnosis.decide import Decision
from pinotwin.diagnosis.prepare import Ready
from pinotwin.diagnosis.result import Gap, Shrink, Traces
from pinotwin.diagnosis.shrinking import Errors, HeldOut, held_out, plain_stage, shrink
from pinotwin.diagnosis.stage import Stage


@dataclass(frozen=True)
class Gaps:
    """Gap and shrink of every axis.

    Attributes:
        table: axis -> signal -> gap.
        together: axis -> signal -> shrink of all named effects.
        plain: the stage without whitening.
        before: errors of the base (with what was admitted quietly).
        after: errors with all named effects.
        traces: arrays for plots.
    """

    table: dict[str, dict[str, Gap]]
    together: dict[str, dict[str, Shrink]]
    plain: Stage
    before: HeldOut
    after: HeldOut
    traces: tuple[Traces, ...]

    def beside(self, vibrations: Mapping[str, Gap], shrinks: Mapping[str, Shrink]) -> Gaps:
        """Return the gaps with those of the vibration of passive joints beside."""
        table = {**self.table, **{joint: {"v": g} for joint, g in vibrations.items()}}
        together = {**self.together, **{joint: {"v": x} for joint, x in shrinks.items()}}
        return replace(self, table=table, together=together)

    def with_errors(self, errors: Mapping[str, Gap], shrinks: Mapping[str, Shrink]) -> Gaps:
        """Return the gaps with those of the tracking error beside."""
        table = {a: {**row, **({"e": errors[a]} if a in errors else {})} for a, row in self.table.items()}
        together = {
            a: {**row, **({"e": shrinks[a]} if a in shrinks else {})} for a, row in self.together.items()
        }
        return replace(self, table=table, together=together)


def gaps(start: Ready, decision: Decision, rng: np.random.Generator) -> Gaps:
    """Return the gaps before and after the named effects."""
    stage = plain_stage(start.stage)
    quiet: Sequence[Judged] = decision.quiet
    named = [n.judged for n in decision.named]
    before = held_out(stage, quiet, start.theta)
    after = held_out(stage, [*quiet, *named], start.theta) if named else before
    table: dict[str, dict[str, Gap]] = {}
    together: dict[str, dict[str, Shrink]] = {}
    for joint in stage.rows.joints:
        axis = stage.rows.motions[0].names[joint]
        size = _size(before.delivered, joint)
        rms = _rms(before.delivered, joint)
        noise = stage.noise.rms[joint]
        table[axis] = {"u": Gap(rms, rms / size if size else 0.0, noise, _rms(after.delivered, joint))}
        if named:
            found = shrink(before, after, joint, noise, rng)
            together[axis] = {} if found is None else {"u": found}
    return Gaps(table, together, stage, before, after, tuple(_traces(before.delivered, after.delivered)))


def _rms(errors: Errors, joint: int) -> float:
    parts = [e for p, e in zip(errors.stage.pieces, errors.values, strict=True) if p.channel.joint == joint]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else 0.0


def _size(errors: Errors, joint: int) -> float:
    parts = [p.channel.y for p in errors.stage.pieces if p.channel.joint == joint]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else 0.0


def _traces(before: Errors, after: Errors) -> list[Traces]:
    out = []
    motions = before.stage.rows.motions
    for piece, e, f in zip(before.stage.pieces, before.values, after.values, strict=True):
        motion = motions[piece.channel.log]
        t = motion.t[piece.channel.centres[piece.kept]]
        out.append(Traces(motion.names[piece.channel.joint], piece.channel.log, t, e, f))
    return out
