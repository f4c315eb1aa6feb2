"""What an oracle could see of an effect: the evidence of its true course on the diagnosis' own rows.

The gap that an effect makes, taken from two runs without noise, is put into the place of a candidate: no
catalogue can hold a better one. What it would gain in the mean, with the base model, its prior and the
run-to-run scatter of friction fitted beside it, is its deviance. Below about 25 (METHODS A2: what the best of
a catalogue reaches by chance) nobody who looks at an axis in motion can name it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.bench.produce import Produced
from pinotwin.diagnosis.bank import stacked
from pinotwin.diagnosis.ledger import build_ledger, moments
from pinotwin.diagnosis.prepare import Ready, ready
from pinotwin.diagnosis.stage import Blocks
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.twin import Twin


def evidence(made: Produced, twin: Twin | None) -> float | None:
    """Return the expected deviance of the true course of the weakest effect, the others' beside it.

    None without effects, and where one is the controller's.

    Args:
        made: the case.
        twin: what a change is seen against.
    """
    if not made.courses:
        return None
    sealed = made.sealed
    try:
        start = ready(twin or sealed.machine, sealed.logs, sealed.validation, _silent)
    except DataError:
        return None
    stage = start.search_stage
    columns = stacked(stage, [_columns(start, made.courses)])
    S = moments(build_ledger(stage, start.theta), columns).S[0, 0]
    scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
    given = np.diag(np.linalg.inv(S / np.outer(scale, scale) + 1e-9 * np.eye(len(S))))
    return float(np.min(scale**2 / given))


def _columns(start: Ready, courses: Sequence[Log]) -> list[Blocks]:
    """Return the courses as the columns of one candidate."""
    machine = start.context.machine
    cutoff = machine.data.cutoff or 1e9
    read = [prepare(machine, log, cutoff=cutoff, decimate=1) for log in courses]
    out: list[Blocks] = []
    for scene in start.context.scenes:
        values = np.zeros((len(scene.motion), machine.nv, len(read)))
        for k, course in enumerate(read):
            count = min(len(values), len(course))
            if not start.stage.rows.validation[scene.log]:
                values[:count, :, k] = np.nan_to_num(course.u[:count])
        out.append([(joint, values[:, joint]) for joint in range(machine.nv)])
    return out


def _silent(stage: str) -> None:
    del stage
