"""What the motor's own equation cannot show: the servo that commands it.

Inverse dynamics holds whatever the controller does, so that a wrong feed-forward or a drive at its limit
leaves no trace there. The controller's law relates command, position and effort without the plant, and
what differs there is the servo's alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.law import broken, changed, law_of
from pinotwin.diagnosis.limits import reached
from pinotwin.diagnosis.result import Found
from pinotwin.motion import Motion
from pinotwin.twin import Twin

SERVO = ("saturation", "feedforward", "loop_gain", "effort_scale")  # they say why a law fails


def look_at_servo(
    subject: object,
    motions: Sequence[Motion],
    validation: Sequence[Motion],
    sensing: Sequence[Found] = (),
    leave_out: Collection[str] = (),
) -> tuple[list[Found], dict[int, float]]:
    """Return what has changed in the servo of every axis, and where its law is broken without a reason.

    An effort that is logged late or at a wrong scale looks like other gains; what was found of that is
    taken out first.

    Args:
        subject: a twin with controllers, whose laws are compared; anything else only has its drives
            looked at for limits.
        motions: prepared logs with commands.
        validation: logs on which the shrink is stated; the same ones where empty.
        sensing: effects found already.
        leave_out: effects that are not named.
    """
    motions = [_put_right(m, sensing) for m in motions]
    validation = [_put_right(m, sensing) for m in validation]
    found: list[Found] = []
    fails: dict[int, float] = {}
    if not motions or any(m.qr is None or m.vr is None for m in motions):
        return found, fails
    known = {(f.effect, f.axis) for f in sensing}
    for joint, axis in enumerate(motions[0].names):
        own = [f for f in _limited(motions, joint, axis) if f.effect not in leave_out]
        controller = subject.controllers.get(axis) if isinstance(subject, Twin) else None
        law = law_of(controller, motions, validation or motions, joint) if controller else None
        if law is not None and ("delay", axis) not in known and not own:
            own = [f for f in changed(law) if f.effect not in leave_out]
        found += [f for f in own if (f.effect, f.axis) not in known]
        said = own or any(f.axis == axis and f.effect in SERVO for f in sensing)
        ratio = None if law is None or said else broken(law)
        if ratio is not None:
            fails[joint] = ratio
    return found, fails


def _put_right(m: Motion, found: Sequence[Found]) -> Motion:
    """Return the motion with delays and scales of its efforts taken out."""
    u = m.u.copy()
    for f in found:
        if f.axis not in m.names:
            continue
        j = m.names.index(f.axis)
        if f.effect == "effort_scale":
            u[:, j] /= 1.0 + f.theta["share"]
        if f.effect == "delay":
            for s in m.segments:
                u[s, j] = np.interp(m.t[s] + f.theta["seconds"], m.t[s], u[s, j])
    return replace(m, u=u)


def _limited(motions: Sequence[Motion], joint: int, axis: str) -> list[Found]:
    """Return ``saturation`` where a drive reached its limit."""
    limit = reached(motions, joint)
    if limit is None:
        return []
    samples = sum(len(m.t) for m in motions)
    return [
        Found(
            "saturation",
            axis,
            0.95,
            {"limit": limit.level},
            {"share of time": limit.share},
            {},
            [],
            gain=float(samples * limit.share * np.log(limit.worst)),
        )
    ]
