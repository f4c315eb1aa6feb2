"""A controller's law held against a log: its gains, its dead time, whether it holds at all.

The law relates command, position and effort without the plant. Where its gains have changed, a fit of the
same law says so; where only its dead time has, it holds again once that is shifted; where neither brings
it back, it is broken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Found, Shrink
from pinotwin.errors import DataError
from pinotwin.loop.controller import Controller
from pinotwin.loop.data import LoopData
from pinotwin.loop.gains import Gains, expected, gains_in
from pinotwin.motion import Motion

MOVED = 0.3  # RMS of what a changed gain does, over what the law leaves anyway
SIGMAS = 4.2  # the same over its standard error; healthy virtual machines reach 2.8
RELATIVE = 0.004  # change of a gain that is worth a name
BETTER = 1.05  # by how much the law must hold better with the gains that were found; healthy: 1.02
COMMON = 0.9  # of what all gains gain together: what one factor on all of them must gain alone
SEEN = 0.02  # change of the effort's scale that inverse dynamics would have found
BROKEN = 5.0  # times what the law left when it was identified: more than gains differ
OTHER = 1.5  # the same where other gains bring it back; healthy virtual machines reach 1.13
HOLDS = 1.3  # of what the law left when it was identified: beyond, it is not the gains that differ
LEAST = 0.1  # of a sample: change of the dead time that is worth a name
LONGEST = 0.01  # [s] further dead time that is looked for
FORWARD = ("ffa", "ffv", "kv ffv")


@dataclass(frozen=True)
class Law:
    """A controller's law on the logs of one axis.

    Attributes:
        axis: whose.
        joint: its column.
        controller: what the twin knows of it.
        motions: logs it is held against.
        unseen: logs on which a shrink is stated.
        now: gains over all of ``motions``.
        there: gains in each of ``unseen``.
    """

    axis: str
    joint: int
    controller: Controller
    motions: Sequence[Motion]
    unseen: Sequence[Motion]
    now: Gains
    there: Sequence[Gains]

    def later(self, motions: Sequence[Motion], late: float) -> list[Gains]:
        """Return the gains in each of some logs, the law's dead time longer by ``late`` [s]."""
        shifted = replace(self.controller, delay=self.controller.delay + late)
        return _each(shifted, motions, self.joint)


def law_of(
    controller: Controller, motions: Sequence[Motion], unseen: Sequence[Motion], joint: int
) -> Law | None:
    """Return the law of one axis, None where a log says nothing about its servo: it hardly moves."""
    try:
        now, there = (_each(controller, x, joint) for x in (motions, unseen))
    except DataError:
        return None
    axis = motions[0].names[joint]
    return Law(axis, joint, controller, motions, unseen, mean_gains(now), there)


def _each(controller: Controller, motions: Sequence[Motion], joint: int) -> list[Gains]:
    return [gains_in(_channels(m, joint), controller) for m in motions]


def changed(law: Law) -> list[Found]:
    """Return ``delay``, ``feedforward``, ``loop_gain`` or ``effort_scale`` where a law has changed."""
    late = _later(law)
    if late is not None:
        return [late]
    now, controller = law.now, law.controller
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
        & (np.abs(now.after - now.before) > RELATIVE * _scale(now))
    )
    factor = _common(now)
    if moved.any() and factor is not None:
        scale = _found("effort_scale", law, list(range(len(now.names))))
        return [replace(scale, theta={"share": factor})]
    out = []
    for effect, own in (("feedforward", True), ("loop_gain", False)):
        which = [k for k, n in enumerate(now.names) if (n in FORWARD) == own and moved[k]]
        if which:
            out.append(_found(effect, law, which))
    return out


def _scale(now: Gains) -> Floats:
    """Return what a change of every gain is measured by: its own size, of one on a velocity the largest.

    A speed that a filter passes at 99.9 % looks like a feed-forward of a thousandth of the speed's gain.
    """
    speed = np.array([n in ("kd", "kv", "ffv", "kv ffv") for n in now.names])
    own = np.abs(now.before)
    return np.where(speed, np.max(own[speed], initial=0.0), own)


def broken(law: Law) -> float | None:
    """Return how much more a law leaves than it did where nothing that was named explains that, else None."""
    if not law.controller.rms:
        return None
    ratio, best = (x / law.controller.rms for x in law.now.unexplained)
    return ratio if ratio > BROKEN or (ratio > OTHER and best < HOLDS) else None


def _later(law: Law) -> Found | None:
    """Return ``delay`` where the law holds as it was, all its gains kept, but for its dead time."""
    known = law.controller.rms
    if not known or law.now.unexplained[0] < BETTER * known:
        return None

    def left(late: float) -> float:
        return mean_gains(law.later(law.motions, late)).unexplained[0]

    best = minimize_scalar(
        left,
        bounds=(-law.controller.delay, LONGEST),
        method="bounded",
        options={"xatol": 0.02 * law.controller.step},
    )
    late, after = float(best.x), float(best.fun)
    if after > HOLDS * known or BETTER * after > law.now.unexplained[0]:
        return None
    if after > law.now.unexplained[1] or abs(late) < LEAST * law.controller.step:
        return None  # other gains do it better, or it is but the clock's own
    shrink = _shrink(law, [g.unexplained[0] for g in law.later(law.unseen, late)], after)
    return Found(
        "delay",
        law.axis,
        0.95,
        {},
        {"seconds": late},
        {"e": shrink},
        [],
        {f"{law.axis}.delay": (law.controller.delay, law.controller.delay + late, float("inf"))},
        gain=float((law.now.unexplained[0] / after) ** 2),
    )


def _common(now: Gains) -> float | None:
    """Return by which share all gains have grown alike, None where they have not.

    One factor on the whole law is no setting of a controller: the effort is logged, or made, at another
    scale. If it were large, the plant would show it too.
    """
    before, after = np.square(now.unexplained)
    share, left = now.common
    alone = (before - left**2) / max(before - after, 1e-300)
    return share if alone > COMMON and RELATIVE < abs(share) < SEEN else None


def _found(effect: str, law: Law, which: Sequence[int]) -> Found:
    now = law.now
    shrink = _shrink(law, [g.unexplained[1] for g in law.there], now.unexplained[1])
    return Found(
        effect,
        law.axis,
        0.95,
        {},
        {now.names[k]: float(now.after[k] - now.before[k]) for k in which},
        {"e": shrink},
        [],
        {
            f"{law.axis}.{now.names[k]}": (float(now.before[k]), float(now.after[k]), float("inf"))
            for k in which
        },
        gain=float((now.unexplained[0] / now.unexplained[1]) ** 2),
    )


def _shrink(law: Law, better: Sequence[float], left: float) -> Shrink:
    """Return how far a gap shrinks; efforts of the law are stated as the error that would cause them.

    Args:
        law: as it was.
        better: what it leaves on each of the unseen logs with what was found [N or N·m].
        left: the same on the logs looked at.
    """
    stiffness = max(abs(float(expected(law.controller)[0])), 1e-300)
    noise = law.controller.rms or 0.0
    plain = [g.unexplained[0] for g in law.there]
    before, after = (float(np.sqrt(np.mean(np.square(x)))) for x in (plain, better))
    share = _share(before, after, noise)
    each = [_share(x, y, noise) for x, y in zip(plain, better, strict=True)]
    interval = (min([*each, share - 0.05]), min(max([*each, share]), 1.0))
    promised = _share(law.now.unexplained[0], left, noise)
    return Shrink(before / stiffness, after / stiffness, share, interval, promised, "validation")


def _share(before: float, after: float, noise: float) -> float:
    return float(np.clip((before**2 - after**2) / max(before**2 - noise**2, 1e-300), -1.0, 1.0))


def mean_gains(each: Sequence[Gains]) -> Gains:
    """Return the mean of what several logs say."""
    n = len(each)
    return Gains(
        each[0].names,
        each[0].before,
        np.mean([g.after for g in each], axis=0),
        np.mean([g.covariance for g in each], axis=0) / n,
        tuple(np.sqrt(np.mean([np.square(g.unexplained) for g in each], axis=0)).tolist()),
        np.mean([g.held for g in each], axis=0),
        float(np.mean([g.limited for g in each])),
        (
            float(np.mean([g.common[0] for g in each])),
            float(np.sqrt(np.mean([g.common[1] ** 2 for g in each]))),
        ),
    )


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
