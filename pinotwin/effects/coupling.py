"""What one axis does to another: shared inertia, and the motor of a wrist that turns with two joints.

When one motor's position is the sum of two joints' positions (``J6: {J6: 32, J5: 32}`` in ``transmission``), its
inertia and friction act on both joints (Gautier 1996; Janot 2014):

    joint i gets   Ia_m a_j + b_m v_j + c_m sign(v_i + v_j),   joint j the same with i and j exchanged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Coefficient, Columns, Paired
from pinotwin.effects.family import BODY
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import HasTree, Tree
from pinotwin.motion import Motion


@dataclass(frozen=True)
class InertialCoupling(Paired):
    """Inertia that two axes share: tau_i = J a_j, tau_j = J a_i."""

    name = "inertial_coupling"
    family = BODY
    title = "Inertial coupling"
    words = "another axis' acceleration drives this one more than modelled"
    remedy = "check the centre of mass of what both axes move; move one axis alone and watch the other"
    colour = "#2fa6a0"
    inseparable = ("payload",)
    imitates = ("payload", "rigid_body", "wrist_coupling", "geometric_error")
    causes = ("inertial_coupling",)

    def coefficients(self) -> tuple[Coefficient, ...]:
        """Return J; between a slide and a rotation its unit is that of kg·m."""
        return (Coefficient("J", self.unit("I")),)

    def terms(self, theta: Floats) -> tuple[float, float, float]:
        return float(theta[0]), 0.0, 0.0

    def columns(self, motion: Motion) -> Columns:
        own, other = motion.axis(self.axis), motion.axis(self.partner)
        values = np.stack([other.a, own.a], axis=1)[:, :, None]
        return Columns((own.index, other.index), values)


@dataclass(frozen=True)
class WristCoupling(Paired):
    """Inertia and friction of a motor that is geared to two joints at once.

    tau_i = Ia_m a_j + b_m v_j + c_m sign(v_i + v_j),      tau_j the same with i and j exchanged
    """

    name = "wrist_coupling"
    family = BODY
    title = "Wrist coupling"
    words = "turning one axis drags another through the gearing"
    remedy = "check the coupling ratio of the wrist in `transmission`"
    colour = "#3a7d7b"
    contains = ("inertial_coupling",)
    imitates = ("inertial_coupling", "payload", "rigid_body")
    causes = ("inertial_coupling", "friction", "friction")
    rotary: bool = True

    def coefficients(self) -> tuple[Coefficient, ...]:
        units = {"Ia_m": "F·s²/x", "b_m": "F·s/x", "c_m": "F"}
        return tuple(Coefficient(name, self.unit(unit), lower=0.0) for name, unit in units.items())

    def terms(self, theta: Floats) -> tuple[float, float, float]:
        return float(theta[0]), float(theta[1]), float(theta[2])

    @classmethod
    def candidates(cls, machine: HasTree, axis: str, motion: Motion) -> tuple[Self, ...]:
        """Return those with rotary axes so near that a gear can reach, where both move.

        A gear reaches over two joints along the arm: the three of a wrist.
        """
        tree = Tree.of(machine)
        if not (Sight.of(motion, axis).moves and tree.rotary[tree.index(axis)]):
            return ()
        every = super().candidates(machine, axis, motion)
        turning = [e for e in every if tree.rotary[tree.index(e.partner)]]
        return tuple(e for e in turning if (tree.apart(axis, e.partner) or np.inf) <= 2)

    def columns(self, motion: Motion) -> Columns:
        own, other = motion.axis(self.axis), motion.axis(self.partner)
        slide = motion.passed(np.sign(own.v + other.v))
        values = np.stack([np.stack([x.a, x.v, slide], axis=-1) for x in (other, own)], axis=1)
        return Columns((own.index, other.index), values)
