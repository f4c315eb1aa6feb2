"""The catalogue: every effect that a diagnosis may name, as candidates made from one log's scenes."""

from __future__ import annotations

from collections.abc import Iterator

from pinotwin.diagnosis.catalogue.dynamics import axis_dynamics, machine_dynamics
from pinotwin.diagnosis.catalogue.friction import friction
from pinotwin.diagnosis.catalogue.position import Scan, position
from pinotwin.diagnosis.catalogue.sensing import sensing
from pinotwin.diagnosis.context import Context, Family


def families(context: Context, scan: Scan, *, leave_out: frozenset[str] = frozenset()) -> Iterator[Family]:
    """Yield every family of candidates of a machine; each is one effect on one axis.

    Args:
        context: what candidates are made from.
        scan: see :data:`pinotwin.diagnosis.catalogue.position.Scan`.
        leave_out: effects that are not to be considered (the bench takes some away).
    """
    for axis in context.machine.axes.values():
        if not any(c.joint == axis.index for c in context.rows.channels):
            continue
        for family in _of_axis(context, axis.name, axis.index, scan):
            if family and family[0].effect not in leave_out:
                yield family
    for family in machine_dynamics(context):
        if family and family[0].effect not in leave_out:
            yield family


def _of_axis(context: Context, axis: str, joint: int, scan: Scan) -> Iterator[Family]:
    yield from friction(context, axis, joint)
    yield from position(context, axis, joint, scan)
    yield from sensing(context, axis, joint)
    yield from axis_dynamics(context, axis, joint)
