"""The multibody dynamics of the whole machine, linear in its base parameters (thesis Eq. 3.7, 3.17).

    tau = M(q) a + h(q, v) = W_b(q, v, a) beta,      beta = P pi

``pi`` are the ten inertial parameters of every link and the rotor inertias; ``P`` regroups them into the
smallest set that the motion can show (Gautier & Khalil 1990, 10.1109/70.56655).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pinotwin.dynamics.base import BaseParameters
from pinotwin.effects.effect import Cause, Coefficient, Columns, Effect
from pinotwin.motion import Motion

if TYPE_CHECKING:
    import pinocchio as pin


@dataclass(frozen=True, eq=False)
class RigidBody(Effect):
    """Inertia, coupling, Coriolis, centrifugal and gravity efforts of the tree.

    Attributes:
        model: the tree.
        base: its base parameters.
    """

    name: ClassVar[str] = "rigid_body"
    causes: ClassVar[tuple[Cause, ...]] = ("rigid_body",)
    model: pin.Model
    base: BaseParameters

    axis: str | None = None  # it belongs to the whole machine

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`."""
        pairs = zip(self.base.names, self.base.units, strict=True)
        return tuple(Coefficient(name, unit) for name, unit in pairs)

    def columns(self, motion: Motion) -> Columns:
        """See :meth:`Effect.columns`."""
        values = self.base.regressor(self.model, motion.q, motion.v, motion.a)
        return Columns(tuple(range(self.model.nv)), values)
