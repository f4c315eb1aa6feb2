"""What an oracle could see of an effect: its true course (two runs without noise) as a candidate on the same rows.

Its size is what the base model's own coefficients cannot take up; below the least that is asked for nobody can name it.
"""

from __future__ import annotations

import numpy as np

from pinotwin.bench.produce import Produced
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.evidence.moments import products
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.search.scan import Searcher
from pinotwin.errors import DataError
from pinotwin.twin import Twin


def evidence(made: Produced, twin: Twin | None) -> float | None:
    """Return the least size of the true courses, each on its main axis, 1 the least asked for; None without any."""
    if not made.courses:
        return None
    sealed = made.sealed
    try:
        c = compare(twin or sealed.machine, sealed.logs, [])
    except DataError:
        return None
    searcher = Searcher(c)
    columns = {}
    motions = [c.twin.motion(course) for course in made.courses]
    for j in c.new.joints:  # logs one after the other
        table = [np.interp(c.new.motion.t, m.t, np.nan_to_num(m.u[:, j])) for m in motions]
        columns[j] = c.new.picked(np.nan_to_num(np.stack(table, axis=1)), j)
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
