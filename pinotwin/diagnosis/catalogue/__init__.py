"""The catalogue: every effect that a diagnosis may name, as candidates made from one log's scenes."""

from __future__ import annotations

from collections.abc import Iterator

from pinotwin.diagnosis.catalogue.dynamics import axis_dynamics, machine_dynamics
from pinotwin.diagnosis.catalogue.friction import friction
from pinotwin.diagnosis.catalogue.position import Scan, position
from pinotwin.diagnosis.catalogue.sensing import sensing
from pinotwin.diagnosis.context import Context, Family


def families(context: Context, *, leave_out: frozenset[str] = frozenset()) -> Iterator[Family]:
    """Yield every family of a machine whose candidates do not depend on what was admitted already.

    Args:
        context: what candidates are made from.
        leave_out: effects that are not to be considered (the bench takes some away).
    """
    for axis, joint in _axes(context):
        for family in _of_axis(context, axis, joint):
            if family and family[0].effect not in leave_out:
                yield family
    for family in machine_dynamics(context):
        if family and family[0].effect not in leave_out:
            yield family


def searched_families(
    context: Context, scan: Scan, *, leave_out: frozenset[str] = frozenset()
) -> Iterator[Family]:
    """Yield the families whose shapes are found by a scan of what is left to explain."""
    for axis, joint in _axes(context):
        for family in position(context, axis, joint, scan):
            if family and family[0].effect not in leave_out:
                yield family


def _axes(context: Context) -> list[tuple[str, int]]:
    rows = {c.joint for c in context.rows.channels}
    return [(a.name, a.index) for a in context.machine.axes.values() if a.index in rows]


def _of_axis(context: Context, axis: str, joint: int) -> Iterator[Family]:
    yield from friction(context, axis, joint)
    yield from sensing(context, axis, joint)
    yield from axis_dynamics(context, axis, joint)
