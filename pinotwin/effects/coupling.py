"""Motor-side effects of a wrist whose last motor turns with two joints (Gautier 1996; Janot 2014).

When one motor's position is the sum of two joints' positions (``J6: {J6: 32, J5: 32}`` in
``transmission``), its inertia and friction act on both joints:

    joint i gets   Ia_m a_j + b_m v_j + c_m sign(v_i + v_j),   joint j the same with i and j exchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import Cause, Coefficient, Columns, Effect, Paired
from pinotwin.effects.family import BODY, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.symbols import effort, length
from pinotwin.effects.tree import HasTree, Tree, others
from pinotwin.motion import Motion

REACH = 2
"""Joints along the arm over which a motor is geared to two of them: the three of a wrist."""


def _reach(tree: Tree, a: str, b: str) -> bool:
    apart = tree.apart(a, b)
    return apart is not None and apart <= REACH


@dataclass(frozen=True)
class WristCoupling(Paired):
    """Inertia and friction of a motor that is geared to two joints at once.

        tau_i = Ia_m a_j + b_m v_j + c_m sign(v_i + v_j),      tau_j the same with i and j exchanged

    Attributes:
        partner: the other joint (``with`` in YAML).
    """

    name: ClassVar[str] = "wrist_coupling"
    family: ClassVar[Family] = BODY
    title: ClassVar[str] = "Wrist coupling"
    words: ClassVar[str] = "turning one axis drags another through the gearing"
    remedy: ClassVar[str] = "check the coupling ratio of the wrist in `transmission`"
    colour: ClassVar[str] = "#3a7d7b"
    contains: ClassVar[tuple[str, ...]] = ("inertial_coupling",)
    imitates: ClassVar[tuple[str, ...]] = ("inertial_coupling", "payload", "rigid_body")
    causes: ClassVar[tuple[Cause, ...]] = ("inertial_coupling", "friction", "friction")
    axis: str
    rotary: bool = True
    partner: str = field(default="", metadata={"yaml": "with"})

    def coefficients(self) -> tuple[Coefficient, ...]:
        f, x = effort(self.rotary), length(self.rotary)
        return (
            Coefficient("Ia_m", f"{f}·s²/{x}", lower=0.0),
            Coefficient("b_m", f"{f}·s/{x}", lower=0.0),
            Coefficient("c_m", f, lower=0.0),
        )

    def terms(self, theta: Floats) -> tuple[float, float, float]:
        return float(theta[0]), float(theta[1]), float(theta[2])

    @classmethod
    def candidates(cls, machine: HasTree, axis: str, motion: Motion) -> tuple[Effect, ...]:
        """See :meth:`Effect.candidates`: with rotary axes so near that a gear can reach, where both move."""
        tree = Tree.of(machine)
        turns = dict(zip(tree.names, tree.rotary, strict=True))
        partners = [x for x in others(tree.names, axis) if turns[x] and turns[axis] and _reach(tree, axis, x)]
        if not Sight.of(motion, axis).moves:
            return ()
        return tuple(cls(axis, True, partner=x) for x in partners if Sight.of(motion, x).moves)

    def columns(self, motion: Motion) -> Columns:
        own, other = motion.axis(self.axis), motion.axis(self.partner)
        slide = motion.passed(np.sign(own.v + other.v))
        values = np.stack(
            [
                np.stack([other.a, other.v, slide], axis=-1),
                np.stack([own.a, own.v, slide], axis=-1),
            ],
            axis=1,
        )
        return Columns((own.index, other.index), values)
