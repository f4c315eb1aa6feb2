"""Candidates of sensing: late effort, wrong effort scale, periodic encoder error.

The effort in these columns is the model's, never the measured one: measured effort holds the very thing
that is to be explained (METHODS A0.2).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Context, Family, Scene, Shape, on, shaken
from pinotwin.motion import Motion

TURNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 36)  # errors per turn that are tried
SPANS = (3e-4, 1e-3, 3e-3, -3e-4, -3e-3)  # [s] over which a delay (a lead) is taken
WAVES = np.geomspace(2.0, 40.0, 31)  # errors per travel that are tried


def sensing(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the sensing families of one axis."""
    step = context.scenes[0].motion.step

    def late(s: Scene, shape: Shape) -> Floats:
        return _late(s.motion, s.effort[:, joint], shape["span"])

    yield Family(
        "delay", axis, ("seconds",), on(joint, late), [{"span": x} for x in SPANS], fine={"span": 0.4}
    )
    # Without a twin the scale of one axis shows by its coupling with others alone: a slight witness.
    doubt = 0.0 if context.base.change else 12.0
    yield Family("effort_scale", axis, ("share",), on(joint, lambda s, _: s.effort[:, joint]), price=doubt)
    yield _encoder(context, axis, joint, step)


def _late(motion: Motion, effort: Floats, span: float) -> Floats:
    """Return what a signal lacks that comes late, per second of delay, shape (n,).

    Taken over a span of about the delay itself: the slope at one moment is that of a delay without end
    small, and leaves 7 % of one of 3 ms open.
    """
    out = np.zeros_like(effort)
    for part in motion.segments:
        t = motion.t[part]
        out[part] = (np.interp(t - span, t, effort[part]) - effort[part]) / span
    return out


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
        "encoder_error",
        axis,
        ("a", "b"),
        shaken(context, joint, values),
        shapes,
        shakes=True,
        fine={} if rotary else {"period": 0.05},
    )
