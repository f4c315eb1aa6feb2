"""What to record next, and the command that does it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

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

PAIRS: tuple[tuple[frozenset[str], str, str], ...] = (
    (
        frozenset({"coulomb_asymmetric", "offset", "rigid_body"}),
        "hold several postures with the brake off and read the effort",
        "slow",
    ),
    (
        frozenset({"effort_scale", "rigid_body"}),
        "add a payload of known mass and record the effort again",
        "slow",
    ),
    (
        frozenset({"delay", "drive_flexibility", "joint_flexibility", "encoder_error"}),
        "record a multisine beyond the resonance; a delay shifts the phase with frequency, a resonance peaks",
        "multisine",
    ),
    (
        frozenset(
            {
                "viscous",
                "stribeck",
                "quadratic_drag",
                "viscous_thermal",
                "load_friction",
                "viscous_asymmetric",
            }
        ),
        "record constant speeds from 1 to 100 %, both directions",
        "speeds",
    ),
    (
        frozenset({"presliding", "backlash", "encoder_error", "stribeck"}),
        "record slow reversals of growing stroke, from 1 µm (1 mdeg) up",
        "slow",
    ),
    (
        frozenset({"ripple", "ripple_modulated", "position_table", "encoder_error", "geometric_error"}),
        "record the same travel at two speeds; a position effect stays put, a time effect shifts",
        "speeds",
    ),
)


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
        way = next(((text, kind) for group, text, kind in PAIRS if {a, b} <= group), None)
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


def command(machine: Machine, motion: Motion, kind: str, axis: str | None) -> dict[str, Floats]:
    """Return a command (t and every ``<axis>.qr``) within what the log already visited."""
    name = axis or next(iter(machine.axes))
    j = motion.index(name)
    q, v, a = motion.q[:, j], np.abs(motion.v[:, j]), np.abs(motion.a[:, j])
    centre, reach = 0.5 * (q.max() + q.min()), 0.5 * float(np.ptp(q))
    top, push = float(v.max()), float(np.quantile(a, 0.995))
    t, path = MOTIONS[kind](reach, top, push)
    out = {"t": t}
    for other in machine.axes.values():
        k = other.index
        home = 0.5 * float(motion.q[:, k].max() + motion.q[:, k].min())
        out[f"{other.name}.qr"] = centre + path if other.name == name else np.full(len(t), home)
    return out


LONGEST = 60.0  # Longest that one stroke of an advised motion takes [s]


def _slow(reach: float, top: float, push: float) -> tuple[Floats, Floats]:
    del push
    t, x, now = [], [], 0.0
    for stroke in (1e-4, 3e-4, 1e-3, 1e-2, 1e-1):
        size = stroke * reach
        period = min(max(2.0 * np.pi * size / (0.02 * top), 2.0), LONGEST)
        s = np.arange(0.0, 2.0 * period, 2e-3)
        t.append(now + s)
        x.append(size * np.sin(2.0 * np.pi * s / period))
        now += 2.0 * period
    return np.concatenate(t), np.concatenate(x)


def _speeds(reach: float, top: float, push: float) -> tuple[Floats, Floats]:
    t, x, now = [], [], 0.0
    for share in (0.01, 0.03, 0.1, 0.3, 0.8):
        speed = share * top
        half = min(0.9 * reach, 2.0 * speed)
        turn = speed / max(0.5 * push, 1e-9)
        period = min(4.0 * half / speed + 4.0 * turn, LONGEST)
        s = np.arange(0.0, period, 2e-3)
        rate = np.clip(np.cos(2 * np.pi * s / period) * period / (2 * np.pi * turn + 1e-9), -1, 1)
        path = np.cumsum(rate) * 2e-3
        path -= np.linspace(0.0, path[-1], len(path))
        t.append(now + s)
        x.append(np.clip(path * speed, -reach, reach))
        now += period
    return np.concatenate(t), np.concatenate(x)


def _multisine(reach: float, top: float, push: float) -> tuple[Floats, Floats]:
    t = np.arange(0.0, 20.0, 2e-3)
    f = np.geomspace(0.3, 60.0, 24)
    phase = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, len(f))
    amplitude = 1.0 / (1.0 + f**2)
    window = np.minimum(1.0, np.minimum(t, t[-1] - t))
    angle = 2 * np.pi * np.outer(t, f) + phase
    x = window * (np.sin(angle) @ amplitude)
    rate, rise = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
    room = min(0.9 * reach / np.abs(x).max(), 0.9 * top / np.abs(rate).max(), 0.9 * push / np.abs(rise).max())
    return t, room * x


MOTIONS = {"slow": _slow, "speeds": _speeds, "multisine": _multisine}
