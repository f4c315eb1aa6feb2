"""The law of a controller (:mod:`pinotwin.loop.servo`) in steps: the one place where compiled code knows it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.stepping import inlined
from pinotwin.loop.servo import Servo

LONGEST = 2.5e-4  # Longest internal step [s]


class Law(NamedTuple):
    """One controller at one internal step: numbers alone, so that several are records of one array."""

    e: float  # the six gains of :mod:`pinotwin.loop.servo`, to ``ar``
    integral: float
    v: float
    vr: float
    slip: float
    ar: float
    see: float  # what the velocity filter moves in a step
    lag: float  # what the current loop moves in a step
    b0: float  # of the notch, with ``b1``, ``b2``, ``a1`` and ``a2``; no notch where it is 0
    b1: float
    b2: float
    a1: float
    a2: float
    whole: float  # dead time in whole steps
    part: float  # and the rest of it
    limit: float  # largest effort
    offset: float  # what the integrator begins with; NaN for what the effort at the start asks for
    tick: float  # step of the encoder by which the law is closed; 0 for none
    origin: float  # of its steps

    @classmethod
    def of(cls, servo: Servo, h: float) -> Law:
        """Return a controller at the internal step h [s]."""
        steps = max(servo.dead, 0.0) / h
        offset = servo.offset if servo.form == "proportional" else math.nan
        # y += a (x - y) is (1 - a) / a steps late at low frequencies
        lags = (h / (h + max(lag, 0.0)) for lag in (servo.velocity_lag, servo.output_lag))
        notch = biquad(servo.notch, h) if servo.notch[0] > 0.0 else np.zeros(5)
        dead = (float(int(steps)), steps - int(steps))
        numbers = [*servo.gains, *lags, *notch.tolist(), *dead, servo.limit, offset, *servo.encoder]
        return cls(*numbers)


def law_rows(servos: Sequence[Servo | None], h: float) -> np.ndarray:
    """Return controllers at the internal step h, one record a joint, (nv,); zeros of a joint without one."""
    nothing = (0.0,) * len(Law._fields)
    laws = [nothing if servo is None else tuple(Law.of(servo, h)) for servo in servos]
    return np.array(laws, dtype=[(name, float) for name in Law._fields])


def biquad(notch: tuple[float, float, float], h: float) -> Floats:
    """Return b0, b1, b2, a1, a2 of a notch by the bilinear map, exact at its frequency."""
    t = math.tan(min(math.pi * notch[0] * h, 1.5))
    zeros, poles = notch[1], notch[2]
    a0 = 1.0 + 2.0 * poles * t + t * t
    middle = 2.0 * (t * t - 1.0) / a0
    first, last = 1.0 + 2.0 * zeros * t + t * t, 1.0 - 2.0 * zeros * t + t * t
    return np.array([first / a0, middle, last / a0, middle, (1.0 - 2.0 * poles * t + t * t) / a0])


def substeps(sampling: float, longest: float = LONGEST) -> int:
    """Return the internal steps a sample: friction is implicit, so that only the loops' speed counts."""
    return max(1, math.ceil(sampling / longest - 1e-9))


@inlined
def shown(law, q):  # type: ignore[no-untyped-def]
    """Return the position that the encoder shows."""
    return q if law.tick == 0.0 else law.origin + law.tick * np.floor((q - law.origin) / law.tick + 0.5)


@inlined
def asked(law, h, c, q, v, state):  # type: ignore[no-untyped-def]
    """Step a law by h [s]; return its state: velocity seen, integral, effort after the current loop, notch (2)."""
    seen, wound, out, first, second = state
    e = c[0] - shown(law, q)
    seen += law.see * (v - seen)
    u = law.e * e + wound - law.v * seen + law.vr * c[1] + law.ar * c[2]
    if law.b0 != 0.0:
        y = law.b0 * u + first
        first = law.b1 * u - law.a1 * y + second
        second = law.b2 * u - law.a2 * y
        u = y
    if abs(u) <= law.limit:
        wound += h * (law.integral * e + law.slip * c[1])
    else:
        u = law.limit if u > 0.0 else -law.limit
    return seen, wound, out + law.lag * (u - out), first, second


@inlined
def acts(law, late, j, at, out):  # type: ignore[no-untyped-def]
    """Put an effort in its place ``at`` of row j; return the one that acts after the dead time."""
    late[j, at] = out
    i = at - int(law.whole)
    if i < 0:
        i += late.shape[1]
    return late[j, i] + law.part * (late[j, i - 1 if i > 0 else late.shape[1] - 1] - late[j, i])


@inlined
def begun(law, c, q, v, u):  # type: ignore[no-untyped-def]
    """Return the state in which a law asks for the effort u: its integrator is wound up, unless it has none."""
    asks = law.e * (c[0] - shown(law, q)) - law.v * v + law.vr * c[1] + law.ar * c[2]
    wound = u - asks if np.isnan(law.offset) else law.offset
    return v, wound, u, u * (1.0 - law.b0), u * (law.b2 - law.a2)
