"""The twin with the causes that were found in its own numbers: what simulates its tracking error afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.forms import parts as parts_of
from pinotwin.diagnosis.days.law import Law
from pinotwin.diagnosis.days.mechanisms import READ
from pinotwin.diagnosis.days.row import Row
from pinotwin.diagnosis.days.stretch import VISCOUS
from pinotwin.diagnosis.payload import loaded_twin, physical, plain_body
from pinotwin.effects.family import FRICTION
from pinotwin.simulation import preferred
from pinotwin.twin import Twin


def changed(twin: Twin, rows: Sequence[tuple[Row, str]], laws: Mapping[str, Law]) -> tuple[Twin, set[str]]:
    """Return the twin with causes (each with its axis) in its numbers, and the axes all of whose causes it holds."""
    held, beyond = set[str](), set[str]()
    for row, axis in rows:
        later = _with(twin, row, axis, laws)
        (held if later is not None else beyond).add(axis)
        twin = twin if later is None else later
    return twin, held - beyond


def _with(twin: Twin, row: Row, axis: str, laws: Mapping[str, Law]) -> Twin | None:
    """Return the twin with one cause; None where its numbers cannot hold it."""
    if row.what == READ:
        return twin  # the machine is as it was
    if row.group == "law":
        gains = laws[axis].numbers().get(row.name)
        return None if gains is None else _turned(twin, axis, row.theta * gains, laws[axis])
    if row.name == "payload":
        twin = loaded_twin(twin, axis, physical(plain_body(row.numbers)))
        for name, gain in zip(laws, row.numbers[5:], strict=False):  # of controllers that are told
            added = gain * sum(x * laws[name].numbers()[k] for k, x in laws[name].follows.items())
            twin = _turned(twin, name, added, laws[name]) or twin
        return twin
    if row.group == "form" and row.form is not None:
        covariance = block_diag(twin.covariance, np.diag((row.errors * row.scale) ** 2))
        more = {"effects": (*twin.effects, *parts_of(row.form)), "covariance": covariance}
        return replace(twin, theta=np.r_[twin.theta, row.numbers * row.scale], **more)
    parts = {"friction_scale": ("dry", "viscous"), "coulomb": ("dry",), "viscous": ("viscous",)}.get(row.name)
    if parts is None:
        return None
    theta, diagonal = twin.theta.copy(), {k: x.copy() for k, x in twin.diagonal.items()}
    j = twin.machine.names.index(axis)
    for effect, where in zip(twin.effects, twin.slices, strict=True):
        part = "viscous" if effect.name in VISCOUS else "dry"
        if effect.family is FRICTION and effect.axis == axis and part in parts:
            if effect.name == "viscous" and "viscous" in diagonal:
                diagonal["viscous"][j] += row.theta * float(theta[where][0])
            theta[where] *= 1.0 + row.theta
    return replace(twin, theta=theta, diagonal=diagonal)


def _turned(twin: Twin, axis: str, added: Floats, law: Law) -> Twin | None:
    """Return the twin with what a change adds to the gains of a law, shape (10,), in the scale of its own controller.

    How a loop follows tells the gains of its controller but for a scale: that of the gain that acts longest.
    """
    if axis not in twin.servos or preferred(twin) != "coupled":
        return None
    servo = twin.servos[axis]
    own, logged = servo.gains[:2], law.gains[:2]
    slow = int(min(own[1], law.cascade[1]) > 0.0)
    e, integral, v, _, vr, ar, _, qr, _, _ = added * own[slow] / logged[slow]
    gains = tuple(x + y for x, y in zip(servo.gains, (e, integral, -v, vr, qr, ar), strict=True))
    return replace(twin, servos={**twin.servos, axis: replace(servo, gains=gains)})
