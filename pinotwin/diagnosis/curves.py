"""Curves that stand for no effect: an axis' own signals as smooth columns, and as factors of a course."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Context, Scene
from pinotwin.signals import hats

Curve = Callable[[Scene], Floats]
"""A scene -> columns (n, k), or a factor (n,)."""


@dataclass(frozen=True)
class Span:
    """One axis, and by what its signals are measured.

    Attributes:
        joint: its column.
        others: columns of the other joints.
        low: lowest position [m or rad].
        high: highest position.
        top: top speed [m/s or rad/s].
        hard: largest acceleration.
    """

    joint: int
    others: tuple[int, ...]
    low: float
    high: float
    top: float
    hard: float

    @classmethod
    def of(cls, context: Context, joint: int) -> Span:
        """Return the span that a joint has in all logs."""
        low, high = context.travel(joint)
        hard = max(float(np.abs(s.motion.a[:, joint]).max()) for s in context.scenes)
        others = tuple(k for k in range(context.machine.nv) if k != joint)
        return cls(joint, others, low, high, max(context.speed(joint), 1e-12), max(hard, 1e-12))

    def position(self, s: Scene) -> Floats:
        """Return the position, -1 to 1 over the travel, shape (n,)."""
        width = max(self.high - self.low, 1e-12)
        return np.asarray(2.0 * (s.motion.q[:, self.joint] - self.low) / width - 1.0)

    def speed(self, s: Scene) -> Floats:
        """Return the velocity over the top speed, shape (n,)."""
        return np.asarray(s.motion.v[:, self.joint] / self.top)

    def push(self, s: Scene) -> Floats:
        """Return the acceleration over the largest one, shape (n,)."""
        return np.asarray(s.motion.a[:, self.joint] / self.hard)

    def turns(self, s: Scene) -> Floats:
        """Return the direction of motion with its bristles' memory, -1 to 1, shape (n,)."""
        return np.asarray(s.direction[:, self.joint])


def curves(axis: Span) -> Iterator[tuple[str, Curve]]:
    """Yield what an effort may be a function of, in words and as columns (n, k) of a scene."""
    yield "speed", lambda s: hats(axis.speed(s), -1.0, 1.0, 9)
    yield "position", lambda s: hats(axis.position(s), -1.0, 1.0, 12)
    yield "position and direction", lambda s: _both_ways(s, axis)
    yield "acceleration", lambda s: hats(axis.push(s), -1.0, 1.0, 7)
    yield "load and direction", lambda s: _load(s, axis)
    yield "time", lambda s: _drift(s, axis)
    if axis.others:
        yield "other axes' motion", lambda s: _elsewhere(s, list(axis.others))


def factors(axis: Span) -> Iterator[tuple[str, Curve]]:
    """Yield by what an effect may be larger, in words and as a factor (n,) of a scene."""
    yield "speed", lambda s: np.abs(axis.speed(s))
    yield "speed", lambda s: axis.speed(s) ** 2
    yield "speed", lambda s: 1.0 / (np.abs(axis.speed(s)) + 0.1)
    yield "acceleration", lambda s: np.abs(axis.push(s))
    yield "position", axis.position
    yield "position", lambda s: axis.position(s) ** 2
    yield "time", _time


def _both_ways(s: Scene, axis: Span) -> Floats:
    return hats(axis.position(s), -1.0, 1.0, 5) * axis.turns(s)[:, None]


def _time(s: Scene) -> Floats:
    """Return -1 at the start of a log to 1 at its end, shape (n,)."""
    return np.linspace(-1.0, 1.0, len(s.motion))


def _load(s: Scene, axis: Span) -> Floats:
    effort, rigid = np.abs(s.effort[:, axis.joint]), np.abs(s.rigid[:, axis.joint])
    turns = axis.turns(s)
    return np.column_stack([effort * turns, rigid * turns, rigid * s.motion.v[:, axis.joint]])


def _drift(s: Scene, axis: Span) -> Floats:
    t = _time(s)
    return np.column_stack([t * axis.speed(s), t * axis.turns(s), t])


def _elsewhere(s: Scene, others: list[int]) -> Floats:
    v, a = s.motion.v[:, others], s.motion.a[:, others]
    sizes = [np.maximum(np.abs(x).max(axis=0), 1e-12) for x in (v, a)]
    return np.column_stack([v / sizes[0], a / sizes[1], s.direction[:, others]])
