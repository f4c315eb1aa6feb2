"""The effects that may explain a gap, at the shapes that these logs can show."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.effects import EFFECTS, Effect
from pinotwin.effects.tree import Tree

APART = ("rigid_body", "external_force", "spring")
"""Looked for in another way: by change points in time, and by the vibration of a passive joint."""


def candidates(comparison: Comparison, leave_out: Collection[str] = ()) -> Iterator[Effect]:
    """Yield every effect worth trying on every axis.

    Effects of the controller are not among them: they leave the plant as it is. A body is tried at the
    last link first and then at those before it.
    """
    machine, motion = comparison.machine, comparison.new.motion
    tree = Tree(comparison.twin.model, machine.names, machine.rotary)
    for name, kind in EFFECTS.items():
        if name in leave_out or name in APART or kind.family.acts == "loop":
            continue
        for axis in machine.axes.values():
            if axis.index in comparison.new.joints:
                yield from kind.candidates(tree, axis.name, motion)
