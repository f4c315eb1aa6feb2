"""How the simulated error and effort of an axis change with what is searched of its controller and friction.

The simulation follows its own derivatives along the numbers that axis and law are made of
(:mod:`pinotwin.simulation.axis_slopes`); what of these a coordinate of the search moves is found by differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.identification.servo.problem import PLANT, AxisProblem
from pinotwin.loop.servo import Servo
from pinotwin.simulation.axis_slopes import FIRST_GAIN, PLACES

STEP = 1e-6
"""Step of a difference, in units of the search: the numbers of a law are smooth in it."""


def along(
    p: AxisProblem, names: Sequence[str], scale: Floats, servo: Callable[[Floats], Servo], x: Floats
) -> Floats:
    """Return how the numbers of an axis change with every coordinate of a search, shape (k, numbers).

    Args:
        p: the axis, with the plant's factors at the point.
        names: of the coordinates.
        scale: their units, where they are gains.
        servo: the controller at a point.
        x: the point.
    """
    here = p.direction(servo(x))
    out = np.zeros((len(x), len(here)))
    size = {"inertia": p.inertia, "viscous": p.viscous}  # all four are searched by their logarithms
    for i, name in enumerate(names):
        if name in PLANT:
            out[i, PLACES[name]] = size.get(name, 1.0)
        elif name.startswith("gain"):
            out[i, FIRST_GAIN + int(name[4:])] = scale[i]
        else:
            moved = x.copy()
            moved[i] += STEP
            out[i] = (p.direction(servo(moved)) - here) / STEP
    return out
