"""Commands for a machine: drilling-cycle moves, multisines, slow reversals, constant speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.trajectories.profiles import Limited, Profile, Sines, chain, move_pieces, move_time, rest


@dataclass(frozen=True)
class Limits:
    """Kinematic limits of an axis."""

    speed: float | None = None  # [m/s or rad/s]
    acceleration: float | None = None  # [m/s² or rad/s²]
    jerk: float | None = None  # [m/s³ or rad/s³]
    travel: tuple[float, float] | None = None  # lowest and highest position of trajectories [m or rad]


class HasLimits(Protocol):
    """A machine, as far as a trajectory needs to know it: the limits of every axis, in order."""

    @property
    def limits(self) -> Mapping[str, Limits]:
        """Kinematic limits of every axis, in order."""


@dataclass(frozen=True)
class Trajectory:
    """The command of every axis."""

    seconds: float  # length [s]
    profiles: Mapping[str, Profile]  # axis -> its command

    def at(self, t: Floats, axes: Sequence[str]) -> tuple[Floats, Floats, Floats]:
        """Return position, velocity and acceleration, each of shape (n, len(axes))."""
        for name in axes:
            if name not in self.profiles:
                raise DataError(f"trajectory has no command for axis {name!r}")
        q, v, a = (np.stack([self.profiles[n](t, k) for n in axes], axis=1) for k in range(3))
        return q, v, a


def _travel(limits: Limits) -> tuple[float, float]:
    return limits.travel or (-0.1, 0.1)


def _triple(limits: Limits) -> Limited:
    if limits.speed is None or limits.acceleration is None or limits.jerk is None:
        raise DataError("a trajectory needs limits of speed, acceleration and jerk")
    return limits.speed, limits.acceleration, limits.jerk


def random_trajectory(
    machine: HasLimits,
    seconds: float,
    seed: int,
    limits: Mapping[str, Limits] | None = None,
    *,
    synchronised: float = 0.5,
    dwell: tuple[float, float] = (0.05, 0.4),
) -> Trajectory:
    """Return random simultaneous point-to-point moves of random axes, each then with a dwell, as in a drilling cycle.

    Over so many ``seconds`` [s], some axes with other ``limits``. In the share ``synchronised`` of the steps [-] all
    arrive together, else each moves as fast as it can; ``dwell``: shortest and longest [s].
    """
    rng = np.random.default_rng(seed)
    all_limits = {**machine.limits, **(limits or {})}
    home = {name: float(np.mean(_travel(lim))) for name, lim in all_limits.items()}
    here = dict(home)
    moves: dict[str, list[tuple[list[tuple[float, float]], float]]] = {n: [] for n in all_limits}
    t = float(rng.uniform(0.2, 0.3))
    while True:
        targets = _targets(all_limits, here, rng)
        times = {n: move_time(x - here[n], _triple(all_limits[n])) for n, x in targets.items()}
        longest = max(times.values())
        together = rng.uniform() < synchronised
        if t + longest > seconds - 0.1:
            break
        for name, target in targets.items():
            stretch = longest / times[name] if together else 1.0
            pieces = move_pieces(t, target - here[name], _triple(all_limits[name]), stretch)
            moves[name].append((pieces, target))
            here[name] = target
        t += longest + float(rng.uniform(*dwell))
    return Trajectory(seconds, {name: chain(home[name], moves[name]) for name in all_limits})


def _targets(
    limits: Mapping[str, Limits], here: Mapping[str, float], rng: np.random.Generator
) -> dict[str, float]:
    """Return targets of a random subset of the axes: far moves and short steps mixed."""
    names = list(limits)
    chosen = [n for n in names if rng.uniform() < 0.75] or [names[rng.integers(len(names))]]
    targets = {}
    for name in chosen:
        low, high = _travel(limits[name])
        if rng.uniform() < 0.3:
            step = 0.08 * (high - low) * float(rng.uniform(0.2, 1.0))
            target = here[name] + step * float(rng.choice((-1.0, 1.0)))
            target = target if low <= target <= high else 2.0 * here[name] - target
        else:
            target = float(rng.uniform(low, high))
        if abs(target - here[name]) > 1e-6 * (high - low):
            targets[name] = target
    return targets or {names[0]: float(np.mean(_travel(limits[names[0]]))) + 1e-3}


def multisine(machine: HasLimits, seconds: float, seed: int, lines: int = 14) -> Trajectory:
    """Return sines of 0.2 to 15 Hz for some seconds [s] on every axis within its limits, interleaved."""
    rng = np.random.default_rng(seed)
    names = list(machine.limits)
    grid = np.geomspace(0.2, 15.0, lines * len(names))
    profiles: dict[str, Profile] = {}
    t = np.arange(0.0, seconds, 1e-3)
    for i, name in enumerate(names):
        low, high = _travel(machine.limits[name])
        frequency = grid[i :: len(names)]
        amplitude = 1.0 / (1.0 + (frequency / 1.0) ** 2)
        phase = rng.uniform(0.0, 2.0 * np.pi, lines)
        raw = Sines(0.0, amplitude, frequency, phase, seconds)
        peaks = [max(float(np.abs(raw(t, k)).max()), 1e-12) for k in range(3)]
        speed, acceleration, _ = _triple(machine.limits[name])
        room = (0.5 * (high - low), 0.98 * speed, 0.98 * acceleration)
        scale = min(r / p for r, p in zip(room, peaks, strict=True))
        profiles[name] = Sines(0.5 * (low + high), scale * amplitude, frequency, phase, seconds)
    return Trajectory(seconds, profiles)


def slow_reversals(
    machine: HasLimits,
    axis: str,
    *,
    strokes: Sequence[float] = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1),
    speed: float = 0.02,
    repeats: int = 3,
) -> Trajectory:
    """Return slow moves to and fro of one axis, of growing strokes [shares of travel], ``speed`` [of its limit]."""
    low, high = _travel(machine.limits[axis])
    v, a, j = _triple(machine.limits[axis])
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    plan = [middle + stroke * half * s for stroke in strokes for s in (1, -1) * repeats]
    return _one_axis(machine, axis, plan, [(speed * v, a, j)] * len(plan))


def constant_speeds(
    machine: HasLimits, axis: str, *, shares: Sequence[float] = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
) -> Trajectory:
    """Return runs of one axis at constant speeds, shares of its limit [-]: viscous, Stribeck, drag."""
    low, high = _travel(machine.limits[axis])
    v, a, j = _triple(machine.limits[axis])
    plan, limits = [], []
    for share in shares:
        # A slow run covers less travel, so that no speed takes more than about four seconds.
        half = min(0.5 * (high - low), 2.0 * share * v)
        plan += [0.5 * (low + high) + half * s for s in (1.0, -1.0)]
        limits += [(share * v, a, j)] * 2
    return _one_axis(machine, axis, plan, limits)


def _one_axis(machine: HasLimits, axis: str, plan: Sequence[float], limits: Sequence[Limited]) -> Trajectory:
    centre = {n: float(np.mean(_travel(lim))) for n, lim in machine.limits.items()}
    t, here, moves = 0.3, centre[axis], []
    for target, lim in zip(plan, limits, strict=True):
        moves.append((move_pieces(t, target - here, lim), target))
        t, here = t + move_time(target - here, lim) + 0.2, target
    profiles: dict[str, Profile] = {n: rest(q) for n, q in centre.items()}
    profiles[axis] = chain(centre[axis], moves)
    return Trajectory(t + 0.2, profiles)


def replay(log: Mapping[str, Floats], axes: Sequence[str]) -> Trajectory:
    """Return the command that a log holds (``<axis>.qr``), to be run again."""
    missing = [n for n in axes if f"{n}.qr" not in log]
    if missing:
        raise DataError(f"log has no command channel {missing[0]}.qr")
    t = np.asarray(log["t"]) - log["t"][0]
    profiles = {n: _joined(t, np.asarray(log[f"{n}.qr"])) for n in axes}
    return Trajectory(float(t[-1]), profiles)


def _joined(t: Floats, q: Floats) -> Profile:
    """Return samples as a cubic spline that stands still outside of them."""
    spline = CubicSpline(t, q)
    return lambda at, order: spline(np.clip(at, t[0], t[-1]), order)
