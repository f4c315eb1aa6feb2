"""The effort of a whole model along a motion: what effects that scale with effort are made of.

``model`` is the sum of all effects on the effort, ``rigid`` that of the tree alone, ``mass`` M(q). Effects that take
it (``Effect.needs``) are added in a few passes. A wrong or late effort channel and effects of the loop are left out.
"""

from __future__ import annotations

import abc
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.batch import mass_matrix
from pinotwin.effects.effect import Columns, Effect, OneAxis
from pinotwin.effects.layout import effect_slices
from pinotwin.effects.rigid_body import RigidBody
from pinotwin.motion import Motion


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
    """Return the motion with ``model``, ``rigid``, ``mass`` of coefficients of shape (p,), if an effect needs them."""
    return with_model_effort(motion, effects, theta) if needs_model(effects) else motion


def with_model_effort(motion: Motion, effects: Sequence[Effect], theta: Floats, passes: int = 3) -> Motion:
    """Return the motion with these channels, needed or not, of coefficients of shape (p,), formed in ``passes``."""
    nv, parts = len(motion.names), _with_own(effects, theta)
    rigid, plain = np.zeros((len(motion), nv)), np.zeros((len(motion), nv))
    mass = None
    for effect, own in parts:
        if effect.needs or not moves(effect):
            continue
        effort = effect.along(motion, own)
        plain += effort
        if isinstance(effect, RigidBody):
            rigid += effort
            mass = mass_matrix(effect.model_with(own), motion.q)
    motion = replace(motion, model=plain, rigid=rigid, mass=mass)
    scaling = [(e, x) for e, x in parts if e.needs and moves(e)]
    for _ in range(passes if scaling else 0):
        total = plain + sum(e.along(motion, x) for e, x in scaling)
        motion = replace(motion, model=total)
    return motion


def total_effort(motion: Motion, effects: Sequence[Effect], theta: Floats) -> Floats:
    """Return what the sensors log of a model's effort along a motion, shape (n, nv) [N or N·m]."""
    motion = with_model(motion, effects, theta)
    acting = [(e, own) for e, own in _with_own(effects, theta) if e.family.acts != "loop"]
    return sum((e.along(motion, own) for e, own in acting), start=np.zeros(motion.q.shape))


def blocks(
    motion: Motion, effects: Sequence[Effect], whole: Sequence[Columns | None], rows: Ints, block: int = 4096
) -> Iterator[tuple[slice, list[Columns]]]:
    """Yield blocks of ascending ``rows`` (m,) and the effects' columns there, of ``whole`` ones (m, ...) or formed."""
    for start in range(0, len(rows), block):
        some = slice(start, min(start + block, len(rows)))
        piece, pairs = motion.at(rows[some]), zip(whole, effects, strict=True)
        yield some, [Columns(c.joints, c.values[some]) if c else e.columns(piece) for c, e in pairs]


def _with_own(effects: Sequence[Effect], theta: Floats) -> list[tuple[Effect, Floats]]:
    """Return every effect with its part of the coefficients."""
    return [(e, np.asarray(theta)[s]) for e, s in zip(effects, effect_slices(effects), strict=True)]


def inertia(effect: Effect, motion: Motion, joint: int) -> Floats:
    """Return the inertia of a joint, others at rest, shape (n,), above a twentieth of its largest: below it errs."""
    own = effect.channel(motion, "mass")[:, joint, joint]
    return np.asarray(np.maximum(own, 0.05 * np.abs(own).max(initial=0.0) + 1e-12))


class Shaking(OneAxis):
    """An effect of one axis that shakes others, by M_ij (a_load - a_measured) through the inertia matrix.

    The share ``load`` of its inertia moves otherwise than the encoder says; couplings below 1e-3 move nothing.
    """

    load: float = 1.0

    @abc.abstractmethod
    def swing(self, motion: Motion) -> Floats:
        """Return the columns of its own axis alone, shape (n, p)."""

    def columns(self, motion: Motion) -> Columns:
        joints, pushes = self.felt(motion)
        return Columns(joints, self.swing(motion)[:, None] * pushes[:, :, None])

    def felt(self, motion: Motion) -> tuple[tuple[int, ...], Floats]:
        """Return the joints that feel it, its own first, and how much of its swing each does, shape (n, k) [1]."""
        joint, mass = motion.index(self.axis), self.channel(motion, "mass")
        mine, felt, pushes = inertia(self, motion, joint), [joint], [np.ones(len(motion))]
        for k in range(mass.shape[1]):
            ratio = np.abs(mass[:, k, joint]) / np.sqrt(mine * inertia(self, motion, k))
            if k != joint and np.max(ratio, initial=0.0) > 1e-3:
                felt.append(k)
                pushes.append(mass[:, k, joint] / (self.load * mine))
        return tuple(felt), np.stack(pushes, axis=1)
