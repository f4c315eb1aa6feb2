"""Candidates of sensing: late effort, wrong effort scale, periodic encoder error.

The effort in these columns is the model's, never the measured one: measured effort holds the very thing
that is to be explained (METHODS A0.2).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Context, Family, Scene, Shape, on, shaken

TURNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 36)  # errors per turn that are tried
WAVES = np.geomspace(2.0, 40.0, 31)  # errors per travel that are tried


def sensing(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the sensing families of one axis."""
    step = context.scenes[0].motion.step

    def late(s: Scene, _: Shape) -> Floats:
        return -np.gradient(s.effort[:, joint], step)

    yield Family("delay", axis, ("seconds",), on(joint, late))
    # Without a twin the scale of one axis shows by its coupling with others alone: a slight witness.
    doubt = 0.0 if context.base.change else 12.0
    yield Family("effort_scale", axis, ("share",), on(joint, lambda s, _: s.effort[:, joint]),
                 price=doubt)  # fmt: skip
    yield _encoder(context, axis, joint, step)


def _encoder(context: Context, axis: str, joint: int, step: float) -> Family:
    low, high = context.travel(joint)
    rotary = context.machine.rotary[joint]
    periods = [2.0 * np.pi / k for k in TURNS] if rotary else [(high - low) / k for k in WAVES]

    def values(s: Scene, shape: Shape) -> Floats:
        x = 2.0 * np.pi * s.motion.q[:, joint] / shape["period"]
        e = np.stack([np.cos(x), np.sin(x)], axis=1)
        bend = np.gradient(np.gradient(e, step, axis=0), step, axis=0)
        return -s.inertia(joint)[:, None] * bend

    shapes = [{"period": float(p)} for p in periods]
    return Family(
        "encoder_error", axis, ("a", "b"), shaken(context, joint, values), shapes, shakes=True,
        fine={} if rotary else {"period": 0.05},
    )  # fmt: skip
