"""What the motor's own equation cannot show: the servo that commands it.

Inverse dynamics holds whatever the controller does, so that a wrong feed-forward or a drive at its limit
leaves no trace there. The controller's law relates command, position and effort without the plant, and
what differs there is the servo's alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.law import broken, changed, law_of
from pinotwin.diagnosis.result import Found
from pinotwin.loop.gains import at_limit
from pinotwin.motion import Motion
from pinotwin.signals import rms, roughness
from pinotwin.twin import Twin

LIMITED = 2e-3  # share of rows at the limit that is worth a name
WORSE = 8.0  # tracking error there over the error elsewhere: hard acceleration alone reaches 7
OVER = 0.06  # of the rows at a limit: rows above it that a filter leaves; acceleration leaves more
SPIKE = 60.0  # density of sizes at the limit over that below it, if the error is LEFT_BEHIND too
LEFT_BEHIND = 1.3  # the same of the tracking error then
SERVO = ("saturation", "feedforward", "loop_gain", "effort_scale")  # they say why a law fails


def look_at_servo(
    subject: object, motions: Sequence[Motion], validation: Sequence[Motion],
    sensing: Sequence[Found] = (), leave_out: Collection[str] = (),
) -> tuple[list[Found], dict[int, float]]:  # fmt: skip
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
    """Return ``saturation`` where an effort rests at a largest size and the axis is left behind."""
    efforts, errors, near, after = [], [], [], []
    for m in motions:
        assert m.qr is not None
        u = m.u[:, joint]
        if not np.isfinite(u).any():
            return []
        efforts.append(np.nan_to_num(u))
        errors.append((m.qr - m.q)[:, joint])
        near.append(at_limit(u, roughness([u[np.isfinite(u)]]), m.step))
        after.append(_followed(near[-1], round(0.05 / m.step)))
    size, e = np.abs(np.concatenate(efforts)), np.concatenate(errors)
    at, late = np.concatenate(near), np.concatenate(after)
    share = float(np.mean(at))
    if share < LIMITED or late.all():
        return []
    worst = rms(e[late]) / max(rms(e[~late]), 1e-300)
    level = float(np.median(size[at]))
    over, spike = _plateau(size, level, float(np.mean([roughness([u]) for u in efforts])))
    clear = worst > WORSE or (spike > SPIKE and worst > LEFT_BEHIND)
    if over > OVER * share or not clear:
        return []
    return [
        Found(
            "saturation", axis, 0.95, {"limit": level}, {"share of time": share}, {}, [],
            gain=float(len(size) * share * np.log(worst)),
        )
    ]  # fmt: skip


def _plateau(size: Floats, level: float, noise: float) -> tuple[float, float]:
    """Return the share of rows above a level, and how much denser sizes are at it than below it."""
    width = max(4.0 * noise, 0.01 * level)
    at = np.count_nonzero(np.abs(size - level) < width)
    below = np.count_nonzero((size > level - 4.0 * width) & (size < level - 2.0 * width))
    return float(np.mean(size > level + width)), float(at) / float(max(int(below), 1))


def _followed(mask: Mask, rows: int) -> Mask:
    """Return the mask with the rows that follow each true one."""
    out = mask.copy()
    for k in range(1, rows + 1):
        out[k:] |= mask[:-k]
    return out
