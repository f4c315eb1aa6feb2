"""What one axis does to another: shared inertia, and the motor of a wrist that turns with two joints.

Of a motor whose position is the sum of two joints' (``J6: {J6: 32, J5: 32}`` in ``transmission``), inertia and
friction act on both joints (Gautier 1996; Janot 2014).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pinotwin.effects.effect import Coefficient, Paired
from pinotwin.effects.family import BODY
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import HasTree, Tree
from pinotwin.motion import Motion


@dataclass(frozen=True)
class InertialCoupling(Paired):
    """Inertia that two axes share: tau_i = J a_j, tau_j = J a_i."""

    name = "inertial_coupling"
    family = BODY
    words = "another axis' acceleration drives this one more than modelled"
    remedy = "check the centre of mass of what both axes move; move one axis alone and watch the other"
    colour = "#2fa6a0"
    linear = (Coefficient("J", "I"),)
    inseparable = ("payload",)
    imitates = ("payload", "rigid_body", "wrist_coupling", "geometric_error")
    causes = ("inertial_coupling",)


@dataclass(frozen=True)
class WristCoupling(Paired):
    """Inertia and friction of a motor that is geared to two joints at once.

    tau_i = Ia_m a_j + b_m v_j + c_m sign(v_i + v_j),      tau_j the same with i and j exchanged
    """

    name = "wrist_coupling"
    family = BODY
    words = "turning one axis drags another through the gearing"
    remedy = "check the coupling ratio of the wrist in `transmission`"
    colour = "#3a7d7b"
    linear = (
        Coefficient("Ia_m", "F·s²/x", lower=0.0),
        Coefficient("b_m", "F·s/x", lower=0.0),
        Coefficient("c_m", "F", lower=0.0),
    )
    contains = ("inertial_coupling",)
    imitates = ("inertial_coupling", "payload", "rigid_body")
    causes = ("inertial_coupling", "friction", "friction")
    rotary: bool = True

    @classmethod
    def candidates(cls, machine: HasTree, axis: str, motion: Motion) -> tuple[Self, ...]:
        """Return those with moving rotary axes within reach of a gear: two joints along the arm, as in a wrist."""
        tree = Tree.of(machine)
        if not (Sight.of(motion, axis).moves and tree.rotary[tree.index(axis)]):
            return ()
        every = super().candidates(machine, axis, motion)
        turning = [e for e in every if tree.rotary[tree.index(e.partner)]]
        return tuple(e for e in turning if (tree.apart(axis, e.partner) or np.inf) <= 2)
