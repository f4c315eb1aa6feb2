"""Effects whose load moves otherwise than its encoder says: what that does to the other axes."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Columns, Effect, channel
from pinotwin.motion import Motion

LIGHTEST = 0.05
"""Of the largest inertia of a joint: an inertia below it is an error of the model (it may be negative), and
the contact of a play, stepped at the pace of the mean inertia, would not be stable."""
COUPLED = 1e-3
"""Of the geometric mean of two inertias: a coupling below it moves nothing."""


def inertia(effect: Effect, motion: Motion, joint: int) -> Floats:
    """Return the inertia of a joint, others at rest, shape (n,), kept above LIGHTEST of its largest."""
    own = channel(effect, motion, "mass")[:, joint, joint]
    return np.asarray(np.maximum(own, LIGHTEST * np.abs(own).max(initial=0.0) + 1e-12))


def shaken(effect: Effect, motion: Motion, joint: int, own: Floats, load: float = 1.0) -> Columns:
    """Return columns of a joint with what they do to the others, M_ij (a_load - a_measured).

    Args:
        effect: whose columns they are.
        motion: with the model's inertia matrix.
        joint: whose load moves otherwise.
        own: columns at that joint, shape (n, p).
        load: share of its inertia that moves otherwise.
    """
    mass = channel(effect, motion, "mass")
    mine = inertia(effect, motion, joint)
    others = [k for k in range(mass.shape[1]) if k != joint and _coupled(effect, motion, joint, k)]
    parts = [own, *(own * (mass[:, k, joint] / (load * mine))[:, None] for k in others)]
    return Columns((joint, *others), np.stack(parts, axis=1))


def _coupled(effect: Effect, motion: Motion, joint: int, other: int) -> bool:
    """Whether another joint feels an acceleration of one."""
    mean = np.sqrt(inertia(effect, motion, joint) * inertia(effect, motion, other))
    mass = channel(effect, motion, "mass")[:, other, joint]
    return bool(np.max(np.abs(mass) / mean, initial=0.0) > COUPLED)
