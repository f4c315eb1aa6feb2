"""What the motor's own equation cannot show: the servo that commands it.

Inverse dynamics holds whatever the controller does, so that a wrong feed-forward or a drive at its limit
leaves no trace there. The controller's law relates command, position and effort without the plant, and
what differs there is the servo's alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.result import Found, Shrink
from pinotwin.errors import DataError
from pinotwin.loop.controller import Controller
from pinotwin.loop.data import LoopData
from pinotwin.loop.gains import Gains, at_limit, expected, gains_in
from pinotwin.motion import Motion
from pinotwin.signals import rms, roughness
from pinotwin.twin import Twin

MOVED = 0.3  # RMS of what a changed gain does, over what the law leaves anyway
SIGMAS = 4.2  # the same over its standard error; healthy virtual machines reach 2.8
RELATIVE = 0.004  # change of a gain that is worth a name
BETTER = 1.05  # by how much the law must hold better with the gains that were found; healthy: 1.02
COMMON = 0.9  # of what all gains gain together: what one factor on all of them must gain alone
SEEN = 0.02  # change of the effort's scale that inverse dynamics would have found
BROKEN = 5.0  # times what the law left when it was identified: more than gains differ
HOLDS = 1.3  # of what the law left when it was identified: beyond, it is not the gains that differ
LIMITED = 2e-3  # share of rows at the limit that is worth a name
WORSE = 10.0  # tracking error there over the error elsewhere: hard acceleration alone reaches 7
OVER = 0.06  # of the rows at a limit: rows above it that a filter leaves; acceleration leaves more
SPIKE = 25.0  # density of sizes at the limit over that below it, if the error is LEFT_BEHIND too
LEFT_BEHIND = 1.3  # the same of the tracking error then
SERVO = ("saturation", "feedforward", "loop_gain", "effort_scale")  # they say why a law fails
FORWARD = ("ffa", "ffv", "kv ffv")


def servo_findings(
    subject: object, motions: Sequence[Motion], validation: Sequence[Motion],
    sensing: Sequence[Found] = (),
) -> list[Found]:  # fmt: skip
    """Return what has changed in the servo of every axis.

    An effort that is logged late or at a wrong scale looks like other gains; what was found of that is
    taken out first.

    Args:
        subject: a twin with controllers, whose gains are compared; anything else only has its drives
            looked at for limits.
        motions: prepared logs with commands.
        validation: logs on which the shrink is stated; the same ones where empty.
        sensing: effects found already.
    """
    motions = [_put_right(m, sensing) for m in motions]
    validation = [_put_right(m, sensing) for m in validation]
    if not motions or any(m.qr is None or m.vr is None for m in motions):
        return []
    out: list[Found] = []
    for joint, axis in enumerate(motions[0].names):
        out += _limited(motions, joint, axis)
        controller = subject.controllers.get(axis) if isinstance(subject, Twin) else None
        late = any(f.effect == "delay" and f.axis == axis for f in sensing)
        if controller is not None and not late and not any(f.axis == axis for f in out):
            out += _changed(controller, motions, validation or motions, joint)
    known = {(f.effect, f.axis) for f in sensing}
    return [f for f in out if (f.effect, f.axis) not in known]


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


def _changed(
    controller: Controller, motions: Sequence[Motion], validation: Sequence[Motion], joint: int
) -> list[Found]:
    """Return ``feedforward`` or ``loop_gain`` where gains have left what the twin knows."""
    try:
        each = [gains_in(_channels(m, joint), controller) for m in motions]
        unseen = [gains_in(_channels(m, joint), controller) for m in validation]
    except DataError:  # the axis does not move enough in a log to say anything about its servo
        return []
    now = _mean(each)
    if now.unexplained[0] < BETTER * now.unexplained[1]:
        return []
    if controller.rms and now.unexplained[1] > HOLDS * controller.rms:
        return []
    size = np.abs(now.after - now.before) * now.held
    known = np.array([_error(controller, name) for name in now.names])
    error = np.hypot(np.sqrt(np.maximum(np.diag(now.covariance), 0.0)), known)
    moved = (
        (size > MOVED * now.unexplained[1])
        & (np.abs(now.after - now.before) > SIGMAS * error)
        & (np.abs(now.after - now.before) > RELATIVE * np.abs(now.before))
    )
    factor = _common(now)
    if moved.any() and factor is not None:
        every = list(range(len(now.names)))
        scale = _found("effort_scale", motions[0].names[joint], now, every, unseen, controller)
        return [replace(scale, theta={"share": factor})]
    out = []
    for effect, own in (("feedforward", True), ("loop_gain", False)):
        which = [k for k, n in enumerate(now.names) if (n in FORWARD) == own and moved[k]]
        if which:
            out.append(_found(effect, motions[0].names[joint], now, which, unseen, controller))
    return out


def _common(now: Gains) -> float | None:
    """Return by which share all gains have grown alike, None where they have not.

    One factor on the whole law is no setting of a controller: the effort is logged, or made, at another
    scale. If it were large, the plant would show it too.
    """
    before, after = np.square(now.unexplained)
    share, left = now.common
    alone = (before - left**2) / max(before - after, 1e-300)
    return share if alone > COMMON and RELATIVE < abs(share) < SEEN else None


def broken_laws(
    subject: object, motions: Sequence[Motion], found: Sequence[Found]
) -> dict[int, float]:
    """Return joint -> how much more a controller's law leaves than it did, where nothing says why."""
    if not isinstance(subject, Twin) or any(m.qr is None or m.vr is None for m in motions):
        return {}
    motions = [_put_right(m, found) for m in motions]
    named = {f.axis for f in found if f.effect in SERVO}
    out: dict[int, float] = {}
    for joint, axis in enumerate(motions[0].names if motions else ()):
        controller = subject.controllers.get(axis)
        if controller is None or not controller.rms or axis in named:
            continue
        try:
            now = _mean([gains_in(_channels(m, joint), controller) for m in motions])
        except DataError:
            continue
        left = now.unexplained[0]
        if left > BROKEN * controller.rms:
            out[joint] = left / controller.rms
    return out


def _found(
    effect: str, axis: str, now: Gains, which: Sequence[int], unseen: Sequence[Gains],
    controller: Controller,
) -> Found:  # fmt: skip
    """Return the finding; efforts of the law are stated as the error that would cause them."""
    stiffness = max(abs(float(expected(controller)[0])), 1e-300)
    before = float(np.sqrt(np.mean([g.unexplained[0] ** 2 for g in unseen]))) / stiffness
    after = float(np.sqrt(np.mean([g.unexplained[1] ** 2 for g in unseen]))) / stiffness
    noise = (controller.rms or 0.0) / stiffness
    share = _share(before, after, noise)
    each = [_share(g.unexplained[0], g.unexplained[1], controller.rms or 0.0) for g in unseen]
    promised = _share(now.unexplained[0], now.unexplained[1], controller.rms or 0.0)
    return Found(
        effect, axis, 0.95,
        {}, {now.names[k]: float(now.after[k] - now.before[k]) for k in which},
        {"e": Shrink(before, after, share, (min([*each, share - 0.05]), min(max([*each, share]), 1.0)),
                     promised, "validation")},
        [], {f"{axis}.{now.names[k]}": (float(now.before[k]), float(now.after[k]), float("inf"))
             for k in which},
        gain=float((now.unexplained[0] / now.unexplained[1]) ** 2),
    )  # fmt: skip


def _share(before: float, after: float, noise: float) -> float:
    return float(np.clip((before**2 - after**2) / max(before**2 - noise**2, 1e-300), -1.0, 1.0))


def _mean(each: Sequence[Gains]) -> Gains:
    """Return the mean of what several logs say."""
    n = len(each)
    return Gains(
        each[0].names, each[0].before, np.mean([g.after for g in each], axis=0),
        np.mean([g.covariance for g in each], axis=0) / n,
        tuple(np.sqrt(np.mean([np.square(g.unexplained) for g in each], axis=0)).tolist()),
        np.mean([g.held for g in each], axis=0), float(np.mean([g.limited for g in each])),
        (float(np.mean([g.common[0] for g in each])),
         float(np.sqrt(np.mean([g.common[1] ** 2 for g in each])))),
    )  # fmt: skip


def _error(controller: Controller, column: str) -> float:
    """Return the standard error that the twin states for the gain of a column."""
    parts = column.split()
    own = [controller.errors.get(p, 0.0) for p in parts]
    if len(parts) == 1:
        return own[0]
    values = [float(getattr(controller, p)) for p in parts]
    return float(np.hypot(values[0] * own[1], values[1] * own[0]))


def _channels(m: Motion, joint: int) -> LoopData:
    """Return an axis' servo channels; nothing here depends on a disturbance, e stands in its place."""
    assert m.qr is not None
    return LoopData.of_axis(m, joint, (m.qr - m.q)[:, joint])


def _followed(mask: Mask, rows: int) -> Mask:
    """Return the mask with the rows that follow each true one."""
    out = mask.copy()
    for k in range(1, rows + 1):
        out[k:] |= mask[:-k]
    return out
