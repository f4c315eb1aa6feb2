"""A cause is a mechanism times a course: since an instant, for a while after every start, on one side of a play."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.mechanisms import PLAY, Acts, after_starts, starts
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.settings import SETTINGS
from pinotwin.diagnosis.days.stretch import Stretch


@dataclass(frozen=True, eq=False)
class Course:
    """A cause with its course.

    Attributes:
        acts: of every stretch, equation -> column. price: of the search [nats].
        since: instant at which it begins in every stretch, or for how long it acts after a start [s].
    """

    acts: list[Acts]
    price: float
    since: list[float] = field(default_factory=list)


def courses(r: Reference, logs: Sequence[Stretch], left: Sequence[Left], name: str) -> dict[str, Course]:
    """Return what begins at an instant of each log or acts after starts, and the side of a play as a hidden state."""
    dry = [s.axes[name]["dry"] for s in logs]
    found = {"friction_since": since(logs, dry, left, (name, "plant"))}
    found["friction_at_start"] = _after_starts(r, logs, left, name)
    if (name, "encoders") in left[0]:
        step = [s.axes[name]["one"] * 1e-4 for s in logs]
        found["encoder_step"] = since(logs, step, left, (name, "encoders"))
        found["lost_motion_either_side"] = _either_side(logs, left, name)
    return {k: x for k, x in found.items() if x is not None}


def since(
    logs: Sequence[Stretch], course: Sequence[Floats], left: Sequence[Left], key: tuple[str, str]
) -> Course | None:
    """Return a cause, (n,) in each log, that begins at an instant; None of one that was there from the start."""
    begin = [
        onset(s, x, y[key], level=key[1] == "encoders") for s, x, y in zip(logs, course, left, strict=True)
    ]
    if max(begin) <= 1.0:
        return None
    acts = [{key[1]: x * s.low((s.t > t).astype(float))} for s, x, t in zip(logs, course, begin, strict=True)]
    return Course(acts, 0.5 * SETTINGS.place * len(logs), begin)


def onset(s: Stretch, course: Floats, left: Floats, *, level: bool) -> float:
    """Return the instant [s] from which a course explains most of what is left; ``level``: beside a constant."""
    both, own, one = (np.cumsum(x[::-1])[::-1] for x in (left * course, course * course, course))
    if level:
        both, own = both - left.mean() * one, own - one**2 / len(left)
    gain = both**2 / np.maximum(own, 1e-6 * float(course @ course) + 1e-300)
    return float(s.t[int(np.argmax(gain[: int(0.95 * len(gain))]))])


def _after_starts(r: Reference, logs: Sequence[Stretch], left: Sequence[Left], name: str) -> Course | None:
    """Return friction for a while after every start, as of a brake that releases late."""
    if not all(len(starts(s, name)) > 1 for s in logs):
        return None
    size, best, found = r.widths[name]["effort"], 0.0, None
    for long in (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.6):
        columns = [after_starts(s, name, long) * size for s in logs]
        num = sum(float(a @ y[name, "plant"]) for a, y in zip(columns, left, strict=True))
        gain = num * abs(num) / max(sum(float(a @ a) for a in columns), 1e-300)
        if gain > best:
            best, found = gain, Course([{"plant": x} for x in columns], SETTINGS.place, [long])
    return found


def _either_side(logs: Sequence[Stretch], left: Sequence[Left], name: str) -> Course | None:
    """Return lost motion whose side is a hidden state; each change of side is paid for."""
    sides = [_sides(x[name, "encoders"]) for x in left]
    turns = [int(np.sum(x[1:] != x[:-1])) for x in sides]
    reversals = [int(np.sum(np.diff(np.sign(s.axes[name]["memory"])) != 0.0)) for s in logs]
    if any(t < max(n, 3) for t, n in zip(turns, reversals, strict=True)):
        return None  # a step: lost motion changes sides whenever the axis reverses
    return Course([{"encoders": PLAY * s.low(x)} for s, x in zip(logs, sides, strict=True)], 3.0 * sum(turns))


def _sides(r: Floats) -> Floats:
    """Return -1 or 1 for every row: the side on which a gap with two levels lies, with hysteresis."""
    low, high = np.quantile(r, 0.1), np.quantile(r, 0.9)
    middle, half = 0.5 * (high + low), 0.25 * (high - low)
    raw = np.where(r > middle + half, -1.0, np.where(r < middle - half, 1.0, 0.0))
    seen = np.maximum.accumulate(np.where(raw != 0.0, np.arange(len(r)), 0))
    return np.where(raw[seen] == 0.0, 1.0, raw[seen])
