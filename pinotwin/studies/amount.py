"""How much data is enough: prediction error against the length of the log (thesis Fig. 3-6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class ErrorAgainstData:
    """Normalised 2-norm of the effort error, ||u - u_hat|| / ||u||, for growing amounts of data.

    Attributes:
        names: axes.
        seconds: length of the data that were fitted [s], shape (k,).
        fitted: error on those data, all axes together, shape (k,).
        held_out: error on data that no fit saw, all axes together, shape (k,).
        held_out_axes: the same per axis, NaN where an axis does not move, shape (k, axes).
    """

    names: tuple[str, ...]
    seconds: Floats
    fitted: Floats
    held_out: Floats
    held_out_axes: Floats

    def enough(self) -> float | None:
        """Return the length from which the held-out error stays within 5 % of its last value [s].

        None: it has not settled; a longer log would still help.
        """
        near = np.abs(self.held_out - self.held_out[-1]) <= 0.05 * self.held_out[-1]
        last_far = np.flatnonzero(~near)
        first = 0 if not len(last_far) else int(last_far[-1]) + 1
        return float(self.seconds[first]) if first < len(self.seconds) - 1 else None


def error_against_data(
    machine: Machine,
    log: Log | Sequence[Log],
    *,
    seconds: Sequence[float] | None = None,
    keep_back: float = 0.3,
    guard: float = 0.02,
) -> ErrorAgainstData:
    """Identify a machine from ever more of a log, and judge each fit on its end, which none saw.

    Every fit is a whole one: shapes are searched and coefficients solved from those data alone.

    Args:
        machine: what is believed.
        log: servo log(s).
        seconds: lengths to fit [s]; None: ten, evenly spaced.
        keep_back: share of the log, at its end, that is held out for validation.
        guard: share left out between what is fitted and what is judged.

    Raises:
        DataError: the log is too short for that.
    """
    if not 0.0 < keep_back < 0.9:
        raise DataError(f"keep_back is a share of the log between 0 and 0.9, not {keep_back:g}")
    motion = prepare(machine, log)
    n = len(motion)
    last, first_kept = int((1.0 - keep_back - guard) * n), int((1.0 - keep_back) * n)
    test = motion.cut(first_kept, n)
    rows = [_one(machine, motion, test, stop) for stop in _stops(motion, last, seconds)]
    found = [row for row in rows if row is not None]
    if not found:
        raise DataError(f"{motion.source}: too short to fit any part of it; record a longer log")
    table = np.array([row[1:] for row in found])
    return ErrorAgainstData(
        names=machine.names,
        seconds=np.array([row[0] for row in found]),
        fitted=table[:, 0, 0],
        held_out=table[:, 1, 0],
        held_out_axes=table[:, 1, 1:],
    )


def _stops(motion: Motion, last: int, seconds: Sequence[float] | None) -> list[int]:
    if seconds is None:
        return [int(x) for x in np.linspace(0, last, 11)[1:]]
    wanted = [round(x / motion.step) for x in seconds]
    if any(x <= 0 or x > last for x in wanted):
        raise DataError(
            f"{motion.source}: lengths of data must lie between 0 and {last * motion.step:.3g} s "
            "(the end of the log is held out for validation)"
        )
    return wanted


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
