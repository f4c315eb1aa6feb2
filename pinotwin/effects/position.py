"""Efforts that depend on position alone: weight, spring, cables, guideways (thesis Eq. 3.11); ripple apart."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.effect import AxisEffect, Coefficient, Effect, usual
from pinotwin.effects.family import POSITION
from pinotwin.effects.ripple import waves
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
    """Any repeatable effort of position (thesis Eq. 3.11), as a smooth function with a prior.

        tau = sum_k m_k B(q / spacing - k) + sum_j a_j cos(2 pi q / pitch_j) + b_j sin(2 pi q / pitch_j)

    Before the data the first sum, of cubic B-splines B, is a mean plus a Matern-3/2 process: it is smooth, and fades to
    its mean where no log has been, as uncertain there as it is large. Its knots cover the travel of the joint; beyond
    it the last value holds. On an axis without stops the effort repeats with every turn, and so do the knots once the
    log makes a whole one.
    """

    most: ClassVar[int] = 100
    """Intervals that a travel is cut into at most: each costs a column."""

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
    local = pointwise = True
    causes = ("position",)
    depends = "position"
    # distance of the knots [m or rad]; 1 mm or 1 degree when not given, more on a long travel
    spacing: float = usual(1e-3, float(np.deg2rad(1.0)))
    start: float | None = None  # position of the first knot; taken from the joint and the log when not given
    stop: float | None = None  # position of the last knot
    # standard deviation of the process [N or N·m]; found in the log when not given
    amplitude: float | None = None
    length: float | None = None  # how far its values are alike [m or rad]; found in the log when not given
    # rows of the log that tell as much as an independent one [1]; found in the log when not given
    alike: float = 1.0
    # of what repeats [m or rad], such as pole pairs; others that the log shows are added
    pitches: tuple[float, ...] = ()
    endless: bool = field(default=False, compare=False, metadata={"internal": True})
    limits: tuple[float, float] = field(default=(-np.inf, np.inf), compare=False, metadata={"internal": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "pitches", tuple(map(float, self.pitches)))
        for word, x in (("spacing", self.spacing), *(("pitch", x) for x in self.pitches)):
            if x <= 0.0:
                raise MachineError(f"axes.{self.axis}: position_table {word} must be positive, not {x}")

    def bound(self, tree: Tree) -> Self:
        at = tree.index(self.axis)
        limits = (float(tree.model.lowerPositionLimit[at]), float(tree.model.upperPositionLimit[at]))
        return replace(self, endless=tree.endless(self.axis), limits=limits)

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return tables over the travel of the motion, coarse ones and a fine one."""
        travel, start = min(sight.travel, TURN), float(motion.axis(self.axis).q.min())
        return tuple(replace(self, spacing=travel / (n - 1), start=start, stop=start + travel) for n in KNOTS)

    def fitted_to(self, motion: Motion) -> Self:
        """Return the table with its knots laid over the travel of the joint, at most one more beside the motion's."""
        if self.start is not None and self.stop is not None:
            return self
        q = motion.axis(self.axis).q
        if self.endless and np.ptp(q) > TURN - self.spacing:
            spacing = TURN / max(round(TURN / max(self.spacing, TURN / self.most)), 3)
            return replace(self, spacing=spacing, start=0.0, stop=TURN - spacing)
        low, high, span = float(q.min()), float(q.max()), max(float(np.ptp(q)), self.spacing)
        low, high = min(low, max(self.limits[0], low - span)), max(high, min(self.limits[1], high + span))
        spacing = max(self.spacing, (high - low) / self.most)
        start = float(np.floor(low / spacing)) * spacing
        return replace(self, spacing=spacing, start=start, stop=float(np.ceil(high / spacing)) * spacing)

    @property
    def closed(self) -> bool:
        """Whether the knots close a circle."""
        return self.endless and len(self.knots) * self.spacing > TURN - 1e-6 * self.spacing

    def belief(self) -> tuple[Floats, float] | None:
        if self.amplitude is None or self.length is None:
            return None
        P = self.alike * stiffness(len(self.knots), self.spacing, self.length, closed=self.closed)
        B = np.linalg.cholesky(P / self.amplitude**2).T
        return np.pad(B, ((0, 0), (0, 2 * len(self.pitches)))), self.alike

    @property
    def knots(self) -> Floats:
        """Positions p_k of the knots [m or rad], shape (p,)."""
        if self.start is None or self.stop is None:
            return np.zeros(0)
        count = round((self.stop - self.start) / self.spacing) + 1
        return np.linspace(self.start, self.stop, count)

    def coefficients(self) -> tuple[Coefficient, ...]:
        labels = [f"m{k}" for k in range(len(self.knots))]
        labels += [f"{w}{k + 1}" for k in range(len(self.pitches)) for w in "ab"]
        return tuple(Coefficient(label, self.unit("F")) for label in labels)

    def axis_columns(self, motion: AxisMotion) -> Floats:
        knots, q = self.knots, motion.q
        count, closed = len(knots), self.closed
        if closed:
            place = np.mod(q - knots[0], TURN) / self.spacing
        else:
            if self.endless:
                q = q - TURN * np.round((q - 0.5 * (knots[0] + knots[-1])) / TURN)
            place = np.clip((q - knots[0]) / self.spacing, 0.0, count - 1)
        below = np.minimum(place.astype(int), count - 1 if closed else count - 2)
        y, rows = place - below, np.arange(len(q))
        parts = ((1 - y) ** 3, 3 * y**3 - 6 * y**2 + 4, -3 * y**3 + 3 * y**2 + 3 * y + 1, y**3)
        out = np.zeros((len(q), count + 2))  # with a knot beside either end
        for k, part in enumerate(parts):
            out[rows, (below + k - 1) % count + 1 if closed else below + k] += part / 6.0
        if not closed:  # the knots go on in a straight line: it ends without curvature
            out[:, 1:3] += np.outer(out[:, 0], (2.0, -1.0))
            out[:, -3:-1] += np.outer(out[:, -1], (-1.0, 2.0))
        return np.hstack([out[:, 1:-1], *(waves(q, pitch, (1,)) for pitch in self.pitches)])


def stiffness(count: int, spacing: float, length: float, *, closed: bool, free: float = 30.0) -> Floats:
    """Return the precision of a table's coefficients of amplitude one about a mean that is free, (count, count).

        k^4 h 1 + 2 k^2 D1'D1 / h + D2'D2 / h^3 over 4 k^3,   k = sqrt(3) / length

    is that of a Matern-3/2 process (Whittle 1954: its spectrum is the square of 1 / (k^2 + w^2)); the mean has a
    standard deviation of ``free`` amplitudes.
    """
    k, one = np.sqrt(3.0) / length, np.eye(count)
    if closed:
        first = np.roll(one, -1, 0) - one
        second = np.roll(one, -1, 0) - 2.0 * one + np.roll(one, 1, 0)
    else:
        first, second = np.diff(one, axis=0), np.diff(one, 2, axis=0)
    P = k**4 * spacing * one + 2.0 * k**2 * first.T @ first / spacing + second.T @ second / spacing**3
    P /= 4.0 * k**3
    pull = P.sum(axis=1)
    return np.asarray(P - np.outer(pull, pull) / (pull.sum() + 1.0 / free**2))
