"""Candidates of sensing: late effort, wrong effort scale, periodic encoder error.

The effort in these columns is the model's, never the measured one: measured effort holds the very thing
that is to be explained (METHODS A0.2).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Candidate, Context, Family, Scene

TURNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 36)  # errors per turn that are tried
WAVES = np.geomspace(2.0, 40.0, 31)  # errors per travel that are tried


def sensing(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the sensing families of one axis."""
    step = context.scenes[0].motion.step

    def rate(s: Scene) -> Floats:
        return -np.gradient(s.effort[:, [joint]], step, axis=0)

    def effort(s: Scene) -> Floats:
        return s.effort[:, [joint]]

    yield [Candidate("delay", axis, {}, context.on_joint(joint, rate), ("seconds",))]
    yield [Candidate("effort_scale", axis, {}, context.on_joint(joint, effort), ("share",))]
    yield _encoder(context, axis, joint, step)


def _encoder(context: Context, axis: str, joint: int, step: float) -> Family:
    low, high = context.travel(joint)
    if context.machine.rotary[joint]:
        periods = [2.0 * np.pi / k for k in TURNS]
    else:
        periods = [float((high - low) / k) for k in WAVES]
    out = []
    for period in periods:

        def make(s: Scene, period: float = period) -> Floats:
            x = 2.0 * np.pi * s.motion.q[:, joint] / period
            e = np.stack([np.cos(x), np.sin(x)], axis=1)
            bend = np.gradient(np.gradient(e, step, axis=0), step, axis=0)
            return -s.inertia[:, [joint]] * bend

        columns = context.on_joint(joint, make)
        out.append(Candidate("encoder_error", axis, {"period": period}, columns, ("a", "b")))
    return out
