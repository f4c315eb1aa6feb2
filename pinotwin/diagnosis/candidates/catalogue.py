"""The effects that may explain a gap, at the shapes that these logs can show."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.effects import EFFECTS, Coefficient, Columns, Effect, Shape, known
from pinotwin.effects.effect import Paired
from pinotwin.effects.family import FRICTION
from pinotwin.effects.tree import Tree
from pinotwin.motion import Motion
from pinotwin.twin import Twin

APART = ("rigid_body", "external_force", "spring")
"""Looked for in another way: by change points in time, and by the vibration of a passive joint."""
SAME = {"joint_flexibility": "drive_flexibility"}
"""Effects whose columns are those of another one: not tried where that is."""
BESIDE = {"viscous_thermal": ("viscous",)}  # Effects that are tried together with what they change
SUMS = {"coulomb_asymmetric": ("coulomb", "offset")}  # Effects that are no more than others together


def candidates(comparison: Comparison, leave_out: Collection[str] = ()) -> Iterator[Effect]:
    """Yield every effect of the plant worth trying on every axis; a body at the last link first.

    Friction that a machine lists is not missing in it: its law was fitted to these very logs, and a second one beside
    it would only be a better form of the first.
    """
    machine, motion = comparison.machine, comparison.new.motion
    tree = Tree(comparison.twin.model, machine.names, machine.rotary)
    for name, kind in known(machine.effects).items():
        if name in leave_out or name in APART or kind.family.acts == "loop":
            continue
        if name in SAME and SAME[name] not in leave_out:
            continue
        rubs = kind.family is FRICTION and not comparison.change
        for axis in machine.axes.values():
            has = [any(e.includes(part) for e in axis.effects) for part in SUMS.get(name, (name,))]
            if axis.index in comparison.new.joints and not (rubs and all(has)):
                yield from instances(kind, tree, axis.name, motion)
    for axis in machine.axes.values() if comparison.change and Worn.name not in leave_out else ():
        worn = Worn.of(comparison.twin, axis.name) if axis.index in comparison.new.joints else None
        if worn is not None:
            yield worn


def instances(kind: type[Effect], tree: Tree, axis: str, motion: Motion) -> list[Effect]:
    """Return an effect on an axis at the shapes that a motion can show, together with what it changes."""
    beside = [EFFECTS[x].on(tree, axis) for x in BESIDE.get(kind.name, ())]
    found = kind.candidates(tree, axis, motion)
    return [Joined(axis, (*beside, e)) if beside else e for e in found]


@dataclass(frozen=True)
class Joined(Effect):
    """An effect together with one that it rides on: warming beside the cold viscous friction."""

    axis: str | None
    parts: tuple[Effect, ...]  # the effect that gives the name last
    name: ClassVar[str] = "joined"
    searched: ClassVar[int] = 1

    def coefficients(self) -> tuple[Coefficient, ...]:
        """See :meth:`Effect.coefficients`; either part may fall while the other rises."""
        return tuple(replace(c, lower=-np.inf) for part in self.parts for c in part.coefficients())

    def columns(self, motion: Motion) -> Columns:
        found = [part.columns(motion) for part in self.parts]
        return Columns(found[0].joints, np.concatenate([c.values for c in found], axis=2))

    def shapes(self) -> tuple[Shape, ...]:
        return self.parts[-1].shapes()

    def shape_values(self) -> tuple[float, ...]:
        return self.parts[-1].shape_values()

    def shaped(self, values: Sequence[float]) -> Joined:
        return replace(self, parts=(*self.parts[:-1], self.parts[-1].shaped(values)))


@dataclass(frozen=True)
class Worn(Effect):
    """All friction that a twin knows of an axis, larger or smaller by one factor."""

    name: ClassVar[str] = "friction_scale"
    unlisted: ClassVar[str] = "is a change of what a machine has"
    searched: ClassVar[int] = 1  # of one part of friction alone that part is the plainer word
    axis: str | None
    parts: tuple[tuple[Effect, tuple[float, ...]], ...]

    @classmethod
    def of(cls, twin: Twin, axis: str) -> Worn | None:
        """Return it of an axis of a twin; None where that knows no friction."""
        own = [(x, theta) for x, theta in twin.pairs if x.family is FRICTION and x.axis == axis]
        return cls(axis, tuple((x, tuple(theta.tolist())) for x, theta in own)) if own else None

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("factor", "-", lower=0.0),)

    def columns(self, motion: Motion) -> Columns:
        found = [(x.columns(motion), theta) for x, theta in self.parts]
        return Columns(found[0][0].joints, sum(x.values @ np.array(y) for x, y in found)[..., None])


def named(effect: Effect) -> Effect:
    """Return the effect that a candidate is named for."""
    return effect.parts[-1] if isinstance(effect, Joined) else effect


def same_cause(a: Effect, b: Effect) -> bool:
    """Whether two effects are one cause as far as any motion can tell."""
    alike = b.name in a.inseparable or a.name in b.inseparable
    if isinstance(a, Paired) and isinstance(b, Paired) and a.name == b.name:
        return {a.axis, a.partner} == {b.axis, b.partner}
    return (a.name == b.name or alike) and a.axis == b.axis
