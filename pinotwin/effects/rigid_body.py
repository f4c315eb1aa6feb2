"""Bodies and their coupling: the multibody dynamics, linear in its base parameters (thesis Eq. 3.7, 3.17).

    tau = M(q) a + h(q, v) = W_b(q, v, a) beta,      beta = P pi

``pi`` are the ten inertial parameters of every link and the rotor inertias; ``P`` regroups them into the
smallest set that the motion can show (Gautier & Khalil 1990, 10.1109/70.56655). Beside it, what one axis does to
another: shared inertia, and inertia and friction of a motor whose position is the sum of two joints'
(``J6: {J6: 32, J5: 32}`` in ``transmission``), which act on both (Gautier 1996; Janot 2014).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.base import BaseParameters
from pinotwin.dynamics.batch import inverse
from pinotwin.dynamics.parameters import parameters, with_parameters
from pinotwin.effects.effect import Coefficient, Columns, Effect, Paired
from pinotwin.effects.family import BODY
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import HasTree, Tree
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
    pointwise = True
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

    def along(self, motion: Motion, theta: Floats, block: int = 1 << 12) -> Floats:
        if np.ndim(theta) > 1:
            return Effect.along(self, motion, theta, block)
        return self.effort(theta, motion.q, motion.v, motion.a)  # by Newton-Euler

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
