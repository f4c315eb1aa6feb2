"""What candidates are made from: the motions, and the base model's own prediction of every effort."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import make_interp_spline

from pinotwin.arrays import Floats
from pinotwin.diagnosis.base import Base
from pinotwin.diagnosis.bristle import bristles
from pinotwin.diagnosis.rows import Rows
from pinotwin.diagnosis.stage import Blocks
from pinotwin.effects import Presliding, RigidBody
from pinotwin.effects.layout import effect_slices
from pinotwin.machine import Machine
from pinotwin.motion import Motion

LIGHTEST = 0.05
"""Of the largest inertia of a joint: below it is an error of the base model (it may even be negative), and
the contact of a play, stepped at the pace of the mean inertia, would not be stable."""


@dataclass(frozen=True)
class Scene:
    """One log as candidates see it; arrays of shape (n, nv).

    Attributes:
        log: index of the log.
        motion: prepared log.
        effort: effort that the base model predicts (never the measured one) [N or N·m].
        rigid: the rigid-body part of it.
        direction: direction of motion with bristle memory, within [-1, 1].
        mass: joint-space inertia matrix, shape (n, nv, nv) [kg, kg·m or kg·m²].
    """

    log: int
    motion: Motion
    effort: Floats
    rigid: Floats
    direction: Floats
    mass: Floats

    def inertia(self, joint: int) -> Floats:
        """Return the inertia of a joint, others at rest, shape (n,), kept above LIGHTEST of its largest."""
        own = self.mass[:, joint, joint]
        return np.asarray(np.maximum(own, LIGHTEST * np.abs(own).max() + 1e-12))


@dataclass(frozen=True)
class Context:
    """Everything that a family of candidates may use.

    Attributes:
        machine: the machine.
        rows: rows of the diagnosis.
        base: base model.
        theta: its coefficients.
        scenes: per log.
    """

    machine: Machine
    rows: Rows
    base: Base
    theta: Floats
    scenes: tuple[Scene, ...]

    def has(self, effect: str, axis: str) -> bool:
        """Whether the base lists an effect on an axis."""
        own = [e for e in self.base.effects if e.axis == axis]
        if any(e.name == effect for e in own):
            return True
        elastic = [e for e in own if isinstance(e, Presliding)]
        if effect == "coulomb":
            return bool(elastic) or any(e.name == "coulomb_asymmetric" for e in own)
        return effect == "stribeck" and any(e.stribeck for e in elastic)

    def travel(self, joint: int) -> tuple[float, float]:
        """Return the lowest and highest position of a joint over all logs."""
        q = [s.motion.q[:, joint] for s in self.scenes]
        return min(float(x.min()) for x in q), max(float(x.max()) for x in q)

    def speed(self, joint: int) -> float:
        """Return the top speed of a joint over all logs."""
        return max(float(np.abs(s.motion.v[:, joint]).max()) for s in self.scenes)


Shape = Mapping[str, float]
Make = Callable[[Scene, Shape], Blocks]


@dataclass(frozen=True)
class Family:
    """One effect on one axis, at every shape that is tried.

    Attributes:
        effect: name in the catalogue.
        axis: axis, or None for the machine.
        names: name of every coefficient.
        make: (scene, shape) -> columns per joint.
        shapes: shapes that are tried.
        positive: the one coefficient must not be negative.
        price: what the search of its shape costs beyond the held-out score [deviance].
        fine: shape -> relative half width of its grid, for those that are polished once found.
        ridge: how far its coefficients are held together, as a share of what the data say of them in
            the mean: a table's knots that other blocks hardly visit are not foretold by these.
        local: its columns live in moments of one log; other blocks cannot foretell them, so that it
            is judged by its fit less the price of the search.
        shakes: it acts on its own axis; others it only shakes.
    """

    effect: str
    axis: str | None
    names: tuple[str, ...]
    make: Make
    shapes: Sequence[Shape] = ({},)
    positive: bool = False
    price: float = 0.0
    fine: Mapping[str, float] = field(default_factory=dict)
    ridge: float = 0.0
    local: bool = False
    shakes: bool = False

    @property
    def key(self) -> tuple[str, str | None]:
        """Effect and axis."""
        return self.effect, self.axis

    def columns(self, context: Context, shape: Shape) -> list[Blocks]:
        """Return the columns at one shape, per log."""
        return [self.make(scene, shape) for scene in context.scenes]

    def at(self, context: Context, shape: Shape) -> Candidate:
        """Return the candidate at one shape."""
        return Candidate(self.effect, self.axis, dict(shape), self.columns(context, shape), self.names)


@dataclass(frozen=True)
class Candidate:
    """One effect at one shape.

    Attributes:
        effect: name in the catalogue.
        axis: axis, or None.
        shape: shape values, SI.
        columns: per log, (joint, values of shape (n, k)).
        names: name of every coefficient.
    """

    effect: str
    axis: str | None
    shape: dict[str, float]
    columns: list[Blocks]
    names: tuple[str, ...]


def on(joint: int, values: Callable[[Scene, Shape], Floats]) -> Make:
    """Return the maker of a family that acts on one joint; ``values`` gives (n,) or (n, k)."""

    def make(scene: Scene, shape: Shape) -> Blocks:
        x = values(scene, shape)
        return [(joint, x[:, None] if x.ndim == 1 else x)]

    return make


COUPLED = 1e-3  # of the geometric mean of two inertias: a coupling below it moves nothing


def shaken(context: Context, joint: int, values: Callable[[Scene, Shape], Floats], load: float = 1.0) -> Make:
    """Return the maker of a family whose load moves otherwise than its encoder says.

    What that does to the other axes goes through the inertia matrix: ``M_ij (a_load - a_measured)``.

    Args:
        context: for the joints that are coupled.
        joint: whose load it is.
        values: effort of that joint, (n,) or (n, k).
        load: share of its inertia that moves otherwise.
    """
    others = _coupled(context, joint)

    def make(scene: Scene, shape: Shape) -> Blocks:
        own = values(scene, shape).reshape(len(scene.motion), -1)
        part = scene.mass[:, :, joint] / (load * scene.inertia(joint))[:, None]
        return [(joint, own), *((k, own * part[:, [k]]) for k in others)]

    return make


def _coupled(context: Context, joint: int) -> list[int]:
    """Return the other joints that feel an acceleration of one."""
    out = []
    for k in range(context.machine.nv):
        size = max(
            float(np.max(np.abs(s.mass[:, k, joint]) / np.sqrt(s.inertia(k) * s.inertia(joint))))
            for s in context.scenes
        )
        if k != joint and size > COUPLED:
            out.append(k)
    return out


def make_context(rows: Rows, base: Base, theta: Floats) -> Context:
    """Return the context of a base model with its coefficients."""
    scenes = tuple(_scene(rows, base, theta, k, motion) for k, motion in enumerate(rows.motions))
    return Context(rows.machine, rows, base, theta, scenes)


def _scene(rows: Rows, base: Base, theta: Floats, log: int, motion: Motion) -> Scene:
    machine = rows.machine
    shape = motion.q.shape
    effort, rigid = np.zeros(shape), np.zeros(shape)
    for joint, where, values in base.columns(motion):
        effort[:, joint] += values @ theta[where]
    at = [isinstance(e, RigidBody) for e in base.effects].index(True)
    beta = theta[effect_slices(base.effects)[at]]
    own = machine.base.regressor(machine.model, motion.q, motion.v, motion.a)
    rigid = own @ beta
    direction, mass = _directions(base, motion), _masses(machine, motion, beta)
    return Scene(log, motion, effort, rigid, direction, mass)


def _directions(base: Base, motion: Motion) -> Floats:
    out = np.zeros(motion.q.shape)
    for joint, name in enumerate(motion.names):
        out[:, joint] = bristles(motion.axis(name), float(base.distance[joint]))[:, 0]
    return out


def _masses(machine: Machine, motion: Motion, beta: Floats) -> Floats:
    """Return M(q) on a thinned grid, interpolated to all samples, shape (n, nv, nv)."""
    n, nv = len(motion), machine.nv
    some = np.unique(np.linspace(0, n - 1, min(n, 400)).astype(int))
    q = motion.q[some]
    zero = np.zeros_like(q)
    still = machine.base.regressor(machine.model, q, zero, zero) @ beta
    columns = []
    for joint in range(nv):
        a = zero.copy()
        a[:, joint] = 1.0
        columns.append(machine.base.regressor(machine.model, q, zero, a) @ beta - still)
    coarse = np.stack(columns, axis=2)
    return np.asarray(make_interp_spline(some, coarse, k=1)(np.arange(n)))
