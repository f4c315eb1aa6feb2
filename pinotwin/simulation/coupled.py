"""The coupled machine made ready for its kernel: controllers, plant and state as plain arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from pinotwin.arrays import Floats, Ints
from pinotwin.loop.servo import Servo
from pinotwin.simulation import coupled_kernel as kernel
from pinotwin.simulation.state import Lookup, Record

LONGEST = 2.5e-4
"""Longest internal step [s]."""


class Law(NamedTuple):
    """One controller at one internal step.

    Attributes:
        gains: shape (6,); see :mod:`pinotwin.loop.servo`.
        see: what the velocity filter moves in a step.
        lag: what the current loop moves in a step.
        notched: 1 where there is a notch.
        notch: its b0, b1, b2, a1, a2, shape (5,).
        whole: dead time in whole steps.
        part: and the rest of it.
        limit: largest effort.
        offset: what the integrator begins with; NaN for the weight that it carries.
        tick: step of the encoder by which the law is closed; 0 for none.
        origin: of its steps.
    """

    gains: Floats
    see: float
    lag: float
    notched: int
    notch: Floats
    whole: int
    part: float
    limit: float
    offset: float
    tick: float
    origin: float


class Servos(NamedTuple):
    """The controllers of all joints at one internal step: those of :class:`Law`, one row a joint.

    Attributes:
        kind: servo, ideal (follows its command) or passive, shape (nv,); likewise all others.
    """

    kind: Ints
    gains: Floats
    see: Floats
    lag: Floats
    notched: Ints
    notch: Floats
    whole: Ints
    part: Floats
    limit: Floats
    offset: Floats
    tick: Floats
    origin: Floats


class Modes(NamedTuple):
    """Loads that hang on joints by springs, at one internal step; one row each.

    Attributes:
        joint: that a load hangs on, shape (m,).
        share: of the joint's inertia that it is, shape (m,).
        pull: stiffness and damping over the load's mass, shape (m, 2).
        step: how twist and its rate go on in a step, and what an acceleration of the joint adds, shape (m, 2, 3).
    """

    joint: Ints
    share: Floats
    pull: Floats
    step: Floats


def mode_arrays(modes: Sequence[tuple[int, float, float, float]], h: float) -> Modes:
    """Return loads on springs at the internal step h.

    The twist x of a spring, by which the load lags behind its joint, follows ``x'' + 2 zeta w x' + w^2 x = a``; the
    step is exact for an acceleration that does not change within it.

    Args:
        modes: joint, share, frequency [Hz] and damping ratio of each.
        h: internal step [s].
    """
    pull, step = np.zeros((len(modes), 2)), np.zeros((len(modes), 2, 3))
    for k, (_, _, frequency, damping) in enumerate(modes):
        w = 2.0 * np.pi * frequency
        pull[k] = w * w, 2.0 * damping * w
        system = np.array([[0.0, 1.0, 0.0], [-pull[k, 0], -pull[k, 1], 1.0], [0.0, 0.0, 0.0]])
        step[k] = expm(h * system)[:2]
    joints = np.array([m[0] for m in modes], dtype=np.int64)
    return Modes(joints, np.array([m[1] for m in modes], dtype=float), pull, step)


class Coupled(NamedTuple):
    """Where the coupled machine is; changed by the kernel. Shapes (nv,) unless said otherwise."""

    q: Floats
    v: Floats
    a: Floats
    e: Floats
    u: Floats
    w: Floats
    act: Floats
    seen: Floats
    before: Floats
    wound: Floats
    out: Floats
    past: Floats
    late: Floats
    at: Ints
    pace: Floats
    turn: Floats
    low: Floats
    high: Floats
    bend: Floats
    where: Floats
    twist: Floats
    c: Floats
    p: Floats
    t: Floats
    M: Floats
    h: Floats
    r: Floats
    A: Floats
    X: Floats
    one: Floats


def substeps(sampling: float, step: float | None = None) -> int:
    """Return the internal steps a sample: friction is implicit, so that only the loops' speed counts."""
    longest = LONGEST if step is None else step
    return max(1, int(np.ceil(sampling / longest - 1e-9)))


def servo_arrays(servos: Sequence[Servo | None], passive: Sequence[bool], h: float) -> Servos:
    """Return the controllers of all joints at the internal step h; None for a joint without one."""
    n = len(servos)
    out = Servos(
        kind=np.full(n, kernel.IDEAL),
        gains=np.zeros((n, 6)),
        see=np.ones(n),
        lag=np.ones(n),
        notched=np.zeros(n, dtype=np.int64),
        notch=np.zeros((n, 5)),
        whole=np.zeros(n, dtype=np.int64),
        part=np.zeros(n),
        limit=np.full(n, np.inf),
        offset=np.full(n, np.nan),
        tick=np.zeros(n),
        origin=np.zeros(n),
    )
    for j, servo in enumerate(servos):
        if passive[j]:
            out.kind[j] = kernel.PASSIVE
        if servo is None:
            continue
        out.kind[j] = kernel.SERVO
        for name, value in law_numbers(servo, h)._asdict().items():
            getattr(out, name)[j] = value
    return out


def law_numbers(servo: Servo, h: float) -> Law:
    """Return what a controller is made of at the internal step h."""
    notched, steps = servo.notch[0] > 0.0, max(servo.dead, 0.0) / h
    return Law(
        gains=np.array(servo.gains),
        see=_share(servo.velocity_lag, h),
        lag=_share(servo.output_lag, h),
        notched=int(notched),
        notch=biquad(servo.notch, h) if notched else np.zeros(5),
        whole=int(steps),
        part=steps - int(steps),
        limit=servo.limit,
        offset=servo.offset if servo.form == "proportional" else np.nan,
        tick=servo.encoder[0],
        origin=servo.encoder[1],
    )


def _share(lag: float, h: float) -> float:
    """Return what a lag moves in a step: y += a (x - y) is (1 - a) / a steps late at low frequencies."""
    return h / (h + lag) if lag > 0.0 else 1.0


def biquad(notch: tuple[float, float, float], h: float) -> Floats:
    """Return b0, b1, b2, a1, a2 of a notch by the bilinear map, exact at its frequency."""
    t = math.tan(min(math.pi * notch[0] * h, 1.5))
    zeros, poles = notch[1], notch[2]
    a0 = 1.0 + 2.0 * poles * t + t * t
    middle = 2.0 * (t * t - 1.0) / a0
    first, last = 1.0 + 2.0 * zeros * t + t * t, 1.0 - 2.0 * zeros * t + t * t
    return np.array([first / a0, middle, last / a0, middle, (1.0 - 2.0 * poles * t + t * t) / a0])


def state(servos: Servos, tape_size: int, start: Floats, tables: Lookup, modes: Modes) -> Coupled:
    """Return a machine at rest at zero."""
    nv, z = len(servos.kind), np.zeros
    t = z(tape_size)
    t[: len(start)] = start
    dry = len(tables.directions)
    return Coupled(
        q=z(nv),
        v=z(nv),
        a=z(nv),
        e=z(nv),
        u=z(nv),
        w=z(nv),
        act=z(nv),
        seen=z(nv),
        before=z(nv),
        wound=z(nv),
        out=z(nv),
        past=z((nv, 2)),
        late=z((nv, int(servos.whole.max(initial=0)) + 2)),
        at=np.zeros(1, dtype=np.int64),
        pace=z(nv),
        turn=z(dry),
        low=z(dry),
        high=z(dry),
        bend=z((len(tables.slips), tables.give.shape[1] + 1)),
        where=z(len(tables.slips)),
        twist=z((len(modes.joint), 2)),
        c=z((3, nv)),
        p=z((4, nv)),
        t=t,
        M=z((nv, nv)),
        h=z(nv),
        r=z(nv),
        A=z((nv, nv)),
        X=z((nv, nv)),
        one=z(3),
    )


def records(n: int, nv: int, full: bool) -> Record:
    """Return arrays for the results."""
    rows = n if full else 0
    q, e, u = (np.zeros((n, nv)) for _ in range(3))
    v, a, d = (np.zeros((rows, nv)) for _ in range(3))
    return Record(q, e, u, v, a, d)


__all__ = [
    "LONGEST",
    "Coupled",
    "Modes",
    "Servos",
    "mode_arrays",
    "records",
    "servo_arrays",
    "state",
    "substeps",
]
