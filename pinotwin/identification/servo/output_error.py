"""The gains and shapes with which the simulated axis shows the error and the effort of the log.

Output error (Ljung 1999, 7.2) by Levenberg-Marquardt, on windows that begin in the measured state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.identification.servo.problem import AS_FOUND, PLANT, AxisProblem, Factors, Usual
from pinotwin.loop.servo import SHAPES, Servo

FORWARD = (-0.5, 1.5, 0.5)
"""Acceleration feed-forward that drives have, least and most, as shares of the axis' inertia, and the standard
deviation of what is beyond; any within is as usual as another.

A slow ramp does not tell it, and a faster command would throw the simulated axis off.
"""
NAMED = ("kp", "kv", "rate", "ffv", "ffa")
NOTCH = ("notch0", "notch1", "notch2")
LOGARITHMIC = (*SHAPES, *NOTCH, *PLANT)


@dataclass(frozen=True)
class Search:
    """What is searched: the gains in their own sizes, the shapes by logarithm."""

    start: Servo
    names: tuple[str, ...]
    scale: Floats

    def values(self, x: Floats) -> dict[str, float]:
        """Return what is searched at a point, by name."""
        rows = zip(self.names, x, self.scale, strict=True)
        return {k: float(s * (np.exp(y) if k in LOGARITHMIC else y)) for k, y, s in rows}

    def servo(self, x: Floats) -> Servo:
        """Return the controller at a point."""
        values, start = self.values(x), self.start
        gains = tuple(values.get(f"gain{i}", gain) for i, gain in enumerate(start.gains))
        a, b, c = (values.get(name, y) for name, y in zip(NOTCH, start.notch, strict=True))
        shapes: dict[str, Any] = {k: values[k] for k in (*SHAPES, "offset") if k in values}
        if named := {k: values[k] for k in NAMED if k in values}:
            lag = shapes.get("velocity_lag", start.velocity_lag)
            gains = Servo.of_cascade(**named, velocity_lag=lag).gains
        return replace(start, gains=gains, notch=(a, b, c), **shapes)

    def doubt(self, x: Floats, usual: Usual, inertia: float) -> Floats:
        """Return how far shapes and feed-forward are from usual ones, in standard deviations of what drives have."""
        share, (least, most, beyond) = self.servo(x).gains[5] / inertia, FORWARD
        shapes = {name: value for name, value in self.values(x).items() if name in usual}
        far = [float(np.log(value / usual[name][0])) / usual[name][1] for name, value in shapes.items()]
        return np.array([(share - min(max(share, least), most)) / beyond, *far])

    def extra(self, x: Floats) -> Factors:
        """Return the factors on the plant at a point."""
        values = self.values(x)
        return tuple(values.get(name, 1.0) for name in PLANT)  # type: ignore[return-value]


def search_of(servo: Servo, plant: Sequence[str] = (), offset_scale: float = 1.0) -> tuple[Search, Floats]:
    """Return the search and its start for the form of a controller."""
    g = np.array(servo.gains)
    typical = np.maximum(np.abs(g), 1e-12)
    typical[4] = max(abs(g[4]), 0.05 * abs(g[1]) * abs(g[2]) / max(abs(g[0]), 1e-12))
    rows = [(f"gain{i}", typical[i], g[i] / typical[i]) for i in free_gains(servo)]
    if servo.form == "cascade":
        named = servo.cascade()
        sizes = [(k, abs(named[k]) or 1.0) for k in NAMED]
        rows += [(k, size, named[k] / size) for k, size in sizes]
    if servo.form == "proportional":
        rows.append(("offset", offset_scale, servo.offset / offset_scale))
    shapes = [(k, getattr(servo, k)) for k in SHAPES if getattr(servo, k) > 0.0]
    shapes += zip(NOTCH, servo.notch, strict=True) if servo.notch[0] > 0.0 else ()
    rows += [(k, size, 0.0) for k, size in (*shapes, *((k, 1.0) for k in plant))]
    names, scale, x = zip(*rows, strict=True)
    return Search(servo, names, np.array(scale)), np.array(x)


def free_gains(form: Servo) -> list[int]:
    """Return which of the six gains a form has; feed-forward of a proportional law is searched where there is any."""
    forward = [i for i in (3, 5) if form.gains[i] != 0.0]
    kept: dict[str, list[int]] = {"proportional": [0, 2, *forward], "pid": [0, 1, 2, 3, 5], "cascade": []}
    return kept.get(form.form, [0, 1, 2, 3, 4, 5])


@dataclass(frozen=True)
class Found:
    """A controller with its error on the windows it was fitted to; ``slopes`` finds its Jacobian."""

    servo: Servo
    cost: float
    extra: Factors
    x: Floats
    slopes: Callable[[], Floats]
    residual: Floats
    search: Search
    noise: Floats
    held_out: tuple[float, float] = (np.nan, np.nan)
    trial: Servo | None = None
    factors: Factors = AS_FOUND

    @cached_property
    def jacobian(self) -> Floats:
        """Slopes of the residuals and of the doubts, shape (m, k); only the last answer of a search is asked."""
        return self.slopes()

    @property
    def errors(self) -> tuple[float, float]:
        """Errors of e and u on the windows that were fitted, each over its RMS."""
        e, u = np.sqrt(np.sum(self.residual.reshape(-1, 2) ** 2, axis=0)) * self.noise
        return float(e), float(u)


def misfit(p: AxisProblem, servo: Servo, extra: Factors = AS_FOUND) -> Floats | None:
    """Return the residuals of e and u over their sizes, shape (2 rows,), or None."""
    y = p.response(servo, extra)
    if y is None or not np.isfinite(y).all():
        return None
    return ((y - p.measured) / (p.sizes * p.noise)).ravel() / np.sqrt(len(y))


def polish(
    p: AxisProblem, servo: Servo, plant: Sequence[str] = (), steps: int = 12, known: Floats | None = None
) -> Found | None:
    """Return the controller that predicts e and u best, by Levenberg-Marquardt from a start.

    From a law that holds its axis it goes to such alone: short windows may be shown as well by a loop that grows
    slowly. What is named of :data:`PLANT` is searched beside it; ``known`` tells of the start, shape (j, k): its
    transpose times itself inverts a covariance.
    """
    search, x = search_of(servo, plant, float(p.sizes[1]))
    begun = x
    rows = sum(s.stop - s.start - p.skip for s in p.windows)
    doubt = np.sqrt(p.correlated / max(rows, 1))
    guarded = p.holds(servo)

    def allowed(x: Floats) -> bool:
        return not guarded or p.holds(search.servo(x), search.extra(x))

    def at(x: Floats) -> Floats | None:
        r = misfit(p, search.servo(x), search.extra(x))
        if r is None:
            return None
        told = [search.doubt(x, p.usual, p.inertia), *([] if known is None else [known @ (x - begun)])]
        return np.concatenate([r, doubt * np.concatenate(told)])

    found = descend(at, p.step_of_slopes, x, allowed, steps)
    if found is None:
        return None
    x, r = found

    def slopes() -> Floats:
        return differences(at, x, r, p.step_of_slopes)

    return Found(search.servo(x), float(r @ r), search.extra(x), x, slopes, r[: 2 * rows], search, p.noise)


def descend(
    at: Callable[[Floats], Floats | None],
    size: float,
    x: Floats,
    allowed: Callable[[Floats], bool],
    steps: int,
    longest: float = 0.7,
    enough: float = 1e-3,
) -> tuple[Floats, Floats] | None:
    """Return where a sum of squares is least near a start, shape (k,), and its residuals (Levenberg-Marquardt)."""
    r = at(x)
    if r is None:
        return None
    damping, cost, small = 1e-3, float(r @ r), 0
    for _ in range(steps):
        J = differences(at, x, r, size)
        A, g, trial, move = J.T @ J, J.T @ r, None, x
        for _ in range(9):
            full = np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-12), -g)
            move = np.asarray(full * min(1.0, longest / max(float(np.abs(full).max()), 1e-300)), dtype=float)
            trial = at(x + move) if allowed(x + move) else None
            if trial is not None and float(trial @ trial) < cost:
                break
            trial, damping = None, damping * 6.0
        if trial is None:
            break
        small = small + 1 if float(trial @ trial) > (1.0 - enough) * cost else 0
        x, r, cost = x + move, trial, float(trial @ trial)
        damping = max(damping / 30.0, 1e-9)
        if small == 2:
            break
    return x, r


def differences(at: Callable[[Floats], Floats | None], x: Floats, r: Floats, size: float) -> Floats:
    """Return the slopes of residuals r at a point, shape (m, k), by difference quotients; 0 where there are none."""
    J = np.zeros((len(r), len(x)))
    for i in range(len(x)):
        for step in (size, -size):
            moved = x.copy()
            moved[i] += step
            there = at(moved)
            if there is not None:
                J[:, i] = (there - r) / step
                break
    return J
