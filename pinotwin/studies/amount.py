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
    data [s], the error on them and the held-out one. An axis' course is the latter, NaN where it stands, shape (rows,).
    """
    keep_back, guard = 0.3, 0.02  # held out at the end of the log, and left out before it
    motion = prepare(machine, log)
    n = len(motion)
    last, first_kept = int((1.0 - keep_back - guard) * n), int((1.0 - keep_back) * n)
    test = motion.cut(first_kept, n)
    every = (_one(machine, motion, test, stop) for stop in map(int, np.linspace(0, last, 11)[1:]))
    found = [row for row in every if row is not None]
    if not found:
        raise DataError(f"{motion.source}: too short to fit any part of it; record a longer log")
    axes = {name: np.array([row[2][1 + k] for row in found]) for k, name in enumerate(machine.names)}
    rows = [(float(length), float(fitted[0]), float(held[0])) for length, fitted, held in found]
    enough = _enough(*np.array(rows)[:, ::2].T)
    finding = STUDIED["more" if enough is None else "enough"].format(seconds=enough, error=rows[-1][2])
    return Study(finding, ("seconds [s]", "fitted", "held out"), rows, axes)


def _enough(seconds: Floats, held_out: Floats) -> float | None:
    """Return the length [s] from which the held-out error stays within 5 % of its last value; None: not settled."""
    far = np.flatnonzero(np.abs(held_out - held_out[-1]) > 0.05 * held_out[-1])
    first = 0 if not len(far) else int(far[-1]) + 1
    return float(seconds[first]) if first < len(seconds) - 1 else None


def _one(machine: Machine, motion: Motion, test: Motion, stop: int) -> tuple[float, Floats, Floats] | None:
    """Return length, fitted error and held-out error of one fit; None if it has no usable row."""
    try:
        plant = fit_plant(machine, motion.cut(0, stop))
    except DataError:
        return None
    names = len(machine.names)
    fitted = _errors(plant.fit.problem, plant.theta, names)
    kept_back = assemble(test, plant.effects)
    return stop * motion.step, fitted, _errors(kept_back, plant.theta, names)


def _errors(problem: Problem, theta: Floats, joints: int) -> Floats:
    """Return the normalised error of all axes together, then of each, shape (1 + joints,)."""
    error = problem.y - problem.W @ theta
    out = np.full(1 + joints, np.nan)
    out[0] = np.linalg.norm(error) / np.linalg.norm(problem.y)
    for joint, rows in problem.slices.items():
        size = float(np.linalg.norm(problem.y[rows]))
        out[1 + joint] = np.linalg.norm(error[rows]) / size if size > 0 else np.nan
    return out
