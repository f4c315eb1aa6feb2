"""The multibody dynamics of the whole machine, linear in its base parameters (thesis Eq. 3.7, 3.17).

    tau = M(q) a + h(q, v) = W_b(q, v, a) beta,      beta = P pi

``pi`` are the ten inertial parameters of every link and the rotor inertias; ``P`` regroups them into the
smallest set that the motion can show (Gautier & Khalil 1990, 10.1109/70.56655).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.base import BaseParameters
from pinotwin.dynamics.batch import inverse
from pinotwin.dynamics.parameters import parameters, with_parameters
from pinotwin.effects.effect import Coefficient, Columns, Effect
from pinotwin.effects.family import BODY
from pinotwin.errors import MachineError
from pinotwin.motion import Motion

CHECKED, SAME = 32, 1e-11
"""Rows on which Newton-Euler is held against the regressor, and the share of the largest by which it may differ."""


@dataclass(frozen=True, eq=False)
class RigidBody(Effect):
    """Inertia, coupling, Coriolis, centrifugal and gravity efforts of the tree: tau = W_b(q, v, a) beta."""

    name = "rigid_body"
    family = BODY
    title = "Rigid bodies"
    words = "mass, inertia or centre of mass differs from what the model holds"
    remedy = "compare masses and centres of mass with the drawing; identify again"
    colour = "#4e79a7"
    imitates = ("payload", "inertial_coupling", "wrist_coupling", "effort_scale")
    unlisted = "belongs to every machine; leave it out of the list"
    causes = ("rigid_body",)
    model: pin.Model
    base: BaseParameters
    axis: str | None = None  # it belongs to the whole machine

    def coefficients(self) -> tuple[Coefficient, ...]:
        pairs = zip(self.base.names, self.base.units, strict=True)
        return tuple(Coefficient(name, unit) for name, unit in pairs)

    def labels(self) -> tuple[str, ...]:
        """Return short ones, whose sums of standard parameters are their meaning."""
        return self.base.labels

    def nominal(self) -> Floats:
        """Return the base parameters of the description, shape (b,)."""
        return self.base.from_standard(parameters(self.model))

    def columns(self, motion: Motion) -> Columns:
        values = self.base.regressor(self.model, motion.q, motion.v, motion.a)
        return Columns(tuple(range(self.model.nv)), values)

    def effort(self, beta: Floats, q: Floats, v: Floats, a: Floats, block: int = 20_000) -> Floats:
        """Return W_b(q, v, a) beta, shape (n, nv) [N or N·m], with ``block`` rows of a regressor held at once.

        Newton-Euler costs a fifth of the regressor, but loses digits of nearly massless bodies: some rows are tried.
        """
        fast = inverse(self.model_with(beta), q, v, a)
        few = np.linspace(0, max(len(q) - 1, 0), min(len(q), CHECKED)).astype(int)
        exact = self.base.regressor(self.model, q[few], v[few], a[few]) @ beta
        if np.abs(fast[few] - exact).max(initial=0.0) <= SAME * np.abs(exact).max(initial=0.0):
            return fast
        parts = (slice(k, k + block) for k in range(0, len(q), block))
        return np.concatenate([self.base.regressor(self.model, q[s], v[s], a[s]) @ beta for s in parts])

    def model_with(self, beta: Floats) -> pin.Model:
        """Return the tree with standard parameters near its own that have these base parameters; itself if none can."""
        pi = parameters(self.model)
        try:
            near = pi + np.linalg.pinv(self.base.P) @ (np.asarray(beta) - self.base.P @ pi)
            return with_parameters(self.model, near)
        except (MachineError, ValueError, RuntimeError):
            return self.model
