"""Candidates that depend on position: ripple by a fine scan of its pitch, and a smooth table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Context, Family, Scene, Shape, on

SHORTEST = {True: 2.0 * np.pi / 200.0, False: 2e-3}  # [rad], [m]
KNOTS = 24
RIDGE = 0.02  # of a table's knots
ANGLES = np.linspace(-0.5, 0.5, 7)[:-1] * np.pi  # of a modulation, that are tried


def position(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the families of position of one axis."""
    low, high = context.travel(joint)
    if high - low <= 0.0:
        return
    yield ripple(context, axis, joint)
    if context.base.change or not context.has("position_table", axis):
        yield _table(axis, joint, low, high)


def ripple(context: Context, axis: str, joint: int) -> Family:
    """Return a sinusoid of every pitch that the travel resolves, in equal steps of 1 / pitch."""
    low, high = context.travel(joint)
    travel = high - low
    pitches = _pitches(travel, SHORTEST[context.machine.rotary[joint]], 0.7 * travel)
    price = 2.0 * np.log(max(len(pitches) / 4.0, 1.0))

    def values(s: Scene, shape: Shape) -> Floats:
        return waves(s.motion.q[:, joint], shape["period"])

    # Half a step of the grid, as a share of a pitch in the middle of it.
    fine = 0.5 / (4.0 * travel) * pitches[len(pitches) // 2]
    return Family(
        "ripple",
        axis,
        ("a1", "b1"),
        on(joint, values),
        [{"period": p} for p in pitches],
        price=price,
        fine={"period": fine},
    )


def modulated(plain: Family, joint: int, periods: Sequence[float]) -> Family:
    """Return the modulated ripple at some pitches of a plain one."""

    def values(s: Scene, shape: Shape) -> Floats:
        q = s.motion.q[:, joint]
        w = waves(q, shape["period"])
        return np.concatenate([w, np.abs(np.sin(q + shape["eps"]))[:, None] * w], axis=1)

    shapes = [{"period": p, "eps": float(eps)} for p in periods for eps in ANGLES]
    return Family(
        "ripple_modulated",
        plain.axis,
        ("a", "b", "a_mod", "b_mod"),
        on(joint, values),
        shapes,
        price=plain.price + 2.0,
        fine=plain.fine,
    )


def _pitches(travel: float, shortest: float, longest: float) -> list[float]:
    count = int(np.clip(4.0 * travel * (1.0 / shortest - 1.0 / longest), 8, 900))
    return [float(p) for p in 1.0 / np.linspace(1.0 / longest, 1.0 / shortest, count)]


def waves(q: Floats, period: float) -> Floats:
    """Return cos and sin of a pitch, shape (n, 2)."""
    x = 2.0 * np.pi * q / period
    return np.stack([np.cos(x), np.sin(x)], axis=1)


def all_waves(q: Floats, periods: Sequence[float]) -> Floats:
    """Return cos and sin of pitches in equal steps of 1 / pitch, shape (n, 2 len(periods)).

    One complex product a pitch in place of a sine and a cosine.
    """
    k = 2.0 * np.pi / np.asarray(periods)
    step = np.exp(1j * (k[-1] - k[0]) / max(len(k) - 1, 1) * q)
    z = np.exp(1j * k[0] * q)
    out = np.empty((len(q), 2 * len(k)))
    for n in range(len(k)):
        out[:, 2 * n], out[:, 2 * n + 1] = z.real, z.imag
        z *= step
    return out


def _table(axis: str, joint: int, low: float, high: float) -> Family:
    spacing = (high - low) / (KNOTS - 1)

    def values(s: Scene, _: Shape) -> Floats:
        x = (s.motion.q[:, [joint]] - low) / spacing - np.arange(KNOTS)[None, :]
        return np.maximum(0.0, 1.0 - np.abs(x))

    names = tuple(f"m{k}" for k in range(KNOTS))
    shape = {"spacing": spacing}
    return Family("position_table", axis, names, on(joint, values), (shape,), ridge=RIDGE)
