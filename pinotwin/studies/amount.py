"""How much data is enough: prediction error against the length of the log (thesis Fig. 3-6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.identification.assemble import assemble
from pinotwin.identification.plant import fit_plant
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.solve.problem import Problem
from pinotwin.studies.study import Study
from pinotwin.system.phrases import STUDIED


def error_against_data(machine: Machine, log: Log | Sequence[Log]) -> Study:
    """Identify a machine from ever more of a log; judge each fit on its end, which none saw; DataError if too short.

    Every fit is a whole one. The error is ||u - u_hat|| / ||u|| of all axes; a row of the table is the length of the
    data [s], the error on them and the held-out one.
    """
    keep_back, guard = 0.3, 0.02  # held out at the end of the log, and left out before it
    motion = prepare(machine, log)
    n = len(motion)
    last, first_kept = int((1.0 - keep_back - guard) * n), int((1.0 - keep_back) * n)
    test = motion.cut(first_kept, n)
    every = (_one(machine, motion, test, stop) for stop in map(int, np.linspace(0, last, 11)[1:]))
    rows = [row for row in every if row is not None]
    if not rows:
        raise DataError(f"{motion.source}: too short to fit any part of it; record a longer log")
    enough = _enough(*np.array(rows)[:, ::2].T)
    finding = STUDIED["more" if enough is None else "enough"].format(seconds=enough, error=rows[-1][2])
    return Study(finding, ("seconds [s]", "fitted", "held out"), rows)


def _enough(seconds: Floats, held_out: Floats) -> float | None:
    """Return the length [s] from which the held-out error stays within 5 % of its last value; None: not settled."""
    far = np.flatnonzero(np.abs(held_out - held_out[-1]) > 0.05 * held_out[-1])
    first = 0 if not len(far) else int(far[-1]) + 1
    return float(seconds[first]) if first < len(seconds) - 1 else None


def _one(machine: Machine, motion: Motion, test: Motion, stop: int) -> tuple[float, float, float] | None:
    """Return length [s], fitted error and held-out error [-] of one fit; None if it has no usable row."""
    try:
        plant = fit_plant(machine, motion.cut(0, stop))
    except DataError:
        return None
    fitted = _error(plant.fit.problem, plant.theta)
    return stop * motion.step, fitted, _error(assemble(test, plant.effects), plant.theta)


def _error(problem: Problem, theta: Floats) -> float:
    """Return the normalised error of all axes together [-] with coefficients (p,)."""
    return float(np.linalg.norm(problem.y - problem.W @ theta) / np.linalg.norm(problem.y))
