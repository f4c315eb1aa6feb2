"""The protocol of an effect: one physical cause of joint effort, linear in its coefficients.

    effort = sum over effects of columns(motion; shape) @ theta            [N or N·m]

``theta`` are the linear coefficients that least squares finds; ``shape`` the few numbers inside a
column (a Stribeck speed, a ripple pitch) that a bounded search finds. An effect never stores what was
found: it states the equation. A new effect is one small final class with ``coefficients`` and
``columns`` (or ``axis_columns``), listed once in the table of :mod:`pinotwin.effects`.

Effects are frozen dataclasses. Their fields are what the YAML may set.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.motion import AxisMotion, Motion

Cause = Literal["stiffness", "viscous", "friction", "position", "inertial_coupling", "rigid_body", "other"]
Depends = Literal["position", "velocity", "direction", "displacement", "other"]


@dataclass(frozen=True)
class Coefficient:
    """One linear coefficient of an effect.

    Attributes:
        name: short name in the effect, e.g. ``"c"``.
        unit: SI unit.
        lower: smallest value that makes physical sense (0 for a dissipative coefficient).
        upper: largest one.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True)
class Shape:
    """One nonlinear parameter of an effect: searched, not solved.

    Attributes:
        name: the dataclass field of the effect that holds it.
        unit: SI unit.
        lower: lower bound of the search.
        upper: upper bound of the search.
        log: search on a logarithmic scale.
    """

    name: str
    unit: str
    lower: float
    upper: float
    log: bool = True


@dataclass(frozen=True)
class Columns:
    """Regressor columns of one effect: nonzero only at the joints it acts on.

    Attributes:
        joints: indices of those joints in the model's velocity order, length k.
        values: columns, shape (n, k, p).
    """

    joints: tuple[int, ...]
    values: Floats

    def effort(self, theta: Floats, nv: int) -> Floats:
        """Return the effort of this effect at every joint, shape (n, nv)."""
        out = np.zeros((len(self.values), nv))
        out[:, self.joints] = self.values @ np.asarray(theta, dtype=float)
        return out


class Effect(abc.ABC):
    """One cause of joint effort; see the module's docstring for the equation."""

    name: ClassVar[str]
    """Name in YAML, JSON and reports."""

    uses_standstill: ClassVar[bool] = False
    """Whether rows at standstill help to identify it (presliding): they are kept for its axis."""

    causes: ClassVar[tuple[Cause, ...]] = ("other",)
    """What its effort counts as in the generalised disturbance: one word for all coefficients, or one
    for each. ``stiffness`` and ``viscous`` say that the column is the axis' own q or v."""

    depends: ClassVar[Depends] = "other"
    """What its columns are a function of, so that a simulation can tabulate them: ``position``,
    ``velocity``; ``direction`` (times a function of the speed); ``displacement`` (slip elements times
    a function of the speed). An effect of any other kind is still simulated, by repeated passes."""

    axis: str | None
    """Axis it belongs to, or None for the whole machine."""

    @abc.abstractmethod
    def coefficients(self) -> tuple[Coefficient, ...]:
        """Return the linear coefficients in the order of the columns."""

    @abc.abstractmethod
    def columns(self, motion: Motion) -> Columns:
        """Return the regressor columns for a motion."""

    def shapes(self) -> tuple[Shape, ...]:
        """Return the parameters to search; none for an effect that is linear throughout."""
        return ()

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return, for each shape, the values worth trying first on this motion."""
        del motion
        return tuple(
            np.geomspace(s.lower, s.upper, 15) if s.log else np.linspace(s.lower, s.upper, 15)
            for s in self.shapes()
        )

    def fitted_to(self, motion: Motion) -> Self:
        """Return the effect with what it takes from the log before a fit (a table's knots)."""
        del motion
        return self

    def shape_values(self) -> tuple[float, ...]:
        """Return the present values of the shapes."""
        return tuple(float(getattr(self, s.name)) for s in self.shapes())

    def shaped(self, values: Sequence[float]) -> Self:
        """Return the same effect with other shape values."""
        changes = {s.name: float(x) for s, x in zip(self.shapes(), values, strict=True)}
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]


class AxisEffect(Effect):
    """An effect of one axis that depends on the motion of that axis alone."""

    @abc.abstractmethod
    def axis_columns(self, motion: AxisMotion) -> Floats:
        """Return the columns for that axis, shape (n, p)."""

    def columns(self, motion: Motion) -> Columns:
        """See :meth:`Effect.columns`."""
        assert self.axis is not None
        axis = motion.axis(self.axis)
        return Columns((axis.index,), self.axis_columns(axis)[:, None, :])
