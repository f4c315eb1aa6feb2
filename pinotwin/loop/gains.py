"""Has a controller changed? Its gains found anew in another log, with its delays and filters kept.

With the shape known the law is linear in its gains, so that this is one least-squares fit; rows at which
the drive was at its limit, where the law does not hold, are left out and looked at on their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.loop.controller import Controller
from pinotwin.loop.data import LoopData
from pinotwin.loop.law import SETTLE, law_columns, signals_of
from pinotwin.signals import rms
from pinotwin.solve.sandwich import block_covariance

NAMES = {"p_pi": ("kv kp", "kv ffv", "kv", "ffa"), "pid": ("kp", "integral", "kd", "ffv", "ffa")}
HOLD = 0.02  # [s] an effort must rest at its largest size to be at a drive's limit


@dataclass(frozen=True)
class Gains:
    """The gains of a law in one log.

    Attributes:
        names: of the columns.
        before: gains that were expected, shape (p,).
        after: gains found, shape (p,).
        covariance: of ``after``, shape (p, p).
        unexplained: RMS of the effort that the law leaves, with the expected gains and with the
            gains found [N or N·m].
        held: RMS of what each column changes in the effort, per unit of its gain, shape (p,).
        limited: share of rows at the drive's limit.
        common: share by which all gains together have grown, and the RMS that is left with that alone.
    """

    names: tuple[str, ...]
    before: Floats
    after: Floats
    covariance: Floats
    unexplained: tuple[float, float]
    held: Floats
    limited: float
    common: tuple[float, float]


def gains_in(data: LoopData, controller: Controller) -> Gains:
    """Return the gains of a controller's law in a log.

    Args:
        data: outputs must be the tracking error and the effort, in this order.
        controller: kind, delays and filters, and the gains that were expected.
    """
    s = signals_of(data)
    W = law_columns(s, controller.kind, _shape(controller, s.half))
    rows = np.concatenate([np.arange(p.start + SETTLE, p.stop) for p in s.segments])
    number = np.repeat(np.arange(len(s.segments)), [p.stop - p.start - SETTLE for p in s.segments])
    limited = at_limit(s.u, controller.rms or 0.0, s.step)[rows]
    free = ~limited
    X = _centred(np.column_stack([W, s.u])[rows], number, free)[free]
    X, y = X[:, :-1], X[:, -1]
    size = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-300)
    found = np.linalg.lstsq(X / size, y, rcond=1e-10)[0] / size
    before, left = expected(controller), y - X @ found
    law = X @ before
    factor = float(law @ y / max(float(law @ law), 1e-300))
    return Gains(
        names=NAMES[controller.kind],
        before=before,
        after=found,
        covariance=block_covariance(X, left)[: len(found), : len(found)],
        unexplained=(rms(y - X @ before), rms(left)),
        held=size,
        limited=float(limited.mean()),
        common=(factor - 1.0, rms(y - factor * law)),
    )


def expected(controller: Controller) -> Floats:
    """Return the gains of a controller as they multiply the columns of its law."""
    c = controller
    if c.kind == "p_pi":
        return np.array([c.kv * c.kp, c.kv * c.ffv, c.kv, c.ffa])
    return np.array([c.kp, c.integral, c.kd, c.ffv, c.ffa])


def at_limit(u: Floats, noise: float, step: float) -> Mask:
    """Return where an effort rests near the largest size it has, for a while.

    A drive at its limit does not rest at its very largest reading: noise and the current loop overshoot
    it. The level is the size that is met most often among the largest fifth.

    Args:
        u: effort [N or N·m], shape (n,).
        noise: standard deviation of its noise.
        step: sampling interval [s].
    """
    size = np.abs(np.nan_to_num(u))
    top = float(size.max(initial=0.0))
    counts, edges = np.histogram(size, np.linspace(0.8 * top, top * (1.0 + 1e-12) + 1e-300, 21))
    level = float(edges[int(np.argmax(counts))])
    near = size >= level - 5.0 * noise - 0.005 * top
    ends = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    out = np.zeros(len(u), dtype=bool)
    for a, b in zip(ends[::2], ends[1::2], strict=True):
        out[a:b] = (b - a) * step >= HOLD and b - a >= 3
    return out


def _shape(c: Controller, half: float) -> Floats:
    samples = np.array([c.delay, c.velocity_delay, c.filter_time]) / c.step
    rate = c.integral if c.kind == "p_pi" else 0.0
    return np.array([samples[0], max(samples[1] - half, 0.0), samples[2], rate])


def _centred(x: Floats, number: Ints, free: Mask) -> Floats:
    """Return columns less their mean over the free rows of each segment: constants projected out."""
    out = x.copy()
    for k in np.unique(number):
        own = number == k
        out[own] -= x[own & free].mean(axis=0) if (own & free).any() else x[own].mean(axis=0)
    return out
