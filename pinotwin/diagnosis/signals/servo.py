"""Drives at their limit, told by an effort that rests there though the command asks for more."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.result import Found, Size
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.injections import posterior
from pinotwin.diagnosis.search.trials import TRIALS
from pinotwin.diagnosis.signals.limits import exceeded, reached
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.twin import Twin


def limits(
    c: Comparison, leave_out: Collection[str] = (), rules: Rules = RULES, *, rests: bool = False
) -> list[Found]:
    """Return the drives at their limit, which were at none on the twin's own logs.

    Args:
        c: a machine or twin, and logs.
        leave_out: effects that are not considered.
        rules: thresholds.
        rests: also take an effort for limited that rests at its largest for longer than on the own logs.
    """
    motion, out = c.new.motion, list[Found]()
    # The efforts as they were logged, unless they are those of motors.
    logs = [one.log for one in (*c.logs, *c.validation)] if c.machine.transmission is None else []
    if motion.qr is None or "saturation" in leave_out:
        return []
    for axis in c.machine.axes.values():
        if not c.gate.asks("servo", axis.name):
            continue
        level = _level(c, axis.index, [motion], rests=rests)
        if level is None or exceeded([x[u] for x in logs if (u := f"{axis.name}.u") in x], level):
            continue
        again = [_level(c, axis.index, part, rests=rests) is not None for part in _without_stretches(motion)]
        sure = posterior(sum(again), len(again), rules)
        told, unit = {"limit": level}, "N·m" if axis.rotary else "N"
        size = Size("limit", np.inf, level, unit, (0.98 * level, 1.02 * level))
        out.append(Found("saturation", axis.name, sure, told, told, {}, [], size=[size], gain=1.0))
    return out


def _level(c: Comparison, joint: int, parts: Sequence[Motion], *, rests: bool) -> float | None:
    """Return the effort at which a drive rests though its command asks for more, as it never did on the own logs."""
    own = None if c.own is None or c.own.motion.qr is None else c.own.motion
    usual = np.inf if own is None else max(rms(own.error[:, joint]), 1e-300)  # tracking error
    found = reached(parts, joint, usual, partial(_asked, c.twin, joint))
    if c.own is None:
        return None if found is None else found.level
    if found is not None and reached([c.own.motion], joint) is None:
        return found.level
    if not rests or own is None:
        return None
    return _rests(parts, [own], joint, strays=c.machine.names[joint] in c.gate.strays)


def _asked(twin: Twin, joint: int, motion: Motion) -> Floats:
    """Return the effort that the command of a motion asks of a drive: that of the twin if it were followed, (n,)."""
    pairs = ((motion.qr, motion.q), (motion.vr, motion.v), (motion.ar, motion.a))
    q, v, a = (measured if r is None else np.where(np.isfinite(r), r, measured) for r, measured in pairs)
    return np.asarray(twin.effort(replace(motion, q=q, v=v, a=a))[:, joint])


def _without_stretches(motion: Motion) -> list[list[Motion]]:
    """Return what is left of a motion when each of :data:`TRIALS` stretches is left out."""
    edges = np.linspace(0, len(motion), TRIALS + 1).astype(int)
    parts = [motion.cut(int(a), int(b)) for a, b in pairwise(edges)]
    return [[p for p in parts if p is not out] for out in parts]


def _rests(new: Sequence[Motion], own: Sequence[Motion], joint: int, *, strays: bool) -> float | None:
    """Return the largest effort, where it rests there longer than on the own logs or the axis runs off; else None."""
    errors = [
        rms(np.concatenate([m.error[:, joint] for m in part if m.qr is not None])) for part in (new, own)
    ]
    sizes = [np.abs(np.nan_to_num(np.concatenate([m.u[:, joint] for m in part]))) for part in (new, own)]
    rests = [float(np.mean(x > 0.97 * np.quantile(x, 0.999))) for x in sizes]
    top, before = (float(np.quantile(x, 0.999)) for x in sizes)
    off = errors[0] >= RULES.left_behind * errors[1] and (top < RULES.less_than_before * before or not strays)
    return top if off or rests[0] >= RULES.at_limit * rests[1] else None
