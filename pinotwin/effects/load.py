"""What hangs on the machine and pushes it: payloads, pushes from outside, coupled inertia, tilted axes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.batch import inverse, regressor
from pinotwin.dynamics.parameters import BODY_NAMES, BODY_UNITS
from pinotwin.effects.effect import AxisEffect, Cause, Coefficient, Columns, Effect, Paired
from pinotwin.effects.family import BODY, LOAD, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.symbols import effort, inertia
from pinotwin.effects.tree import HasTree, Tree, others
from pinotwin.errors import MachineError
from pinotwin.motion import AxisMotion, Motion

TILT = 0.01
"""Tilt over which the change of effort is taken [rad]."""
WIDTHS = (0.05, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0)
"""Lengths of a push that are tried [s]."""


def _tree(effect: Effect, tree: Tree | None) -> Tree:
    if tree is None:
        raise MachineError(
            f"{effect.axis}.{effect.name} needs its machine: take it from machine.effects or bound(tree)"
        )
    return tree


@dataclass(frozen=True)
class Payload(Effect):
    """A body that rides on the link of an axis: tau = Y(q, v, a) pi.

        pi = [m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]

    Y are the ten inertial columns of that link in Pinocchio's regressor, at every joint that carries it:
    mass, first moments and inertia tensor in the frame of the joint.
    """

    name: ClassVar[str] = "payload"
    family: ClassVar[Family] = LOAD
    title: ClassVar[str] = "Payload"
    words: ClassVar[str] = "a mass on the link, as a workpiece or a tool, that the model does not have"
    remedy: ClassVar[str] = "take tool or workpiece off, or add its mass and centre of mass to the link"
    colour: ClassVar[str] = "#76608a"
    inseparable: ClassVar[tuple[str, ...]] = ("inertial_coupling",)
    imitates: ClassVar[tuple[str, ...]] = ("rigid_body", "effort_scale", "inertial_coupling", "offset")
    unlisted: ClassVar[str] = "is a body: add its mass to the <inertial> of the link in the URDF"
    causes: ClassVar[tuple[Cause, ...]] = ("inertial_coupling",)
    axis: str
    rotary: bool = False
    tree: Tree | None = field(default=None, compare=False, repr=False, metadata={"internal": True})

    def bound(self, tree: Tree) -> Self:
        return replace(self, tree=tree)

    def coefficients(self) -> tuple[Coefficient, ...]:
        pairs = zip(BODY_NAMES, BODY_UNITS, strict=True)
        return tuple(Coefficient(x, unit, lower=0.0 if x == "m" else -np.inf) for x, unit in pairs)

    def columns(self, motion: Motion) -> Columns:
        """See :meth:`Effect.columns`; the regressor has none for joints that do not carry the link."""
        tree = _tree(self, self.tree)
        first = 10 * (tree.joint(self.axis) - 1)
        which: Ints = np.arange(first, first + 10)
        values = regressor(tree.model, motion.q, motion.v, motion.a, which)
        return Columns(tuple(range(values.shape[1])), values)


@dataclass(frozen=True)
class InertialCoupling(Paired):
    """Inertia that two axes share: tau_i = J a_j, tau_j = J a_i.

    Attributes:
        partner: the other axis (``with`` in YAML).
    """

    name: ClassVar[str] = "inertial_coupling"
    family: ClassVar[Family] = BODY
    title: ClassVar[str] = "Inertial coupling"
    words: ClassVar[str] = "another axis' acceleration drives this one more than modelled"
    remedy: ClassVar[str] = (
        "check the centre of mass of what both axes move; move one axis alone and watch the other"
    )
    colour: ClassVar[str] = "#2fa6a0"
    inseparable: ClassVar[tuple[str, ...]] = ("payload",)
    imitates: ClassVar[tuple[str, ...]] = ("payload", "rigid_body", "wrist_coupling", "geometric_error")
    causes: ClassVar[tuple[Cause, ...]] = ("inertial_coupling",)
    axis: str
    rotary: bool = False
    partner: str = field(default="", metadata={"yaml": "with"})

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`; between a slide and a rotation the unit is that of kg·m."""
        return (Coefficient("J", inertia(self.rotary)),)

    def terms(self, theta: Floats) -> tuple[float, float, float]:
        return float(theta[0]), 0.0, 0.0

    @classmethod
    def candidates(cls, machine: HasTree, axis: str, motion: Motion) -> tuple[Effect, ...]:
        """See :meth:`Effect.candidates`: with every other axis that moves."""
        names, rotary = tuple(machine.names), tuple(machine.rotary)
        turns = rotary[names.index(axis)]
        moving = [other for other in others(names, axis) if Sight.of(motion, other).moves]
        return tuple(cls(axis, turns, partner=other) for other in moving)

    def columns(self, motion: Motion) -> Columns:
        own, other = motion.axis(self.axis), motion.axis(self.partner)
        values = np.stack([other.a, own.a], axis=1)[:, :, None]
        return Columns((own.index, other.index), values)


@dataclass(frozen=True)
class ExternalForce(AxisEffect):
    """Pushes from outside: tau = -sum_k f_k sin(pi (t - start_k) / width), for as long as each lasts.

    The sign is that of a load, which the motor need not bring itself.

    Attributes:
        starts: when each begins [s].
        width: how long each lasts [s].
    """

    name: ClassVar[str] = "external_force"
    family: ClassVar[Family] = LOAD
    title: ClassVar[str] = "External force"
    words: ClassVar[str] = "a force from outside: the process, a hand, a collision"
    remedy: ClassVar[str] = "ask what happened at that time; leave those rows out, or log the force"
    colour: ClassVar[str] = "#d37295"
    imitates: ClassVar[tuple[str, ...]] = ("position_table", "saturation")
    unlisted: ClassVar[str] = "belongs to a log, not to a machine: log it as a channel, or leave its rows out"
    causes: ClassVar[tuple[Cause, ...]] = ("external",)
    searched: ClassVar[int] = 2
    axis: str
    rotary: bool = False
    starts: tuple[float, ...] = (0.0,)
    width: float = 0.5

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"f{k}", effort(self.rotary)) for k in range(len(self.starts)))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: every half length of a push along every stretch of the log."""
        found: list[Effect] = []
        for part, width in itertools.product(motion.segments, WIDTHS):
            t = motion.t[part]
            if len(t) > 2 and 4.0 * sight.step < width < 0.5 * (t[-1] - t[0]):
                starts = np.arange(t[0], t[-1] - width, 0.5 * width)
                found += [replace(self, starts=(float(x),), width=width) for x in starts]
        return tuple(found)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        x = (motion.t[:, None] - np.asarray(self.starts)) / self.width
        return -np.where((x > 0.0) & (x < 1.0), np.sin(np.pi * x), 0.0)


@dataclass(frozen=True)
class GeometricError(Effect):
    """An axis that is tilted against the drawing: tau = (d tau_rigid / d tilt) [tilt1, tilt2].

    The two tilts turn the joint's frame about two directions across its axis; the derivative is that of
    the model's inverse dynamics (Pinocchio) at its inertias.
    """

    name: ClassVar[str] = "geometric_error"
    family: ClassVar[Family] = LOAD
    title: ClassVar[str] = "Tilted axis"
    words: ClassVar[str] = "an axis is tilted against the drawing"
    remedy: ClassVar[str] = (
        "measure squareness with a dial gauge or a level, and correct the joint's origin in the URDF"
    )
    colour: ClassVar[str] = "#4f5d9e"
    imitates: ClassVar[tuple[str, ...]] = ("rigid_body", "inertial_coupling", "ripple", "position_table")
    causes: ClassVar[tuple[Cause, ...]] = ("other",)
    axis: str
    rotary: bool = False
    tree: Tree | None = field(default=None, compare=False, repr=False, metadata={"internal": True})

    def bound(self, tree: Tree) -> Self:
        return replace(self, tree=tree)

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("tilt1", "rad"), Coefficient("tilt2", "rad"))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """See :meth:`Effect.trials`: a lone axis without gravity has no tilt."""
        del motion, sight
        model = _tree(self, self.tree).model
        return (self,) if model.nv > 1 or np.any(model.gravity.linear) else ()

    def columns(self, motion: Motion) -> Columns:
        tree = _tree(self, self.tree)
        path = (motion.q, motion.v, motion.a)
        straight = inverse(tree.model, *path)
        tilted = [inverse(model, *path) for model in _tilted(tree.model, tree.joint(self.axis))]
        values = np.stack([(x - straight) / TILT for x in tilted], axis=2)
        return Columns(tuple(range(values.shape[1])), values)


def _tilted(model: pin.Model, joint: int) -> Sequence[pin.Model]:
    """Return the model with one joint turned by TILT about each of two directions across its axis."""
    out = []
    for side in _across(_direction(model, joint)):
        copy = model.copy()
        turn = pin.SE3(pin.exp3(TILT * side), np.zeros(3))
        copy.jointPlacements[joint] = model.jointPlacements[joint] * turn
        out.append(copy)
    return out


def _direction(model: pin.Model, joint: int) -> Floats:
    """Return the direction of a joint in its own frame, a unit vector."""
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, np.zeros(model.joints[joint].nq), np.zeros(model.joints[joint].nv))
    S = np.asarray(data.S).reshape(6)
    axis = S[:3] if np.linalg.norm(S[:3]) > 0.5 else S[3:]
    return np.asarray(axis / np.linalg.norm(axis))


def _across(direction: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors across a direction."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
