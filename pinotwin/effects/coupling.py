"""Motor-side effects of a wrist whose last motor turns with two joints (Gautier 1996; Janot 2014).

When one motor's position is the sum of two joints' positions (``J6: {J6: 32, J5: 32}`` in
``transmission``), its inertia and friction act on both joints:

    joint i gets   Ia_m a_j + b_m v_j + c_m sign(v_i + v_j),   joint j the same with i and j exchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pinotwin.effects.effect import Cause, Coefficient, Columns, Effect
from pinotwin.effects.symbols import effort, length
from pinotwin.motion import Motion


@dataclass(frozen=True)
class WristCoupling(Effect):
    """Inertia and friction of a motor that is geared to two joints at once.

    Attributes:
        partner: the other joint (``with`` in YAML).
    """

    name: ClassVar[str] = "wrist_coupling"
    causes: ClassVar[tuple[Cause, ...]] = ("inertial_coupling", "friction", "friction")
    axis: str
    rotary: bool = True
    partner: str = field(default="", metadata={"yaml": "with"})

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        f, x = effort(self.rotary), length(self.rotary)
        return (
            Coefficient("Ia_m", f"{f}·s²/{x}", lower=0.0),
            Coefficient("b_m", f"{f}·s/{x}", lower=0.0),
            Coefficient("c_m", f, lower=0.0),
        )

    def columns(self, motion: Motion) -> Columns:
        """See :meth:`Effect.columns`."""
        own, other = motion.axis(self.axis), motion.axis(self.partner)
        slide = np.sign(own.v + other.v)
        values = np.stack(
            [
                np.stack([other.a, other.v, slide], axis=-1),
                np.stack([own.a, own.v, slide], axis=-1),
            ],
            axis=1,
        )
        return Columns((own.index, other.index), values)
