"""The bank: every family of the catalogue as whitened columns, made once per diagnosis.

A screen of other efforts (drawn healthy machines, injections, what earlier effects left) is then a few
matrix products.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.catalogue import families
from pinotwin.diagnosis.catalogue.position import all_waves
from pinotwin.diagnosis.context import Context, Family, Shape
from pinotwin.diagnosis.ledger import Ledger, Moments, moments, sums
from pinotwin.diagnosis.stage import Stage
from pinotwin.diagnosis.worth import Worth, worth

BATCH = 64
MANY = 100  # candidates of one family above which columns are kept in single precision


@dataclass(frozen=True)
class Batch:
    """Some shapes of a family.

    Attributes:
        shapes: the shapes.
        columns: whitened columns per piece, (m, shapes, k), or None where it does not act.
        ridge: of the family.
        last: base columns of the last ledger they were judged on, and the moments with it.
    """

    shapes: Sequence[Shape]
    columns: list[Floats | None]
    ridge: float = 0.0
    last: list[tuple[tuple[Floats, ...], Moments]] = field(default_factory=list, compare=False)

    def known(self, ledger: Ledger) -> Moments:
        """Return what the candidates owe to the base of a ledger alone."""
        base = tuple(p.B for p in ledger.stage.pieces)
        if not self.last or any(a is not b for a, b in zip(self.last[0][0], base, strict=True)):
            self.last[:] = [(base, moments(ledger, self.columns))]
        return self.last[0][1]

    def worth(self, ledger: Ledger) -> Worth:
        """Return what the candidates are worth on a ledger."""
        return worth(ledger, sums(ledger, self.columns, self.known(ledger)), self.ridge)


@dataclass(frozen=True)
class Shelf:
    """One family with its columns."""

    family: Family
    batches: tuple[Batch, ...]


def fill(context: Context, stage: Stage, leave_out: frozenset[str]) -> list[Shelf]:
    """Return the shelves of every family that acts on some row: an axis at rest has none."""
    every = (shelf(context, stage, family) for family in families(context, leave_out=leave_out))
    return [s for s in every if any(x is not None for b in s.batches for x in b.columns)]


def shelf(context: Context, stage: Stage, family: Family) -> Shelf:
    """Return one family with its columns."""
    return Shelf(family, tuple(_batches(context, stage, family)))


def _batches(context: Context, stage: Stage, family: Family) -> Iterator[Batch]:
    for first in range(0, len(family.shapes), BATCH):
        shapes = family.shapes[first : first + BATCH]
        if family.effect == "ripple" and len(shapes) > 1:
            columns = _rippled(context, stage, family, [s["period"] for s in shapes])
        else:
            columns = stacked(stage, [family.at(context, s).columns for s in shapes])
        if len(family.shapes) > MANY:
            columns = [None if x is None else x.astype(np.float32) for x in columns]
        yield Batch(shapes, columns, family.ridge)


def stacked(stage: Stage, columns: Sequence[list]) -> list[Floats | None]:  # type: ignore[type-arg]
    """Return whitened columns of several candidates per piece, shape (m, I, k)."""
    parts = [stage.project(c) for c in columns]
    out: list[Floats | None] = []
    for piece in range(len(stage.pieces)):
        present = [x for x in (p[piece] for p in parts) if x is not None]
        out.append(np.stack(present, axis=1) if present else None)
    return out


def _rippled(context: Context, stage: Stage, family: Family, periods: Sequence[float]) -> list[Floats | None]:
    joint = context.machine.axis(str(family.axis)).index
    logs = {p.channel.log for p in stage.pieces if p.channel.joint == joint}
    raw = {k: all_waves(context.scenes[k].motion.q[:, joint], periods) for k in sorted(logs)}
    out: list[Floats | None] = []
    for piece in stage.pieces:
        if piece.channel.joint != joint:
            out.append(None)
            continue
        white = stage.whitened(piece, raw[piece.channel.log])
        out.append(white.reshape(len(white), len(periods), 2))
    return out
