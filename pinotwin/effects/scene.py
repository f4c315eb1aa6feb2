"""The effort of a whole model along a motion: what effects that scale with effort are made of.

    model = sum of all effects that act on the effort,     rigid = that of the tree alone,     mass = M(q)

Effects that take it (``Effect.needs``) are added to it in a few passes, so that ``model`` holds their own
effort as well. A wrong or late effort channel and effects of the loop are left out: they do not change
what it takes to move the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.batch import mass_matrix
from pinotwin.effects.effect import Effect
from pinotwin.effects.rigid_body import RigidBody
from pinotwin.motion import Motion

PASSES = 3
"""Times that the total is formed where an effect scales with it: each pass gains a factor of its share."""


def moves(effect: Effect) -> bool:
    """Whether an effect is part of the effort that moves the machine."""
    return not effect.logged_effort and effect.family.acts != "loop"


def without_model(motion: Motion) -> Motion:
    """Return the motion as it came from its log."""
    return replace(motion, model=None, rigid=None, mass=None)


def needs_model(effects: Sequence[Effect]) -> bool:
    """Whether any effect takes its columns from the effort of the model."""
    return any(effect.needs for effect in effects)


def with_model(motion: Motion, effects: Sequence[Effect], theta: Floats) -> Motion:
    """Return the motion with the channels ``model``, ``rigid`` and ``mass`` of a model.

    The motion itself where no effect needs them; :func:`told` fills them in any case.

    Args:
        motion: prepared log(s).
        effects: all effects of the model, the rigid body among them.
        theta: their coefficients, one after the other, shape (p,).
    """
    return told(motion, effects, theta) if needs_model(effects) else motion


def told(motion: Motion, effects: Sequence[Effect], theta: Floats) -> Motion:
    """Return the motion with the channels of a model, see :func:`with_model`, whether needed or not."""
    nv = len(motion.names)
    ends = np.cumsum([0, *(len(e.coefficients()) for e in effects)])
    parts = [(e, np.asarray(theta)[a:b]) for e, a, b in zip(effects, ends[:-1], ends[1:], strict=True)]
    shape = (len(motion), nv)
    rigid, plain = np.zeros(shape), np.zeros(shape)
    mass = None
    for effect, own in parts:
        if effect.needs or not moves(effect):
            continue
        effort = effect.columns(motion).effort(own, nv)
        plain += effort
        if isinstance(effect, RigidBody):
            rigid += effort
            mass = mass_matrix(effect.model_with(own), motion.q)
    motion = replace(motion, model=plain, rigid=rigid, mass=mass)
    scaling = [(e, x) for e, x in parts if e.needs and moves(e)]
    for _ in range(PASSES if scaling else 0):
        total = plain + sum(e.columns(motion).effort(x, nv) for e, x in scaling)
        motion = replace(motion, model=total)
    return motion


def total_effort(motion: Motion, effects: Sequence[Effect], theta: Floats) -> Floats:
    """Return what the sensors log of a model's effort along a motion, shape (n, nv) [N or N·m]."""
    motion = with_model(motion, effects, theta)
    nv, at = len(motion.names), 0
    out = np.zeros((len(motion), nv))
    for effect in effects:
        count = len(effect.coefficients())
        if effect.family.acts != "loop":
            out += effect.columns(motion).effort(np.asarray(theta)[at : at + count], nv)
        at += count
    return out
