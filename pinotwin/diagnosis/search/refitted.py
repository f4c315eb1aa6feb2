"""A cause that the machine lists already, whose shape was fitted to something else for want of a better cause.

The pitch of a listed ripple is searched while the machine is fitted. Where the logs hold a larger thing that looks
like a ripple, the search ends there; once that thing is found, the ripple that is listed turns up at its own pitch and
would be said to be missing.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.rules import Rules
from pinotwin.diagnosis.search.scan import Scored, Searcher


def listed_elsewhere(one: Scored, searcher: Searcher, rules: Rules) -> bool:
    """Whether a cause stands for an effect that the machine lists: beside it that one is needless at its own shape."""
    c, effect = searcher.comparison, named(one.effect)
    axis = c.machine.axes.get(effect.axis or "")
    if c.change or axis is None:
        return False
    if not any(e.name == effect.name and e.shapes() for e in axis.effects):
        return False
    own = [
        where
        for e, where in zip(c.twin.effects, c.twin.slices, strict=True)
        if (e.name, e.axis) == (effect.name, effect.axis)
    ]
    return any(_worth(searcher, c.twin.theta, where) < rules.needless * one.gain for where in own)


def _worth(searcher: Searcher, theta: Floats, where: slice) -> float:
    """Return how much more the model would leave without some of its columns, floor units squared."""
    ground = searcher.ground
    value = theta[where] + ground.alone.base[where]
    return float(value @ np.linalg.solve(ground.folds[-1][where, where], value))
