"""The protocol of an effect: one physical cause of joint effort, linear in its coefficients.

    effort = sum over effects of columns(motion; shape) @ theta            [N or N·m]

``theta`` are the linear coefficients that least squares finds; ``shape`` the few numbers inside a column (a Stribeck
speed, a ripple pitch) that a bounded search finds: each of the ``candidates`` keeps its shapes, which ``shapes()``
bounds and ``shape_values()`` starts a polish at; ``found.settled()`` is what machine.yaml is to list. Effects are
frozen dataclasses whose fields are what the YAML may set; none stores what was found. Those whose column is made of
the model's own effort (``needs``) want a motion that holds it: ``with_model_effort`` of :mod:`pinotwin.effects.scene`.

A new effect is one small final class, see :mod:`pinotwin.effects.known`.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.family import OTHER, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import HasTree, Tree
from pinotwin.errors import DataError
from pinotwin.motion import AxisMotion, Motion
from pinotwin.units import of_axis

Cause = Literal[
    "stiffness",
    "viscous",
    "friction",
    "position",
    "inertial_coupling",
    "flexibility",
    "external",
    "rigid_body",
    "other",
]
Depends = Literal["position", "velocity", "direction", "displacement", "partner", "other"]
Need = Literal["model", "rigid", "mass"]


@dataclass(frozen=True)
class Coefficient:
    """One linear coefficient of an effect."""

    name: str  # short name in the effect, e.g. ``"c"``
    unit: str  # SI unit
    lower: float = -np.inf  # smallest value that makes physical sense (0 for a dissipative coefficient)
    upper: float = np.inf  # largest one


@dataclass(frozen=True)
class Shape:
    """One nonlinear parameter of an effect: searched, not solved."""

    name: str  # the dataclass field of the effect that holds it
    unit: str  # SI unit
    lower: float  # lower bound of the search
    upper: float  # upper bound of the search
    log: bool = True  # search on a logarithmic scale


@dataclass(frozen=True)
class Columns:
    """Regressor columns of one effect: nonzero only at the joints it acts on."""

    joints: tuple[int, ...]  # indices of those joints in the model's velocity order, length k
    values: Floats  # columns, shape (n, k, p)

    def effort(self, theta: Floats, nv: int) -> Floats:
        """Return the effort at every joint of coefficients (p,), shape (n, nv), or of each of (p, m), (n, nv, m)."""
        out = np.zeros((len(self.values), nv, *np.shape(theta)[1:]))
        out[:, self.joints] = self.values @ np.asarray(theta, dtype=float)
        return out


class Effect(abc.ABC):
    """One cause of joint effort; see the module's docstring for the equation and for how to use it.

    Attributes:
        name: name in YAML, JSON and reports.
        family: its family, which says what it acts on; every effect of the table has one of its own.
        title: name in a heading; made of the name where it is not given.
        words: what it is on the machine, in one sentence without a capital or a full stop.
        remedy: what a person can check or do, in one sentence.
        colour: its colour in every figure.
        contains: simpler effects that are special cases of this one on the same axis.
        imitates: effects that look much like it in an ordinary log.
        inseparable: effects that no motion of the axis can tell from it by the axis' own signals.
        unlisted: why it cannot be listed under an axis in machine.yaml, and what to write instead; empty if it can.
        several: whether an axis may list it more than once (ripples of several pitches).
        needs: channels of the motion that :func:`pinotwin.effects.with_model` must have filled.
        searched: how many numbers a search over its candidates chooses: the price of finding it.
        logged_effort: whether it changes the logged effort after everything else: what moves the machine is
            without it.
        sharp: whether its effort changes faster than the motion does: its columns then go through the low-pass
            that the measured effort went through, see :meth:`pinotwin.motion.Motion.passed`.
        pointwise: whether a row of its columns follows from q, v and a of that row of the motion alone.
        uses_standstill: whether rows at standstill help to identify it (presliding): they are kept for its axis.
        refined_in_loop: whether the closed loop may refine its coefficients, if it is friction or an effort of
            position.
        fades: whether its effort vanishes at speed, as Stribeck's does.
        held: whether its coefficients are held weakly within the size of the effort: knots that a log hardly
            passes would run away.
        local: whether each of its coefficients is told at one place of the travel alone, as a table's knots are.
        causes: what its effort counts as in the generalised disturbance: one word for all coefficients, or one
            for each. ``stiffness`` and ``viscous`` say that the column is the axis' own q or v.
        depends: what its columns are a function of, so that a simulation can tabulate them: ``position``,
            ``velocity``; ``direction`` (times a function of the speed); ``displacement`` (slip elements times a
            function of the speed); ``partner`` (inertia, viscous and dry friction between two axes, see
            :class:`Paired`). An effect of any other kind is still simulated, by repeated passes.
        axis: axis it belongs to, or None for the whole machine.
    """

    name: ClassVar[str]
    family: ClassVar[Family] = OTHER
    title: ClassVar[str]
    words: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    colour: ClassVar[str] = "#7f7f7f"
    contains: ClassVar[tuple[str, ...]] = ()
    imitates: ClassVar[tuple[str, ...]] = ()
    inseparable: ClassVar[tuple[str, ...]] = ()
    unlisted: ClassVar[str] = ""
    several: ClassVar[bool] = False
    needs: ClassVar[tuple[Need, ...]] = ()
    searched: ClassVar[int] = 0
    logged_effort: ClassVar[bool] = False
    sharp: ClassVar[bool] = False
    uses_standstill: ClassVar[bool] = False
    refined_in_loop: ClassVar[bool] = True
    fades: ClassVar[bool] = False
    held: ClassVar[bool] = False
    local: ClassVar[bool] = False
    pointwise: ClassVar[bool] = False
    causes: ClassVar[tuple[Cause, ...]] = ("other",)
    depends: ClassVar[Depends] = "other"
    axis: str | None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if hasattr(cls, "name") and not hasattr(cls, "title"):
            cls.title = cls.name.replace("_", " ").capitalize()

    @abc.abstractmethod
    def coefficients(self) -> tuple[Coefficient, ...]:
        """Return the linear coefficients in the order of the columns."""

    def mode(self) -> tuple[float, float] | None:
        """Return frequency [Hz] and damping ratio of a load that it hangs on its axis by a spring, if it does.

        A simulation gives that load states of its own; its one coefficient is the load's share of the inertia.
        """
        return None

    @abc.abstractmethod
    def columns(self, motion: Motion) -> Columns:
        """Return the regressor columns for a motion."""

    def along(self, motion: Motion, theta: Floats, block: int = 1 << 12) -> Floats:
        """Return the effort of coefficients (p,), shape (n, nv), or of each of (p, m), (n, nv, m); tables by blocks."""
        if not self.pointwise or len(motion) <= block:
            return self.columns(motion).effort(theta, len(motion.names))
        starts = range(0, len(motion), block)
        return np.concatenate([self.along(motion.cut(k, min(k + block, len(motion))), theta) for k in starts])

    def shapes(self) -> tuple[Shape, ...]:
        """Return the parameters to search; none for an effect that is linear throughout."""
        return ()

    def grid(self, motion: Motion) -> tuple[Floats, ...]:
        """Return, for each shape, the values worth trying first on this motion."""
        return tuple(
            np.geomspace(s.lower, s.upper, 15) if s.log else np.linspace(s.lower, s.upper, 15)
            for s in self.shapes()
        )

    def fitted_to(self, motion: Motion) -> Self:
        """Return the effect with what it takes from the log before a fit (a table's knots)."""
        return self

    def belief(self) -> tuple[Floats, float] | None:
        """Return what is believed of its coefficients, or None: rows B (k, p), and how many count as one.

        B'B over that number, of the rows of a fit that tell as much as an independent one, is the precision in
        units of the effort.
        """
        return None

    def bound(self, tree: Tree) -> Self:
        """Return the effect with what it takes from its machine (a body's regressor, an endless joint)."""
        return self

    def wider(self) -> tuple[Self, ...]:
        """Return the same effect with a further shape to search, at some values of it: taken where it pays."""
        return ()

    def other_forms(self) -> tuple[Self, ...]:
        """Return the same effect in other usual forms of its law, to try where one has been fitted."""
        return ()

    def nominal(self) -> Floats | None:
        """Return the coefficients that the machine's description gives, shape (p,), or None where it gives none."""
        return None

    def labels(self) -> tuple[str, ...]:
        """Return the name of every coefficient in a table of parameters."""
        return tuple(c.name for c in self.coefficients())

    def shape_values(self) -> tuple[float, ...]:
        """Return the present values of the shapes."""
        return tuple(float(getattr(self, s.name)) for s in self.shapes())

    def shaped(self, values: Sequence[float]) -> Self:
        """Return the same effect with other shape values."""
        changes = {s.name: float(x) for s, x in zip(self.shapes(), values, strict=True)}
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def channel(self, motion: Motion, name: Need) -> Floats:
        """Return a channel of the model's effort, shape (n, nv), of the mass (n, nv, nv), or a DataError without it."""
        found: Floats | None = getattr(motion, name)
        if found is None:
            raise DataError(
                f"{self.axis}.{self.name} needs the effort of a model along the motion; "
                "call with_model_effort(motion, effects, theta) first"
            )
        return found

    @classmethod
    def on(cls, machine: HasTree, axis: str) -> Self:
        """Return the effect on an axis with its default settings."""
        tree = Tree.of(machine)
        made = cls(axis=axis, rotary=tree.rotary[tree.index(axis)])  # type: ignore[call-arg]
        return made.bound(tree)

    @classmethod
    def candidates(cls, machine: HasTree, axis: str, motion: Motion) -> tuple[Effect, ...]:
        """Return the instances worth trying on one axis of a motion; none if it cannot show the effect.

        Args:
            machine: whose axis, or a :class:`pinotwin.effects.tree.Tree`.
            axis: name of the axis.
            motion: prepared log(s), with the model's channels where ``needs`` asks for them.
        """
        sight = Sight.of(motion, axis)
        if not sight.moves:
            return ()
        return tuple(e.fitted_to(motion) for e in cls.on(machine, axis).trials(motion, sight))

    def trials(self, motion: Motion, sight: Sight) -> tuple[Effect, ...]:
        """Return this effect at the shapes that a moving axis can show: see :meth:`candidates`."""
        return (self,)

    def over(self, *grids: Sequence[float] | Floats) -> tuple[Self, ...]:
        """Return the effect at every combination of shape values, one grid a shape."""
        return tuple(self.shaped([float(x) for x in values]) for values in itertools.product(*grids))

    def possible(self, theta: Floats) -> bool:
        """Whether coefficients, shape (p,), and shapes can belong to one such effect; bounds are judged apart."""
        return True

    def includes(self, name: str) -> bool:
        """Whether an effect of this name is this one, or a special case of it as it is set."""
        return name == self.name or name in self.contains

    def settled(self) -> Self:
        """Return the effect as machine.yaml is to hold it once it was found: with the shapes it has."""
        return self


@dataclass(frozen=True)
class OneAxis(Effect):
    """An effect that is listed under one axis."""

    # its coefficients, in the order of the columns; F stands for the unit of the effort, x for that of the position,
    # I for that of an inertia
    linear: ClassVar[tuple[Coefficient, ...]]
    axis: str  # its name
    rotary: bool = False  # whether it is a rotation; a slide otherwise

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            if "usual" in f.metadata and getattr(self, f.name) is None:
                object.__setattr__(self, f.name, f.metadata["usual"][self.rotary])

    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(dataclasses.replace(c, unit=self.unit(c.unit)) for c in self.linear)

    def unit(self, of: str) -> str:
        """Return a unit in which F, x and I stand for that of effort, position and inertia."""
        return of_axis(of, self.rotary)


def usual(linear: float, rotary: float) -> Any:
    """Return a field of :class:`OneAxis` with a usual value [SI] of a slide or a rotation."""
    return dataclasses.field(default=None, metadata={"usual": (linear, rotary)})


@dataclass(frozen=True)
class Paired(OneAxis):
    """An effect between two axes: inertia and viscous friction of the other's motion, dry friction of both.

        tau_i = Ia a_j + b v_j + c sign(v_i + v_j),      tau_j the same with i and j exchanged

    ``partner`` is the other axis (``with`` in YAML).
    """

    depends = "partner"
    partner: str = dataclasses.field(default="", metadata={"yaml": "with"})

    def terms(self, theta: Floats) -> tuple[float, float, float]:
        """Return Ia, b and c of the coefficients, shape (p,), which are the first of these."""
        inertia, viscous, dry = [*map(float, theta), 0.0, 0.0][:3]
        return inertia, viscous, dry

    def columns(self, motion: Motion) -> Columns:
        own, other, count = motion.axis(self.axis), motion.axis(self.partner), len(self.linear)
        slide = motion.passed(np.sign(own.v + other.v)) if count > 2 else own.v
        parts = [np.stack([x.a, x.v, slide][:count], axis=-1) for x in (other, own)]
        return Columns((own.index, other.index), np.stack(parts, axis=1))

    @classmethod
    def candidates(cls, machine: HasTree, axis: str, motion: Motion) -> tuple[Self, ...]:
        """Return the effect with every other axis that moves."""
        tree = Tree.of(machine)
        moving = [x for x in tree.names if x != axis and Sight.of(motion, x).moves]
        return tuple(cls(axis, tree.rotary[tree.index(axis)], partner=x) for x in moving)


@dataclass(frozen=True)
class AxisEffect(OneAxis):
    """An effect of one axis that depends on the motion of that axis alone."""

    @abc.abstractmethod
    def axis_columns(self, motion: AxisMotion) -> Floats:
        """Return the columns for that axis, shape (n, p)."""

    def columns(self, motion: Motion) -> Columns:
        axis = motion.axis(self.axis)
        values = np.asarray(self.axis_columns(axis), dtype=float)
        if values.shape != (expected := (len(motion), len(self.coefficients()))):
            raise DataError(
                f"{self.axis}.{self.name}: axis_columns returned shape {values.shape}, expected {expected}: "
                "a row a sample, a column a coefficient"
            )
        return Columns((axis.index,), (motion.passed(values) if self.sharp else values)[:, None, :])
