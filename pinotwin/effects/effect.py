"""The protocol of an effect: one physical cause of joint effort, linear in its coefficients.

    effort = sum over effects of columns(motion; shape) @ theta            [N or N·m]

``theta`` are the linear coefficients that least squares finds; ``shape`` the few numbers inside a
column (a Stribeck speed, a ripple pitch) that a bounded search finds. An effect never stores what was
found: it states the equation. Effects are frozen dataclasses; their fields are what the YAML may set.

Identification, simulation, diagnosis, report and documentation read everything they need from here:

* ``effect.columns(motion)``: the regressor. Effects whose column is made of the model's own effort
  (``needs`` names the channels: ``model``, ``rigid``, ``mass``) want a motion that holds it:
  ``motion = told(motion, effects, theta)`` of :mod:`pinotwin.effects.scene`, once a model.
* ``effect.coefficients()``, ``effect.shapes()``, ``effect.shaped(values)``: names, units, bounds.
* ``EFFECTS[name].candidates(machine, axis, motion)``: the instances worth trying on one axis of this
  motion. Empty when the log cannot show the effect (presliding in a coarse log, a Stribeck curve
  without slow rows). ``machine`` may be a machine or a :class:`pinotwin.effects.tree.Tree` that holds a
  twin's inertias. Every candidate keeps its shapes: ``candidate.shapes()`` bounds a further polish,
  ``candidate.shape_values()`` is where it starts. ``EFFECTS[name].searched`` says how many numbers the
  search has chosen: its price. ``found.settled()`` is what machine.yaml is to list.
* ``family.acts``: on the effort, on hidden states, on a sensor, or in the controller's loop. An effect
  of the loop gives columns of the effort that the controller adds; the plant stays what it is.
* ``contains``: simpler effects that are cases of this one: not asked for beside it. ``imitates``: other
  effects whose columns can look alike. ``inseparable``: those that the signals of one axis cannot tell
  apart whatever the motion.
* ``title``, ``words``, ``remedy``, ``colour``: for people.

A new effect is one small final class. A built-in one is listed once in :mod:`pinotwin.effects.table`; how a user's
own is named: :mod:`pinotwin.effects.known`.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.effects.family import OTHER, Family
from pinotwin.effects.sight import Sight
from pinotwin.effects.tree import HasTree, Tree
from pinotwin.errors import DataError
from pinotwin.motion import AxisMotion, Motion

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
    """One cause of joint effort; see the module's docstring for the equation and for how to use it."""

    name: ClassVar[str]
    """Name in YAML, JSON and reports."""

    family: ClassVar[Family] = OTHER
    """Its family, which says what it acts on; every effect of the table has one of its own."""

    title: ClassVar[str]
    """Name in a heading; made of the name where it is not given."""

    words: ClassVar[str] = ""
    """What it is on the machine, in one sentence without a capital or a full stop."""

    remedy: ClassVar[str] = ""
    """What a person can check or do, in one sentence."""

    colour: ClassVar[str] = "#7f7f7f"
    """Its colour in every figure."""

    contains: ClassVar[tuple[str, ...]] = ()
    """Simpler effects that are special cases of this one on the same axis."""

    imitates: ClassVar[tuple[str, ...]] = ()
    """Effects that look much like it in an ordinary log."""

    inseparable: ClassVar[tuple[str, ...]] = ()
    """Effects that no motion of the axis can tell from it by the axis' own signals."""

    unlisted: ClassVar[str] = ""
    """Why it cannot be listed under an axis in machine.yaml, and what to write instead; empty if it can."""

    several: ClassVar[bool] = False
    """Whether an axis may list it more than once (ripples of several pitches)."""

    needs: ClassVar[tuple[Need, ...]] = ()
    """Channels of the motion that :func:`pinotwin.effects.with_model` must have filled."""

    searched: ClassVar[int] = 0
    """How many numbers a search over its candidates chooses: the price of finding it."""

    logged_effort: ClassVar[bool] = False
    """Whether it changes the logged effort after everything else: what moves the machine is without it."""

    sharp: ClassVar[bool] = False
    """Whether its effort changes faster than the motion does: its columns then go through the low-pass
    that the measured effort went through, see :meth:`pinotwin.motion.Motion.passed`."""

    uses_standstill: ClassVar[bool] = False
    """Whether rows at standstill help to identify it (presliding): they are kept for its axis."""

    refined_in_loop: ClassVar[bool] = True
    """Whether the closed loop may refine its coefficients, if it is friction or an effort of position."""

    fades: ClassVar[bool] = False
    """Whether its effort vanishes at speed, as Stribeck's does."""
    held: ClassVar[bool] = False
    """Whether its coefficients are held weakly within the size of the effort: knots that a log hardly
    passes would run away."""
    local: ClassVar[bool] = False
    """Whether each of its coefficients is told at one place of the travel alone, as a table's knots are."""

    causes: ClassVar[tuple[Cause, ...]] = ("other",)
    """What its effort counts as in the generalised disturbance: one word for all coefficients, or one
    for each. ``stiffness`` and ``viscous`` say that the column is the axis' own q or v."""

    depends: ClassVar[Depends] = "other"
    """What its columns are a function of, so that a simulation can tabulate them: ``position``,
    ``velocity``; ``direction`` (times a function of the speed); ``displacement`` (slip elements times
    a function of the speed); ``partner`` (inertia, viscous and dry friction between two axes, see
    :class:`Paired`). An effect of any other kind is still simulated, by repeated passes."""

    axis: str | None
    """Axis it belongs to, or None for the whole machine."""

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

    def known(self, motion: Motion) -> Mask:
        """Return the samples at which what it was fitted to says what it is (where a table has knots), (n,)."""
        return np.ones(len(motion), dtype=bool)

    def bound(self, tree: Tree) -> Self:
        """Return the effect with what it takes from its machine (a body's regressor, an endless joint)."""
        del tree
        return self

    def wider(self) -> tuple[Self, ...]:
        """Return the same effect with a further shape to search, at some values of it: taken where it pays."""
        return ()

    def other_forms(self) -> tuple[Self, ...]:
        """Return the same effect in other usual forms of its law, to try where one has been fitted."""
        return ()

    def nominal(self) -> Floats | None:
        """Return the coefficients that the machine's description gives, or None where it gives none."""
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
        del motion, sight
        return (self,)

    def over(self, *grids: Sequence[float] | Floats) -> tuple[Self, ...]:
        """Return the effect at every combination of shape values, one grid a shape."""
        return tuple(self.shaped([float(x) for x in values]) for values in itertools.product(*grids))

    def possible(self, theta: Floats) -> bool:
        """Whether coefficients, shape (p,), and shapes can belong to one such effect; bounds are judged apart."""
        del theta
        return True

    def turned(self, rotary: bool) -> float:
        """Return the speed from which its dry friction has turned round with the motion [m/s or rad/s]; 0 for none."""
        del rotary
        return 0.0

    def includes(self, name: str) -> bool:
        """Whether an effect of this name is this one, or a special case of it as it is set."""
        return name == self.name or name in self.contains

    def settled(self) -> Self:
        """Return the effect as machine.yaml is to hold it once it was found: with the shapes it has."""
        return self


class Paired(Effect):
    """An effect between two axes: inertia and viscous friction of the other's motion, dry friction of both.

    tau_i = Ia a_j + b v_j + c sign(v_i + v_j),      tau_j the same with i and j exchanged
    """

    depends: ClassVar[Depends] = "partner"
    axis: str
    partner: str

    @abc.abstractmethod
    def terms(self, theta: Floats) -> tuple[float, float, float]:
        """Return Ia, b and c of coefficients in the order of :meth:`coefficients`."""


class Slipping(Effect):
    """An effect of slip elements and a bristle that bend with the displacement of an axis.

    tau = z g(|v|) + m (y - z) + d y',      dz_i = dq / (x_s yield_i), kept within [-1, 1]
    """

    depends: ClassVar[Depends] = "displacement"
    axis: str
    x_s: float | None
    play: float | None
    spread: float

    @abc.abstractmethod
    def memory(self, theta: Floats) -> tuple[float, float]:
        """Return m and d of coefficients in the order of :meth:`coefficients`."""


class AxisEffect(Effect):
    """An effect of one axis that depends on the motion of that axis alone."""

    @abc.abstractmethod
    def axis_columns(self, motion: AxisMotion) -> Floats:
        """Return the columns for that axis, shape (n, p)."""

    def columns(self, motion: Motion) -> Columns:
        assert self.axis is not None
        axis = motion.axis(self.axis)
        values = np.asarray(self.axis_columns(axis), dtype=float)
        if values.shape != (expected := (len(motion), len(self.coefficients()))):
            raise DataError(
                f"{self.axis}.{self.name}: axis_columns returned shape {values.shape}, expected {expected}: "
                "a row a sample, a column a coefficient"
            )
        return Columns((axis.index,), (motion.passed(values) if self.sharp else values)[:, None, :])


def channel(effect: Effect, motion: Motion, name: Need) -> Floats:
    """Return a channel of the motion that holds the model's effort.

    Raises:
        DataError: the motion holds none.
    """
    found: Floats | None = getattr(motion, name)
    if found is None:
        raise DataError(
            f"{effect.axis}.{effect.name} needs the effort of a model along the motion; "
            "call told(motion, effects, theta) first"
        )
    return found
