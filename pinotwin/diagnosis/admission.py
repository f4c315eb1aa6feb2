"""Effects admitted to a base: their columns beside its own, and what they are worth there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.bank import stacked
from pinotwin.diagnosis.context import Candidate, Family
from pinotwin.diagnosis.ledger import Ledger, build_ledger, sums
from pinotwin.diagnosis.stage import Piece, Stage
from pinotwin.diagnosis.worth import worth

Key = tuple[str, str | None]

RARE = {
    "geometric_error": 6.0,
    "position_table": 4.0,
    "encoder_error": 4.0,
    "backlash": 6.0,
    "wrist_coupling": 2.0,
    "viscous_asymmetric": 2.0,
    "ripple": 6.0,
    "ripple_modulated": 12.0,
    "external_force": 30.0,
    "delay": 15.0,
    "drive_flexibility": 25.0,
    "stribeck": 18.0,
    "presliding": 12.0,
}
"""Deviance that an effect must bring beyond another one that does the same.

Because it is uncommon, or because a healthy machine shows a little of it: the largest gains of healthy
virtual machines (104, development seed 0) are 50 for ``delay`` (every amplifier has one), 51 for
``drive_flexibility`` (seed 9: every filter looks like one), 22 for ``backlash`` and 46 for ``stribeck``
(seed 9), 32 for ``presliding`` (seed 9), 30 for ``ripple``, and below 20 for the rest.
"""


@dataclass(frozen=True)
class Judged:
    """The best candidate of a family.

    Attributes:
        family: whose best it is.
        candidate: at its best shape.
        G: held-out gain less the price of its search [whitened deviance].
        gain: in-sample gain.
        theta: coefficients, shape (k,).
        share: of its columns that the base leaves open.
        identifiable: whether the log can tell it from the base at all.
    """

    family: Family
    candidate: Candidate
    G: float
    gain: float
    theta: Floats
    share: float
    identifiable: bool

    @property
    def key(self) -> Key:
        """Effect and axis."""
        return self.candidate.effect, self.candidate.axis

    @property
    def joints(self) -> set[int]:
        """Joints that it acts on, without those that it only shakes."""
        joints = [joint for joint, _ in self.candidate.columns[0]]
        return set(joints[:1] if self.family.shakes else joints)


def measured(ledger: Ledger) -> Ledger:
    """Return the ledger with the measured effort alone."""
    return replace(
        ledger,
        right=ledger.right[:, :, :1],
        Y=tuple(y[:, :1] for y in ledger.Y),
        groups=tuple(replace(g, Sy=g.Sy[:, :1]) for g in ledger.groups),
    )


def worth_beside(stage: Stage, theta: Floats, judged: Judged, others: Sequence[Judged]) -> float:
    """Return the held-out gain of an effect at its shape, given other ones."""
    ledger = measured(build_ledger(admit(stage, others), theta))
    columns = stacked(ledger.stage, [judged.candidate.columns])
    w = worth(ledger, sums(ledger, columns), judged.family.ridge)
    price = judged.family.price + RARE.get(judged.family.effect, 0.0)
    return float((w.gain if judged.family.local else w.G)[0, 0]) - price


def joint_worth(ledger: Ledger, a: Judged, b: Judged) -> float:
    """Return the held-out gain of two effects admitted together."""
    parts = [ledger.stage.project(x.candidate.columns) for x in (a, b)]
    both: list[Floats | None] = []
    widths = [len(a.theta), len(b.theta)]
    for k, pair in enumerate(zip(*parts, strict=True)):
        if all(x is None for x in pair):
            both.append(None)
            continue
        m = len(ledger.stage.pieces[k].y)
        filled = [np.zeros((m, n)) if x is None else x for x, n in zip(pair, widths, strict=True)]
        both.append(np.concatenate(filled, axis=1)[:, None, :])
    plain = measured(ledger)
    w = worth(plain, sums(plain, both))
    price = sum(x.family.price + RARE.get(x.family.effect, 0.0) for x in (a, b))
    return float(w.G[0, 0]) - price


def admit(stage: Stage, judged: Sequence[Judged]) -> Stage:
    """Return the stage with the columns of candidates added to its base."""
    p = stage.base.count
    pieces = list(stage.pieces)
    held: list[float] = []
    for item in judged:
        width = len(item.theta)
        values = stage.project(item.candidate.columns)
        size = 0.0
        for n, x in enumerate(values):
            if x is not None:
                pieces[n] = _wider(pieces[n], x, np.arange(p, p + width))
                size += float(np.sum(x**2)) / width
        held += [item.family.ridge * size] * width
        p += width
    mean = np.concatenate([stage.base.mean, np.zeros(p - stage.base.count)])
    precision = np.diag(np.concatenate([np.zeros(stage.base.count), held]))
    precision[: stage.base.count, : stage.base.count] = stage.base.precision
    base = replace(stage.base, mean=mean, precision=precision)
    return replace(stage, base=base, pieces=tuple(pieces))


def _wider(piece: Piece, x: Floats, index: Ints) -> Piece:
    columns = np.concatenate([piece.columns, index.astype(int)])
    return replace(piece, B=np.concatenate([piece.B, x], axis=1), columns=columns)
