"""The catalogue: every effect that a diagnosis may name, as families of candidates."""

from __future__ import annotations

from collections.abc import Iterator

from pinotwin.diagnosis.catalogue.dynamics import axis_dynamics, machine_dynamics
from pinotwin.diagnosis.catalogue.friction import friction
from pinotwin.diagnosis.catalogue.position import position
from pinotwin.diagnosis.catalogue.sensing import sensing
from pinotwin.diagnosis.context import Context, Family


def families(context: Context, *, leave_out: frozenset[str] = frozenset()) -> Iterator[Family]:
    """Yield every family that a machine's logs may be searched for.

    Args:
        context: what candidates are made from.
        leave_out: effects that are not to be considered (the bench takes some away).
    """
    for family in _all(context):
        if family.effect not in leave_out:
            yield family


def _all(context: Context) -> Iterator[Family]:
    seen = {c.joint for c in context.rows.channels}
    for axis in context.machine.axes.values():
        if axis.index in seen:
            yield from friction(context, axis.name, axis.index)
            yield from sensing(context, axis.name, axis.index)
            yield from axis_dynamics(context, axis.name, axis.index)
            yield from position(context, axis.name, axis.index)
    yield from machine_dynamics(context)
