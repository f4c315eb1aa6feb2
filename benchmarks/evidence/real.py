"""What the parts on real recordings share: where they are, cutting a log, errors as shares of the measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pinotwin as pt
from benchmarks.questions.real import data_folder
from pinotwin.arrays import Floats


def folder(name: str) -> Path:
    """Return the folder of a recording.

    Raises:
        FileNotFoundError: it is not at hand.
    """
    root = data_folder(None)
    path = None if root is None else root / name
    if path is None or not path.is_dir():
        raise FileNotFoundError(f"no recording {name!r} below {root}; set PINOTWIN_DATA")
    return path


def halves(log: pt.Log) -> list[pt.Log]:
    """Return the first and the second half of a log."""
    half = len(log) // 2
    return [log.rows(slice(0, half)), log.rows(slice(half, len(log)))]


def percent(predicted: Floats, measured: Floats) -> float:
    """Return the norm of the error over the norm of the measured signal [%]."""
    return 100.0 * float(np.linalg.norm(predicted - measured) / np.linalg.norm(measured))


def unseen_effort(twin: pt.Twin, log: pt.Log) -> tuple[float, dict[str, float]]:
    """Return the error of the twin's effort on a log that it was not fitted to: of all axes, and by axis [%]."""
    motion = twin.motion(log)
    inside = np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])
    predicted, measured = twin.effort(motion)[inside], motion.u[inside]
    by_axis = {
        n: percent(predicted[:, motion.index(n)], measured[:, motion.index(n)]) for n in twin.machine.axes
    }
    return percent(predicted, measured), by_axis
