"""The law of a controller as columns: what each gain multiplies, from logged channels alone.

Linear in the gains once its shape is known: delay of the law, further delay of the velocity, its filter
[samples each] and, in the cascade, the integral rate 1/ti [1/s].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.loop.controller import Kind
from pinotwin.loop.data import LoopData

SETTLE = 30
"""Rows left out at the start of a segment: the filter's and the delay's unknown past."""
HALF = 0.5
"""Samples by which v and de, backward differences, are late in themselves."""


@dataclass(frozen=True)
class Signals:
    """Channels of the law with the segments they live on."""

    e: Floats
    v: Floats
    de: Floats
    vr: Floats
    ar: Floats
    u: Floats
    segments: tuple[slice, ...]
    step: float


def signals_of(data: LoopData) -> Signals:
    """Return the channels of the law; v is the backward difference of qr - e."""
    e, u = data.outputs[:, 0], data.outputs[:, 1]
    velocity, slope = np.zeros(len(data)), np.zeros(len(data))
    for s in data.segments:
        velocity[s] = _difference(data.qr[s] - e[s], data.step)
        slope[s] = _difference(e[s], data.step)
    segments = tuple(s for s in data.segments if s.stop - s.start > 3 * SETTLE)
    if not segments:
        raise DataError(f"{data.axis}: no unbroken segment longer than {3 * SETTLE} samples")
    return Signals(e, velocity, slope, data.velocity, data.acceleration, u, segments, data.step)


def _difference(x: Floats, step: float) -> Floats:
    """Return the backward difference, what a sampled controller takes for a velocity."""
    return np.diff(x, prepend=2.0 * x[0] - x[1]) / step


def law_columns(s: Signals, kind: Kind, shape: Floats) -> Floats:
    """Return the columns of the gains at a shape, shape (n, p).

    Cascade: kv kp, kv ffv, kv, ffa. PID: kp, ki, kd, ffv, ffa.
    """
    delay, lag, constant, rate = shape
    out = np.zeros((len(s.e), 4 if kind == "p_pi" else 5))
    for part in s.segments:
        e, vr, ar = (x[part] for x in (s.e, s.vr, s.ar))
        seen = _low_pass(_late((s.v if kind == "p_pi" else s.de)[part], lag), constant)
        if kind == "p_pi":
            own = [x + rate * _integral(x, s.step) for x in (e, vr, -seen)]
        else:
            own = [e, _integral(e, s.step), seen, vr]
        out[part] = np.column_stack([_late(x, delay) for x in (*own, ar)])
    return out


def _low_pass(x: Floats, constant: float) -> Floats:
    """Return x through a first-order low-pass of a time constant in samples."""
    pole = np.exp(-1.0 / constant) if constant > 1e-3 else 0.0
    return lfilter([1.0 - pole], [1.0, -pole], x, zi=[pole * x[0]])[0]


def _integral(x: Floats, step: float) -> Floats:
    return step * np.cumsum(x)


def _late(x: Floats, delay: float) -> Floats:
    """Return x delayed by a fractional number of samples, straight between samples."""
    whole = int(delay)
    part = delay - whole
    padded = np.concatenate([np.full(whole + 1, x[0]), x])
    return (1.0 - part) * padded[1 : len(x) + 1] + part * padded[: len(x)]
