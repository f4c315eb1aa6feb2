"""What to record next, and the command that does it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.sizes import undetermined
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.phrases import effect_words
from pinotwin.diagnosis.result import Found
from pinotwin.diagnosis.rules import RULES
from pinotwin.effects import known
from pinotwin.effects.family import FRICTION
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.system.phrases import joined
from pinotwin.trajectories.moves import Limits, Trajectory, constant_speeds, multisine, slow_reversals

PAIRS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (
        ("coulomb_asymmetric", "offset", "rigid_body"),
        "hold several postures with the brake off and read the effort",
        "slow",
    ),
    (
        ("effort_scale", "rigid_body"),
        "add a payload of known mass and record the effort again",
        "slow",
    ),
    (
        ("delay", "drive_flexibility", "joint_flexibility", "encoder_error"),
        "record a multisine beyond the resonance; a delay shifts the phase with frequency, a resonance peaks",
        "multisine",
    ),
    (
        ("viscous", "stribeck", "quadratic_drag", "viscous_thermal", "load_friction", "viscous_asymmetric"),
        "record constant speeds from 1 to 100 %, both directions",
        "speeds",
    ),
    (
        ("presliding", "backlash", "encoder_error", "stribeck"),
        "record slow reversals of growing stroke, from 1 µm (1 mdeg) up",
        "slow",
    ),
    (
        ("ripple", "ripple_modulated", "position_table", "encoder_error", "geometric_error"),
        "record the same travel at two speeds; a position effect stays put, a time effect shifts",
        "speeds",
    ),
)
"""Effects that are easily taken for each other, what tells them apart, and the kind of motion that shows it."""


def advise(
    c: Comparison,
    noise: str,
    named: Sequence[Found],
    open_axes: Collection[str],
    seen: Collection[str],
    pairs: Sequence[tuple[str, str]] = (),
) -> tuple[list[str], list[str]]:
    """Return sentences of advice and the kinds of motion that they ask for; ``pairs``: effects not told apart."""
    words = [*_of_one_run(c, named), *_of_other_state(c, open_axes)]
    if noise == "assumed":
        words.append(
            "record the same command twice; the difference of the runs is the noise, which is assumed here"
        )
    if c.new.motion.qr is None:
        words.append("log the command (<axis>.qr) as well; without it only the open loop is diagnosed")
    told: dict[tuple[str, str], dict[str, list[str]]] = {}
    for a, b in pairs:
        way = next(((text, kind) for group, text, kind in PAIRS if {a, b} <= {*group}), None)
        if way is not None:
            told.setdefault(way, {}).setdefault(a, []).append(b)
    for (text, _), rivals in told.items():
        apart = "; ".join(
            f"{effect_words(a)} from {joined([effect_words(b) for b in dict.fromkeys(bs)])}"
            for a, bs in rivals.items()
        )
        words.append(f"to separate {apart}: {text}")
    still = "hardly moves in these logs, or its effort is missing: it is not judged"
    words += [*_untold(named), *(f"{x} {still}" for x in c.machine.axes if x not in seen)]
    return words, list(dict.fromkeys(kind for _, kind in told))


def _untold(named: Sequence[Found]) -> list[str]:
    """Return what to do where these logs do not determine a payload's mass or centre."""
    told = [(e.axis, undetermined(e.size)) for e in named if e.effect == "payload" and "m" in e.theta]
    return [
        f"these logs do not determine the {' and the '.join(missing)} of the payload on {axis}; turn its link "
        "under gravity, or accelerate it along other axes"
        for axis, missing in told
        if missing
    ]


def _of_one_run(c: Comparison, named: Sequence[Found]) -> list[str]:
    """Return a word on friction that has changed against a twin that knows the friction of one run alone."""
    axes = [str(e.axis) for e in named if _rubs(e.effect) or any(_rubs(o["effect"]) for o in e.alternatives)]
    if not c.change or len(c.twin.data) != 1 or not axes:
        return []
    return [
        "identify the twin from several healthy runs; with one it does not know the normal variation of friction of "
        f"{', '.join(dict.fromkeys(axes))}"
    ]


def _rubs(effect: str) -> bool:
    kind = known().get(effect)
    return kind is not None and kind.family is FRICTION


def _of_other_state(c: Comparison, open_axes: Collection[str]) -> list[str]:
    """Return a word on validation logs that do not show what the diagnosed logs show of some axes."""
    if not c.change or c.unseen is None:
        return []
    out = []
    for j in c.unseen.joints:
        name = c.machine.names[j]
        today, there = (rms(s.residual[j]) / max(s.size(j), 1e-300) for s in (c.new, c.unseen))
        if name in open_axes and there < RULES.other_state * today:
            out.append(
                f"{name}: the validation log shows {there / today:.0%} of its residual; if it was recorded before the "
                "change, leave it out"
            )
    return out


@dataclass(frozen=True)
class _Visited:
    """The limits of the moves that a log has shown of an axis; it gets up to its speed within its travel."""

    limits: Mapping[str, Limits]

    @classmethod
    def of(cls, motion: Motion, axis: str) -> _Visited:
        j = motion.index(axis)
        q, v, a = (x[:, j] for x in (motion.q, motion.v, motion.a))
        top, travel = max(float(np.abs(v).max()), 1e-6), max(float(np.ptp(q)), 1e-6)
        push = max(float(np.quantile(np.abs(a), 0.995)), top**2 / travel)
        jolt = max(float(np.quantile(np.abs(np.diff(a)), 0.995)) / motion.step, push**2 / top)
        return cls({axis: Limits(top, push, jolt, (float(q.min()), float(q.min()) + travel))})


def command(machine: Machine, motion: Motion, kind: str, axis: str | None) -> dict[str, Floats]:
    """Return a command (t [s] and every ``<axis>.qr``) within what the log already visited: one axis moves."""
    name = axis or next(iter(machine.axes))
    made = MOVES[kind](_Visited.of(motion, name), name)
    t = np.arange(0.0, made.seconds, 2e-3)
    places = {k: motion.q[:, x.index] for k, x in machine.axes.items()}
    still = {f"{k}.qr": np.full(len(t), 0.5 * float(q.max() + q.min())) for k, q in places.items()}
    return {"t": t, **still, f"{name}.qr": made.at(t, [name])[0][:, 0]}


MOVES: Mapping[str, Callable[[_Visited, str], Trajectory]] = {
    "slow": partial(slow_reversals, strokes=(1e-4, 3e-4, 1e-3, 1e-2, 1e-1), repeats=2),
    "speeds": constant_speeds,
    "multisine": lambda visited, name: multisine(visited, 20.0, seed=1),
}
