"""The rows of a fit predicted part by part from the other parts; errors held out and the twin's misfit read it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from pinotwin.effects import Effect, needs_model
from pinotwin.errors import DataError
from pinotwin.identification.assemble import Rows
from pinotwin.identification.plant import fit_options
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.solve.crossval import HeldOut, held_out
from pinotwin.solve.problem import Problem

FOLDS = 5
"""Parts of the log that are predicted from the others."""


@dataclass(frozen=True, eq=False)
class Parted:
    """A linear problem of a machine's effects, cross-validated.

    Attributes:
        machine: whose effects these are.
        effects: with fixed shapes.
        length: rows of the motion.
        rows: which of them the problem holds.
        problem: rows and columns.
        held: what the parts predict of one another; None where there are too few rows.
    """

    machine: Machine
    effects: tuple[Effect, ...]
    length: int
    rows: Rows
    problem: Problem
    held: HeldOut | None

    @classmethod
    def of(
        cls, machine: Machine, effects: Sequence[Effect], motion: Motion, rows: Rows, problem: Problem
    ) -> Self:
        """Cross-validate a problem that was assembled of a motion's rows."""
        try:
            held = held_out(problem, folds=FOLDS, options=fit_options(machine, effects, motion))
        except DataError:
            held = None
        return cls(machine, tuple(effects), len(motion), rows, problem, held)

    def serves(self, machine: Machine, effects: Sequence[Effect], motion: Motion) -> bool:
        """Whether that of these effects on a motion would be the same; not where columns follow theta."""
        same = len(effects) == len(self.effects) and all(
            a is b for a, b in zip(effects, self.effects, strict=True)
        )
        return same and machine is self.machine and len(motion) == self.length and not needs_model(effects)
