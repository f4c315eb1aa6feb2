"""The effort of an axis predicted with and without one effect (thesis Fig. 3-8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.studies.evidence import Evidence, evidence
from pinotwin.studies.overlay import RIPPLE, effect_keys_of
from pinotwin.twin import Twin


@dataclass(frozen=True, eq=False)
class WithAndWithout:
    """Measured effort beside two predictions.

    Attributes:
        axis: whose effort it is.
        rotary: N·m, else N.
        t: time of every row [s], shape (m,).
        measured: [N or N·m], shape (m,).
        complete: predicted with all effects.
        without: predicted without the effects that were left out.
        left_out: their keys.
    """

    axis: str
    rotary: bool
    t: Floats
    measured: Floats
    complete: Floats
    without: Floats
    left_out: tuple[str, ...]

    def errors(self) -> tuple[float, float]:
        """Return the RMS error with and without the effects [N or N·m]."""
        pairs = (self.complete, self.without)
        complete, without = (float(np.sqrt(np.mean((self.measured - x) ** 2))) for x in pairs)
        return complete, without


def with_and_without(
    twin: Twin,
    log: Log | Sequence[Log] | Evidence,
    axis: str,
    names: Sequence[str] = RIPPLE,
) -> WithAndWithout:
    """Return the effort of an axis with and without some of its effects; by default its ripple.

    The effects are left out of the prediction; the others keep the coefficients that they have
    beside them.

    Raises:
        DataError: the axis has no such effect.
    """
    given = log if isinstance(log, Evidence) else evidence(twin, log)
    j = given.index(axis)
    keys = effect_keys_of(twin, axis, names)
    if not keys:
        raise DataError(f"{twin.machine.name}: axis {axis} has none of {', '.join(names)}")
    rows = given.use[:, j]
    measured = given.u[rows, j]
    complete = measured - given.residual[rows, j]
    removed = np.sum([given.parts[key][rows, j] for key in keys], axis=0)
    return WithAndWithout(axis, given.rotary[j], given.t[rows], measured, complete, complete - removed, keys)
