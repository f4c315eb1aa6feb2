"""The gap of the vibration of passive joints, where the logs hold it: the twin's springs against the log.

What the axes do to a joint is known (:mod:`pinotwin.analysis.deflection`); its own stiffness and damping are fitted
anew, and judged on rows that were not. Only the band of the vibration counts: no IMU knows the slow angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from pinotwin.analysis.deflection import Load, PassiveSpring, is_measured, load_of, springs
from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.conclusion.explained import drawn, stated_of
from pinotwin.diagnosis.conclusion.where import Cell, bins, concentrated
from pinotwin.diagnosis.result import Found, Gap, Region, Shrink
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.signals.blocks import posterior
from pinotwin.logs.prepared import Prepared
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.signals.filters import edge_rows, vibration_band
from pinotwin.solve.sandwich import block_covariance
from pinotwin.twin import Twin
from pinotwin.units import of_axis

BLOCK = 0.5
"""Length of data that counts as one stretch [s]; every other one is fitted without a validation log."""


@dataclass(frozen=True)
class Vibrations:
    """What a diagnosis says of passive joints."""

    gaps: dict[str, Gap]  # joint -> gap of its velocity [m/s or rad/s]
    effects: list[Found]  # springs that have changed
    where: list[Region]  # regions in which the gaps lie


def look_at_vibration(
    subject: Machine | Twin,
    logs: Sequence[Prepared],
    validation: Sequence[bool],
    commands: Sequence[int],
    rng: np.random.Generator,
) -> Vibrations:
    """Return the gap of every passive joint whose velocity the logs hold, and why it is there."""
    out = Vibrations({}, [], [])
    if not isinstance(subject, Twin) or not springs(subject):
        return out
    motions = [replace(one.motion, decimation=1) for one in logs]
    for spring in springs(subject):
        runs = [
            _Run.of(subject, m, spring.index, label, sealed)
            for m, label, sealed in zip(motions, commands, validation, strict=True)
            if is_measured(m, spring.index)
        ]
        if not all(r.sealed for r in runs):
            _judge(spring, _Split(runs), rng, out)
    return out


def unused(subject: Machine | Twin, logs: Sequence[Prepared]) -> list[str]:
    """Return what to do about vibrations that the logs hold and nothing is compared with."""
    if isinstance(subject, Twin):
        return []
    names = [p for p in subject.passive if any(f"{p}.v" in one.log for one in logs)]
    why = "a machine does not know its spring: identify a twin with this log and diagnose that"
    return [f"the vibration of {p} is in the log, but {why}" for p in names]


@dataclass(frozen=True)
class _Run:
    """One joint in one log; rows within the band."""

    sealed: bool  # whether nothing is fitted to it
    command: int  # label of its command
    load: Load  # what drives the joint
    measured: Floats  # velocity, shape (m,)
    rows: Ints  # rows of the motion that they belong to, shape (m,)

    @classmethod
    def of(cls, twin: Twin, motion: Motion, joint: int, command: int, sealed: bool) -> _Run:
        """Return the run of one log."""
        rate, rows = 1.0 / motion.step, []
        for s in motion.segments:
            edge = edge_rows(s.stop - s.start, rate)
            rows.append(np.arange(s.start + edge, s.stop - edge))
        load = load_of(twin.machine, twin.coefficients("rigid_body"), motion, joint)
        return cls(sealed, command, load, _banded(motion, motion.v[:, joint]), np.concatenate(rows))

    def left(self, spring: PassiveSpring) -> Floats:
        """Return measured minus predicted velocity, shape (m,)."""
        return self.measured - _banded(self.load.motion, self.load.response(spring)[1])


def _banded(motion: Motion, x: Floats) -> Floats:
    rate = 1.0 / motion.step
    return np.concatenate([vibration_band(x[s, None], rate)[:, 0] for s in motion.segments])


@dataclass(frozen=True)
class _Split:
    """Runs of one joint: what may be fitted, and what is judged on."""

    runs: Sequence[_Run]

    def part(self, values: Sequence[Floats], *, fitted: bool) -> Floats:
        """Return the rows that are fitted, or those that are not."""
        if any(r.sealed for r in self.runs):
            return np.concatenate([x for x, r in zip(values, self.runs, strict=True) if r.sealed != fitted])
        return np.concatenate([x[(np.arange(len(x)) // self.block % 2 == 0) == fitted] for x in values])

    def left(self, spring: PassiveSpring, *, fitted: bool) -> Floats:
        """Return measured minus predicted velocity of the rows that are fitted, or of the others."""
        return self.part([r.left(spring) for r in self.runs], fitted=fitted)

    @property
    def block(self) -> int:
        """Rows that count as one stretch."""
        return max(round(BLOCK / self.runs[0].load.motion.step), 1)

    def noise(self, spring: PassiveSpring) -> float:
        """Return the RMS by which repeats differ, over sqrt(2); without repeats, of the quietest blocks."""
        for a, b in combinations(self.runs, 2):
            if a.command == b.command:
                n = min(len(a.measured), len(b.measured))
                return float(np.std(a.measured[:n] - b.measured[:n]) / np.sqrt(2.0))
        left = np.concatenate([r.left(spring) for r in self.runs])
        blocks = np.array_split(left, max(len(left) // self.block, 1))
        return float(np.quantile([rms(x) for x in blocks], RULES.vibration_quiet))


def _judge(spring: PassiveSpring, runs: _Split, rng: np.random.Generator, out: Vibrations) -> None:
    """Fill in what is said of one joint."""
    found, moved = _refitted(spring, runs)
    noise = runs.noise(found)
    before, after = (runs.left(x, fitted=False) for x in (spring, found))
    x, y = (runs.left(k, fitted=True) for k in (spring, found))
    size = rms(runs.part([r.measured for r in runs.runs], fitted=False))
    promised = float(_share(rms(x) ** 2, rms(y) ** 2, noise**2))
    shrink, sure = _shrink((before, after), promised, noise, runs)
    least = max((1.0 + RULES.vibration_gap) * noise**2, noise**2 + (RULES.vibration_form * size) ** 2)
    there = rms(before) ** 2 > least
    named = (
        there
        and shrink.share > RULES.vibration_share
        and max(abs(x[2]) for x in moved.values()) > RULES.vibration_moved
    )
    rest = rms(after) if named else rms(before)
    out.gaps[spring.name] = Gap(rms(before), rms(before) / max(size, 1e-300), noise, rest)
    if not there:
        return
    out.where.extend(_where(spring, runs, rng))
    if named:
        out.effects.append(_named(spring, found, runs, shrink, moved, sure))


Moves = dict[str, tuple[float, float, float]]


def _refitted(spring: PassiveSpring, runs: _Split) -> tuple[PassiveSpring, Moves]:
    """Return the spring that the rows to be fitted ask for, and by how many (block sandwich) errors it moved."""

    def shaped(x: Floats) -> PassiveSpring:
        k, c = np.exp(x) * [spring.stiffness, max(spring.damping, 1e-9)]
        return replace(spring, stiffness=float(k), damping=float(c))

    def left(x: Floats) -> Floats:
        return runs.left(shaped(x), fitted=True)

    scale = max(rms(left(np.zeros(2))), 1e-300)
    best = least_squares(lambda x: left(x) / scale, np.zeros(2), bounds=([-2.0, -4.0], [2.0, 4.0]))
    J, e = best.jac, best.fun
    error = np.sqrt(np.maximum(np.diag(block_covariance(J, e)), 1e-18))
    found = shaped(best.x)
    old, new = (spring.stiffness, spring.damping), (found.stiffness, found.damping)
    rows = zip("kc", old, new, best.x / error, strict=True)
    return found, {f"{spring.name}.spring.{k}": (a, b, float(far)) for k, a, b, far in rows}


def _share(before: float | Floats, after: float | Floats, noise: float) -> Floats:
    """Return the share of mean squares that goes of what is above the noise's [1]."""
    return np.clip((before - after) / np.maximum(before - noise, 0.02 * before + 1e-300), -1.0, 1.0)


def _shrink(
    unseen: tuple[Floats, Floats], promised: float, noise: float, runs: _Split
) -> tuple[Shrink, float]:
    """Return how far other springs shrink the gap on unseen rows, with the share of resampled blocks that name it."""
    blocks = max(len(unseen[0]) // runs.block, 1)
    powers = [np.array([x @ x for x in np.array_split(y, blocks)]) / len(y) for y in unseen]
    drawn_before, drawn_after = drawn(*powers)
    each = _share(drawn_before, drawn_after, noise**2)
    low, high = np.quantile(each, [0.05, 0.95]).tolist()
    on = "validation" if any(r.sealed for r in runs.runs) else "held-out blocks"
    before, after = map(rms, unseen)
    share = float(_share(before**2, after**2, noise**2))
    sure = posterior(int(np.sum(each > RULES.vibration_share)), len(each))
    return Shrink(before, after, share, (low, high), promised, on), sure


def _where(spring: PassiveSpring, runs: _Split, rng: np.random.Generator) -> list[Region]:
    """Return when the gap is there, and while which axes accelerate."""
    left = [r.left(spring) for r in runs.runs]
    t = np.concatenate([r.load.motion.t[r.rows] for r in runs.runs])
    cells = bins("time", t, "s", 8)
    motion = runs.runs[0].load.motion
    for joint, name in enumerate(motion.names):
        a = np.concatenate([np.abs(r.load.motion.a[r.rows, joint]) for r in runs.runs])
        top = float(a.max())
        if joint != spring.index and top > 0.0:
            unit = of_axis("x/s²", motion.rotary[joint])
            cells.append(Cell("other_axis", (0.1 * top, top), unit, a > 0.1 * top, name))
    cells = [c for c in cells if 0.01 < c.mask.mean() < 0.95]
    power = np.concatenate(left) ** 2
    return concentrated(cells, power, spring.name, "v", rng) if cells else []


def _named(
    old: PassiveSpring, new: PassiveSpring, runs: _Split, shrink: Shrink, moved: Moves, sure: float
) -> Found:
    inertia = float(np.mean([r.load.inertia.mean() for r in runs.runs]))
    wn, zeta = new.mode(inertia)
    shape, theta = {"frequency": wn / (2.0 * np.pi), "damping": zeta}, {"k": new.stiffness, "c": new.damping}
    gain = float(len(runs.runs[0].measured) * np.log(shrink.before / max(shrink.after, 1e-300)))
    whole = {"v": stated_of(shrink.before, shrink)}
    return Found("joint_flexibility", old.name, sure, shape, theta, whole, [], moved, gain=gain)
