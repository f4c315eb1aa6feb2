"""What an oracle could see of an effect: its true course as a candidate on the diagnosis' own rows.

The difference that an effect makes, taken from two runs without noise, is put into the place of a candidate: no
catalogue can hold a better one. What it adds that the base model's own coefficients cannot take up is
its size there. Below what the rules of the diagnosis ask for, nobody who looks at an axis in motion can name it.
"""

from __future__ import annotations

import numpy as np

from pinotwin.bench.produce import Produced
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.evidence.moments import products
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.search.scan import Searcher
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.twin import Twin


def evidence(made: Produced, twin: Twin | None) -> float | None:
    """Return the least size of the effects' true courses beside the model and each other; 1 is the least asked for.

    On the axis that each moves most; None without effects, and where one is the controller's.
    """
    if not made.courses:
        return None
    sealed = made.sealed
    try:
        c = compare(twin or sealed.machine, sealed.logs, [])
    except DataError:
        return None
    searcher = Searcher(c)
    columns = {}
    for j in c.new.joints:
        table = [_course(c.twin, c.new.motion.t, course, j) for course in made.courses]
        columns[j] = c.new.picked(np.stack(table, axis=1), j)
    sums = products(searcher.ground.new, columns)
    CX, inverse = sums.CX.sum(axis=0), searcher.ground.folds[-1]
    S = sums.CC.sum(axis=0) - CX @ inverse @ CX.T
    scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
    given = scale**2 / np.diag(np.linalg.inv(S / np.outer(scale, scale) + 1e-9 * np.eye(len(S))))
    sizes = []
    for k, power in enumerate(given):
        main = max(columns, key=lambda j: float(np.sum(columns[j][:, k] ** 2)) / c.floor[j] ** 2)
        rows = max(len(c.new.residual[main]), 1)
        sizes.append(float(np.sqrt(power / rows)) * c.floor[main] / _least(c, main))
    return min(sizes)


def _least(c: Comparison, joint: int) -> float:
    """Return the least RMS that a cause must explain of the effort of an axis [N or N·m]."""
    size = RULES.least_size(change=c.change) * max(c.new.size(joint), 1e-300)
    return float(max(size, np.sqrt(RULES.excess) * c.floor[joint])) if c.change else size


def _course(twin: Twin, t: np.ndarray, course: Log, joint: int) -> np.ndarray:
    """Return the true effort of an effect at one joint on the rows of the motion, logs one after the other."""
    motion = twin.motion(course)
    return np.nan_to_num(np.interp(t, motion.t, np.nan_to_num(motion.u[:, joint])))
