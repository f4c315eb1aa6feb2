"""Candidates that depend on position: ripple by a fine scan of its pitch, and a smooth table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Candidate, Context, Family, Scene

PEAKS = 5
SHORTEST = {True: 2.0 * np.pi / 200.0, False: 2e-3}  # [rad], [m]
KNOTS = 24

Scan = Callable[[int, Sequence[float]], Floats]
"""(joint, pitches) -> in-sample gain of a sinusoid of each pitch, shape (len(pitches),)."""


def position(context: Context, axis: str, joint: int, scan: Scan) -> Iterator[Family]:
    """Yield the families of position of one axis."""
    low, high = context.travel(joint)
    travel = high - low
    if travel <= 0.0:
        return
    rotary = context.machine.rotary[joint]
    pitches = _pitches(travel, SHORTEST[rotary], 0.7 * travel)
    gain = scan(joint, pitches)
    best = [pitches[k] for k in _peaks(gain)]
    price = 2.0 * np.log(max(len(pitches) / 4.0, 1.0))
    yield [_ripple(context, axis, joint, p, price) for p in best]
    if rotary:
        yield [
            _modulated(context, axis, joint, p, eps, price)
            for p in best[:2]
            for eps in np.linspace(-0.5, 0.5, 7)[:-1] * np.pi
        ]
    if not context.has("position_table", axis):
        yield [_table(context, axis, joint, low, high)]


def _pitches(travel: float, shortest: float, longest: float) -> list[float]:
    count = int(np.clip(4.0 * travel * (1.0 / shortest - 1.0 / longest), 8, 900))
    return [float(p) for p in 1.0 / np.linspace(1.0 / longest, 1.0 / shortest, count)]


def _peaks(gain: Floats) -> list[int]:
    padded = np.concatenate([[-1.0], gain, [-1.0]])
    top = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]))
    return [int(k) for k in top[np.argsort(gain[top])[::-1][:PEAKS]]]


def waves(q: Floats, period: float) -> Floats:
    """Return cos and sin of a pitch, shape (n, 2)."""
    x = 2.0 * np.pi * q / period
    return np.stack([np.cos(x), np.sin(x)], axis=1)


def _ripple(context: Context, axis: str, joint: int, period: float, price: float) -> Candidate:
    columns = context.on_joint(joint, lambda s: waves(s.motion.q[:, joint], period))
    return Candidate("ripple", axis, {"period": period}, columns, ("a1", "b1"), price=price)


def _modulated(context, axis, joint, period, eps, price):  # type: ignore[no-untyped-def]
    def make(s: Scene) -> Floats:
        q = s.motion.q[:, joint]
        w = waves(q, period)
        return np.concatenate([w, np.abs(np.sin(q + eps))[:, None] * w], axis=1)

    shape = {"period": period, "eps": float(eps)}
    names = ("a", "b", "a_mod", "b_mod")
    columns = context.on_joint(joint, make)
    return Candidate("ripple_modulated", axis, shape, columns, names, price=price + 2.0)


def _table(context: Context, axis: str, joint: int, low: float, high: float) -> Candidate:
    spacing = (high - low) / (KNOTS - 1)

    def make(s: Scene) -> Floats:
        x = (s.motion.q[:, [joint]] - low) / spacing - np.arange(KNOTS)[None, :]
        return np.maximum(0.0, 1.0 - np.abs(x))

    columns = context.on_joint(joint, make)
    names = tuple(f"m{k}" for k in range(KNOTS))
    return Candidate("position_table", axis, {"spacing": spacing}, columns, names)
