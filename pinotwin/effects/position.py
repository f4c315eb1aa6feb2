"""Efforts that depend on position alone: weight, spring, cables, guideways (thesis Eq. 3.11); ripple apart."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.effects.effect import AxisEffect, Coefficient, Effect, usual
from pinotwin.effects.family import POSITION
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import TURN, Tree
from pinotwin.errors import MachineError
from pinotwin.motion import AxisMotion, Motion

KNOTS = (6, 10, 16, 24)
"""Knots of the tables that are tried on a travel: a short log passes each of many too seldom to tell its height."""


@dataclass(frozen=True)
class Offset(AxisEffect):
    """A constant effort: current offset, or the pull of a counterbalance: tau = f0."""

    name = "offset"
    family = POSITION
    title = "Constant effort"
    words = "a constant force: weight, counterbalance, current offset"
    remedy = "check counterbalance and brake, and the drive's current offset"
    colour = "#a05195"
    linear = (Coefficient("f0", "F"),)
    inseparable = ("coulomb_asymmetric",)
    imitates = ("viscous_asymmetric", "rigid_body", "position_table")
    causes = ("position",)
    depends = "position"

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return np.ones((len(motion.q), 1))


@dataclass(frozen=True)
class Spring(AxisEffect):
    """Linear spring and damper, as of a passive joint (thesis Eq. 5.4): tau = k q + c v."""

    name = "spring"
    family = POSITION
    words = "a spring between two parts: cable, hose, flexure"
    remedy = "check cables, hoses and covers that are stretched along the travel"
    colour = "#6b8e23"
    linear = (Coefficient("k", "F/x", lower=0.0), Coefficient("c", "F·s/x", lower=0.0))
    contains = ("viscous",)
    imitates = ("position_table", "rigid_body", "hysteresis")
    causes = ("stiffness", "viscous")
    rotary: bool = True

    def axis_columns(self, motion: AxisMotion) -> Floats:
        return np.stack([motion.q, motion.v], axis=-1)


@dataclass(frozen=True)
class PositionTable(AxisEffect):
    """Any repeatable effort of position, as a table with linear interpolation (thesis Eq. 3.11).

        tau = sum_k m_k max(0, 1 - |p_k - q| / spacing)

    The knots cover the travel that the effect was fitted to; beyond it the last value holds. On an axis
    without stops the effort repeats with every turn, and so do the knots once the log makes a whole one.

    Attributes:
        spacing: distance of the knots [m or rad]; 1 mm or 1 degree when not given.
        start: position of the first knot; taken from the log when not given.
        stop: position of the last knot.
    """

    name = "position_table"
    family = POSITION
    title = "Effort along the travel"
    words = "a force that depends on the place along the travel: guideway, cable, cover"
    remedy = "look at guideway, cable carrier and cover where the curve peaks"
    colour = "#9c755f"
    contains = ("offset",)
    imitates = ("ripple", "ripple_modulated", "spring", "geometric_error")
    searched = 1  # how many knots
    held = True
    local = True
    causes = ("position",)
    depends = "position"
    spacing: float = usual(1e-3, float(np.deg2rad(1.0)))
    start: float | None = None
    stop: float | None = None
    endless: bool = field(default=False, compare=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spacing <= 0.0:
            raise MachineError(
                f"axes.{self.axis}: position_table spacing must be positive, not {self.spacing}"
            )

    def bound(self, tree: Tree) -> Self:
        return replace(self, endless=tree.endless(self.axis))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return tables over the travel, coarse ones and a fine one."""
        travel = min(sight.travel, TURN)
        return tuple(replace(self, spacing=travel / (count - 1)) for count in KNOTS)

    def fitted_to(self, motion: Motion) -> Self:
        """Return the table with its knots laid over the travel of this motion."""
        if self.start is not None and self.stop is not None:
            return self
        q = motion.axis(self.axis).q
        if self.endless and np.ptp(q) > TURN - self.spacing:
            spacing = TURN / max(round(TURN / self.spacing), 3)
            return replace(self, spacing=spacing, start=0.0, stop=TURN - spacing)
        start = float(np.floor(q.min() / self.spacing)) * self.spacing
        count = max(int(np.ceil((float(q.max()) - start) / self.spacing)), 1)
        if count > 5000:
            raise MachineError(
                f"axes.{self.axis}: position_table of {count} knots; make `spacing` larger than "
                f"{self.spacing:g} (travel {np.ptp(q):g})"
            )
        return replace(self, start=start, stop=start + count * self.spacing)

    def known(self, motion: Motion) -> Mask:
        """Return the samples between its first and its last knot, by one spacing."""
        if self.endless or self.start is None or self.stop is None:
            return super().known(motion)
        q = motion.axis(self.axis).q
        return np.asarray((q >= self.start - self.spacing) & (q <= self.stop + self.spacing))

    @property
    def knots(self) -> Floats:
        """Positions p_k of the knots [m or rad], shape (p,)."""
        if self.start is None or self.stop is None:
            return np.zeros(0)
        count = round((self.stop - self.start) / self.spacing) + 1
        return np.linspace(self.start, self.stop, count)

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"m{k}", self.unit("F")) for k in range(len(self.knots)))

    def axis_columns(self, motion: AxisMotion) -> Floats:
        knots, q = self.knots, motion.q
        count = len(knots)
        closed = self.endless and count * self.spacing > TURN - 1e-6 * self.spacing
        if closed:  # the knots close a circle
            place = np.mod(q - knots[0], TURN) / self.spacing
        else:
            if self.endless:
                q = q - TURN * np.round((q - 0.5 * (knots[0] + knots[-1])) / TURN)
            place = np.clip((q - knots[0]) / self.spacing, 0.0, count - 1)
        below = np.minimum(place.astype(int), count - 1 if closed else count - 2)
        share, rows = place - below, np.arange(len(q))
        out = np.zeros((len(q), count))
        out[rows, below] = 1.0 - share
        out[rows, (below + 1) % count] += share
        return out
