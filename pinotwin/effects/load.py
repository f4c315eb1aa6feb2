"""What loads an axis: a body on its link, a force from outside, weight along an axis that is tilted."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.batch import inverse, regressor
from pinotwin.dynamics.parameters import BODY_NAMES, BODY_UNITS, joint_axis
from pinotwin.effects.effect import AxisEffect, Coefficient, Columns, Effect, OneAxis
from pinotwin.effects.family import LOAD
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import Tree
from pinotwin.errors import MachineError
from pinotwin.motion import AxisMotion, Motion

TILT = 0.01  # Tilt over which the change of effort is taken [rad]
WIDTHS = (0.05, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0)  # Lengths of a push that are tried [s]


@dataclass(frozen=True)
class OfTree(OneAxis):
    """An effect whose columns need the whole machine: take it from ``machine.effects`` or ``bound(tree)``."""

    tree: Tree | None = field(default=None, compare=False, repr=False, metadata={"internal": True})

    def bound(self, tree: Tree) -> Self:
        return replace(self, tree=tree)

    @property
    def machine(self) -> Tree:
        """The tree; MachineError where the effect is not bound to one."""
        if self.tree is None:
            raise MachineError(
                f"{self.axis}.{self.name} needs its machine: take it from machine.effects or bound(tree)"
            )
        return self.tree


@dataclass(frozen=True)
class Payload(OfTree):
    """A body that rides on the link of an axis: tau = Y(q, v, a) pi.

        pi = [m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]

    Y are the ten inertial columns of that link in Pinocchio's regressor, at every joint that carries it:
    mass, first moments and inertia tensor in the frame of the joint.
    """

    name = "payload"
    family = LOAD
    words = "a mass on the link, as a workpiece or a tool, that the model does not have"
    remedy = "take tool or workpiece off, or add its mass and centre of mass to the link"
    colour = "#76608a"
    linear = tuple(
        Coefficient(x, unit, lower=0.0 if x == "m" else -np.inf)
        for x, unit in zip(BODY_NAMES, BODY_UNITS, strict=True)
    )
    inseparable = ("inertial_coupling",)
    imitates = ("rigid_body", "effort_scale", "inertial_coupling", "offset")
    unlisted = "is a body: add its mass to the <inertial> of the link in the URDF"
    causes = ("inertial_coupling",)

    def columns(self, motion: Motion) -> Columns:
        tree = self.machine
        which: Ints = 10 * (tree.joint(self.axis) - 1) + np.arange(10)
        values = regressor(tree.model, motion.q, motion.v, motion.a, which)
        return Columns(tuple(range(values.shape[1])), values)


@dataclass(frozen=True)
class ExternalForce(AxisEffect):
    """Disturbances from outside: tau = -sum_k f_k sin(pi (t - start_k) / width), for as long as each lasts.

    The sign is that of a load, which the motor need not bring itself.
    """

    name = "external_force"
    family = LOAD
    words = "a force from outside: the process, a hand, a collision"
    remedy = "find out what happened at that time; leave those rows out, or log the force"
    colour = "#d37295"
    imitates = ("position_table", "saturation")
    unlisted = "belongs to a log, not to a machine: log it as a channel, or leave its rows out"
    causes = ("external",)
    searched = 2
    starts: tuple[float, ...] = (0.0,)  # when each begins [s]
    width: float = 0.5  # how long each lasts [s]

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"f{k}", self.unit("F")) for k in range(len(self.starts)))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return a push at every half of its length along every stretch of the log."""
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
class GeometricError(OfTree):
    """An axis that is tilted against the drawing: tau = (d tau_rigid / d tilt) [tilt1, tilt2].

    The two tilts turn the joint's frame about two directions across its axis; the derivative is that of
    the model's inverse dynamics (Pinocchio) at its inertias.
    """

    name = "geometric_error"
    family = LOAD
    title = "Tilted axis"
    words = "an axis is tilted against the drawing"
    remedy = "measure squareness with a dial gauge or a level, and correct the joint's origin in the URDF"
    colour = "#4f5d9e"
    linear = (Coefficient("tilt1", "rad"), Coefficient("tilt2", "rad"))
    imitates = ("rigid_body", "inertial_coupling", "ripple", "position_table")

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return the effect; a lone axis without gravity has no tilt."""
        model = self.machine.model
        return (self,) if model.nv > 1 or np.any(model.gravity.linear) else ()

    def columns(self, motion: Motion) -> Columns:
        tree = self.machine
        path = (motion.q, motion.v, motion.a)
        straight = inverse(tree.model, *path)
        tilted = [inverse(model, *path) for model in _tilted(tree.model, tree.joint(self.axis))]
        values = np.stack([(x - straight) / TILT for x in tilted], axis=2)
        return Columns(tuple(range(values.shape[1])), values)


def _tilted(model: pin.Model, joint: int) -> Sequence[pin.Model]:
    """Return the model with one joint turned by TILT about each of two directions across its axis."""
    out, (_, axis) = [], joint_axis(model, joint)
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    for side in (first, np.cross(axis, first)):
        copy = model.copy()
        turn = pin.SE3(pin.exp3(TILT * side), np.zeros(3))
        copy.jointPlacements[joint] = model.jointPlacements[joint] * turn
        out.append(copy)
    return out
