"""What the stages of the closed loops share: an axis' data, their first part, and errors."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.identification.settings import USUAL, Settings
from pinotwin.loop import LoopModel
from pinotwin.loop.data import LoopData
from pinotwin.motion import Motion

TRAINED = 2.0 / 3.0  # Share of the log on which the orders are compared; the rest judges them


def loop_data(motion: Motion, disturbance: Floats, name: str, settings: Settings = USUAL) -> LoopData:
    """Return inputs and outputs of a loop, of all joints' disturbance (n, nv) [N or N·m]; pieces of a long log."""
    i = motion.index(name)
    if motion.qr is None or motion.vr is None or motion.ar is None:
        raise DataError(f"{motion.source}: no command in the log")
    if not np.isfinite(motion.u[:, i]).any():
        raise DataError(f"{motion.source}: no effort of axis {name}")
    outputs = np.stack([motion.error[:, i], motion.u[:, i]], axis=1)
    given = motion.step, motion.qr[:, i], disturbance[:, i], outputs, motion.segments
    data = LoopData(*given, axis=name)
    data.require_motion()
    if data.rows <= settings.long:
        return data
    width = settings.short // 12
    every = [slice(a, min(a + width, s.stop)) for s in data.segments for a in range(s.start, s.stop, width)]
    moving = [s for s in every if s.stop - s.start > width // 5 and np.ptp(data.qr[s]) > 0.0]
    return data.within([moving[k] for k in np.unique(np.linspace(0, len(moving) - 1, 12).astype(int))])


def first_part(data: LoopData) -> LoopData:
    """Return the part of the data on which orders are compared."""
    parts = [slice(s.start, min(s.stop, int(TRAINED * len(data.qr)))) for s in data.segments]
    return data.within([s for s in parts if s.stop - s.start > 32])


def errors(data: LoopData, model: LoopModel, *, held_out: bool = False) -> dict[str, float]:
    """Return the error of each output over its RMS [-], with the disturbance from measured motion."""
    total = np.zeros(len(model.outputs))
    size = np.zeros(len(model.outputs))
    for s in data.segments:
        y = model.simulate(data.qr[s], data.d[s])
        start = max(int(TRAINED * len(data.qr)) - s.start, 0) if held_out else 0
        truth = data.outputs[s][start:]
        total += np.sum((y[start:] - truth) ** 2, axis=0)
        size += np.sum(truth**2, axis=0)
    ratio = np.sqrt(total / np.maximum(size, 1e-300))
    return dict(zip(model.outputs, ratio.tolist(), strict=True))


def both_errors(data: LoopData, model: LoopModel, trial: LoopModel) -> dict[str, dict[str, float]]:
    """Return the errors of a loop in the fit [-], and those of its trial on rows that this one did not see."""
    return {"fit": errors(data, model), "held_out": errors(data, trial, held_out=True)}


def score(data: LoopData, model: LoopModel) -> float:
    """Return the mean error of the outputs on held-out rows, each over its RMS [-]."""
    return float(np.mean(list(errors(data, model, held_out=True).values())))
