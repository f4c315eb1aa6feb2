"""What an oracle could see of an effect: its true course (two runs without noise) as a candidate on the same rows.

Its size is what the base model's own coefficients cannot take up; below the least that is asked for nobody can name it.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.bench.produce import Produced
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.days.ground import Ground
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.errors import DataError
from pinotwin.signals import rms
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
    ground = Ground.of(c)
    first, sizes = ground.samples[0], list[float]()
    motions = [c.twin.motion(course) for course in made.courses]
    columns = {}
    for j in first.joints:  # logs one after the other
        table = [np.interp(first.motion.t, m.t, np.nan_to_num(m.u[:, j])) for m in motions]
        columns[j] = first.picked(np.nan_to_num(np.stack(table, axis=1)), j)
    for k in range(len(motions)):
        main = max(columns, key=lambda j: float(np.sum(columns[j][:, k] ** 2)) / first.size(j) ** 2)
        least = ground.least(main, SETTINGS.share) * first.size(main)
        sizes.append(_beside(ground, main, columns[main], k) / least)
    return min(sizes)


def _beside(g: Ground, joint: int, columns: Floats, k: int) -> float:
    """Return the RMS of one course that neither the twin nor the other courses (m, p) take up [N or N·m]."""
    y, others = columns[:, k], np.column_stack([g.parts[joint][0].twin, np.delete(columns, k, axis=1)])
    return rms(y - others @ np.linalg.lstsq(others, y, rcond=1e-9)[0])
