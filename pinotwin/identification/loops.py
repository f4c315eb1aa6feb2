"""The closed loop of every axis whose command is logged (thesis Fig. 4-6, steps 4.2 and 4.3).

From command and generalised disturbance to tracking error and effort. Beside that black box the controller itself is
identified, so that the two can be compared and a gain can be changed afterwards.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import generalised_disturbance
from pinotwin.errors import DataError
from pinotwin.identification.coupled import (
    Servos,
    choice,
    fit_servos,
    follows_exactly,
    in_steps,
    with_factors,
)
from pinotwin.identification.flexible import KEY, tie_loops, vibration_loops
from pinotwin.identification.loop_parts import both_errors, errors, first_part, loop_data, score
from pinotwin.identification.refine import AxisEffects, axis_effects, refine, with_refined
from pinotwin.identification.settings import Settings, Tell, better
from pinotwin.log import Log
from pinotwin.logs.prepare import EvenLogs
from pinotwin.logs.quality.axes import lost_motion
from pinotwin.loop import LoopData, LoopModel, Servo, Structure, close, identify_loop
from pinotwin.loop.layout import Bounds, lay_out
from pinotwin.loop.search import starting_points
from pinotwin.loop.servo import LOST
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.system.phrases import IDENTIFIED
from pinotwin.twin import OpenLoop, Twin

MODES = ((8.0, 0.3), (25.0, 0.05), (60.0, 0.2))
"""Frequencies [Hz] and damping ratios from which a further pair of poles is searched."""
BEGINNINGS, FRESH = 4, 2
"""Usual places from which the poles are searched at first, and once more beside refined friction."""


@dataclass(frozen=True)
class ClosedLoops:
    """What the closed loops add to a twin."""

    plant: OpenLoop  # with the friction and tables that the loops refined
    loops: Mapping[str, LoopModel] = field(default_factory=dict)  # of each axis, black box or linearised
    servos: Mapping[str, Servo] = field(default_factory=dict)  # controller of each axis
    quality: Mapping[str, Any] = field(default_factory=dict)  # ``servos``, ``loops``, ``simulation``
    warnings: tuple[str, ...] = ()  # axes that were left out, and why

    def twin(self, **rest: Any) -> Twin:
        """Return the twin of the plant with these loops; the rest are its other attributes."""
        return Twin.of(self.plant, **({"loops": self.loops, "servos": self.servos} | rest))


def close_loops(
    plant: OpenLoop, motion: Motion, even: EvenLogs, tell: Tell, settings: Settings
) -> ClosedLoops:
    """Return the closed loops of a plant's axes, and the form to simulate them in.

    The coupled form, linearised, where it predicts the tracking error of held-out rows well. Otherwise, on machines
    with passive joints, and where machine.yaml states orders, the source's free black box stands beside it, and
    held-out rows decide. ``tell`` gets the stage and the share of the identification done [0 to 1].
    """
    if motion.step > settings.slowest:
        rate, least = 1.0 / motion.step, 1.0 / settings.slowest
        note = f"no closed loop: the log has {rate:.3g} Hz, at least {least:.0f} are needed"
        return ClosedLoops(plant, warnings=(note,))
    machine = plant.machine
    raw = even.motion(machine, cutoff=0.0, decimate=1)
    exact = [name for name, axis in machine.axes.items() if follows_exactly(raw, axis.index)]
    axes = [name for name in machine.axes if name not in exact]
    said = [
        f"no closed loop of {name}: its position is its command, so that there is no tracking error; map the measured "
        f"position to {machine.regulated(name)}"
        for name in exact
    ]
    if not axes:
        return ClosedLoops(plant, warnings=tuple(said))
    better = [name for name in axes if _on_load(machine, motion, name, settings.pays)]
    said += [IDENTIFIED["on_load"].format(axis=name) for name in better]
    found = fit_servos(plant, motion, raw, axes, lambda x, done: tell(x, 0.45 + 0.25 * done), settings)
    plant = with_factors(plant, found.factors)
    found, judged = _by_encoders(plant, found, in_steps(found, raw), even.logs[-1], settings)
    error, tracking = judged["held_out"]["coupled"], judged["tracking"]
    stated = any(shape.stated for shape in machine.loop.values())  # machine.yaml states the order
    asked = bool(machine.passive or stated or len(found.servos) < len(axes))
    if error is not None and tracking is not None and tracking < settings.good_tracking and not asked:
        closed = _linearised(plant, found.servos, motion, settings)
    else:
        closed = _black_boxes(plant, motion, axes, lambda x, done: tell(x, 0.7 + 0.25 * done), settings)
        judged = choice(closed.twin(servos=found.trials), even.logs[-1], ("coupled", "black"), settings)
        if judged["use"] == "coupled" and error is not None and not asked:
            refined = judged["held_out"]["coupled"] < error
            closed = _linearised(closed.plant if refined else plant, found.servos, motion, settings)
    return replace(
        closed,
        servos={
            name: _with_lost(servo, motion, machine.axes[name].index) for name, servo in found.servos.items()
        },
        quality={"servos": found.quality, "simulation": judged, **closed.quality},
        warnings=(*said, *found.notes, *closed.warnings),
    )


def _on_load(machine: Machine, motion: Motion, name: str, pays: float) -> bool:
    """Whether a law of the motor's encoder predicts unseen effort worse than one whose error is that at the load."""
    i = machine.axes[name].index
    if motion.ql is None or machine.regulated(name).endswith(".ql") or not np.ptp(motion.ql[:, i]) > 0.0:
        return False
    rows = np.r_[*motion.segments]
    rows = rows[np.isfinite(motion.u[rows, i])]
    half, left, u = len(rows) // 2, [], motion.u[rows, i]
    q, v, qr, vr, ar = (
        x[:, i] for x in (motion.q, motion.v, motion.qr, motion.vr, motion.ar) if x is not None
    )
    for error in (qr - q, qr - motion.ql[:, i]):
        wound = np.cumsum(error) * motion.step
        law = np.stack([error, wound, q, v, qr, vr, ar, np.ones(len(q))], axis=1)[rows]
        gains = np.linalg.lstsq(law[:half], u[:half], rcond=1e-12)[0]
        left.append(float(np.std(u[half:] - law[half:] @ gains)))
    return left[1] < pays * left[0]


def _with_lost(servo: Servo, motion: Motion, i: int, blocks: int = 8) -> Servo:
    """Return a controller with the motion lost on column i between motor and load [m or rad], its error from blocks."""
    if motion.ql is None or not np.ptp(motion.ql[:, i]) > 0.0:
        return servo
    rows = np.r_[*motion.segments]
    q, away = motion.q[rows, i], motion.ql[rows, i] - motion.q[rows, i]
    away = away - np.polyval(np.polyfit(q, away, 1), q)
    parts = zip(np.array_split(away, blocks), np.array_split(motion.v[rows, i], blocks), strict=True)
    lost = [x for part in parts if (x := lost_motion(*part)) > 0.0]
    error = float(np.std(lost, ddof=1) / np.sqrt(len(lost))) if len(lost) > 1 else np.nan
    return replace(servo, lost=float(np.mean(lost or [0.0])), errors={**servo.errors, LOST: error})


def _by_encoders(
    plant: OpenLoop, plain: Servos, stepped: Servos, log: Log, settings: Settings
) -> tuple[Servos, dict[str, Any]]:
    """Return controllers closed on encoder steps unless others predict held-out rows better, and their errors."""
    steps = any(servo.encoder[0] for servo in stepped.servos.values())
    tried = [
        (s, choice(Twin.of(plant, servos=s.trials), log, ("coupled",), settings))
        for s in (*([stepped] if steps else []), plain)
    ]

    def error(one: tuple[Servos, dict[str, Any]]) -> float:
        found = one[1]["held_out"]["coupled"]
        return np.inf if found is None else float(found)

    return better(tried[0], tried[1:], error, settings.pays)


def _linearised(
    plant: OpenLoop, servos: Mapping[str, Servo], motion: Motion, settings: Settings
) -> ClosedLoops:
    """Return the loops that coupled axes make."""
    M, C = plant.diagonal["inertia"], plant.diagonal["viscous"]
    disturbance = generalised_disturbance(plant, motion, plant.diagonal)
    loops, notes = {}, []
    rows: dict[str, dict[str, Any]] = {}
    for name, servo in servos.items():
        i = plant.machine.axes[name].index
        try:
            loop = loops[name] = close(servo, float(M[i]), float(C[i]), axis=name)
        except DataError as error:  # what dry friction holds may be unstable without it
            notes.append(f"no poles of {name}: {error}")
            continue
        orders = {"real_poles": loop.structure.real_poles, "pole_pairs": loop.structure.pole_pairs}
        rows[name] = {**orders, "refined": False}
        try:
            data = loop_data(motion, disturbance, name, settings)
            rows[name] |= both_errors(data, loop, loop)
        except DataError as error:  # a log of a few seconds with a hole has no rows for it
            notes.append(f"no held-out error of the loop of {name}: {error}")
    return ClosedLoops(plant, loops, quality={"loops": rows}, warnings=tuple(notes))


def _black_boxes(
    plant: OpenLoop, motion: Motion, axes: Sequence[str], tell: Tell, settings: Settings
) -> ClosedLoops:
    """Return the free loops, with the vibration of passive joints and tied to the mass where there are such."""
    models, rows, kept, notes = dict[str, LoopModel](), dict[str, Any](), list[AxisEffects](), list[str]()
    disturbance = generalised_disturbance(plant, motion, plant.diagonal, modes=False)
    for k, name in enumerate(axes):
        tell(f"closed loop of {name}", k / len(axes))
        try:
            data = loop_data(motion, disturbance, name, settings)
            models[name], rows[name], effects = _fit_loop(plant, motion, data, settings)
        except DataError as error:
            notes.append(f"no closed loop of {name}: {error}")
            continue
        kept += [] if effects is None else [effects]
    refined = with_refined(plant, kept)
    if plant.machine.passive:
        for axis, row in vibration_loops(refined, models, motion, settings).items():
            rows[axis][KEY] = row
        for axis, (model, row) in tie_loops(refined, models, motion, settings).items():
            models[axis], rows[axis] = model, rows[axis] | row
    return ClosedLoops(refined, models, quality={"loops": rows}, warnings=tuple(notes))


def _fit_loop(
    plant: OpenLoop, motion: Motion, data: LoopData, settings: Settings
) -> tuple[LoopModel, dict[str, Any], AxisEffects | None]:
    """Return the loop of one axis, its judgement, and its effects where they were refined."""
    given = plant.machine.loop.get(data.axis)
    bounds = (given.bounds or None) if given is not None else None
    if given is not None and given.stated:
        structure = Structure(given.real_poles, given.pole_pairs, given.feedforward_poles, given.numerators)
        trial = _first_loop(data, structure, given.bounds)
    else:
        trial = _choose(data, settings)
    data, trial, refined = _refined(plant, motion, data, trial, bounds, settings)
    doubted = score(data, trial) > settings.poor_loop
    model = _refit(data, trial, bounds, afresh=doubted, judged=True)
    row = {
        "real_poles": model.structure.real_poles,
        "pole_pairs": model.structure.pole_pairs,
        **both_errors(data, model, trial),
        "refined": refined is not None,
    }
    return model, row, refined


def _choose(data: LoopData, settings: Settings) -> LoopModel:
    """Return the loop of the order that pays, fitted to the first part."""
    trial = _first_loop(data, Structure())
    for pairs in range(2, settings.most_pairs + 1):
        poles = trial.theta
        starts = np.array([[*poles, np.log(2.0 * np.pi * f), np.log(zeta)] for f, zeta in MODES])
        more = identify_loop(first_part(data), Structure(pole_pairs=pairs), starts=starts, judged=False)
        if better(trial, [more], functools.partial(score, data), settings.pays) is trial:
            break
        trial = more
    return trial


def _first_loop(data: LoopData, structure: Structure, bounds: Bounds | None = None) -> LoopModel:
    """Return a loop fitted to the first part; few starts will do, for its friction is still to be refined."""
    layout = lay_out(structure, data.step, (data.d.shape[1], data.outputs.shape[1]), bounds)
    starts = starting_points(layout, BEGINNINGS)
    return identify_loop(first_part(data), structure, bounds=bounds, starts=starts, judged=False)


def _refined(
    plant: OpenLoop,
    motion: Motion,
    data: LoopData,
    trial: LoopModel,
    bounds: Bounds | None,
    settings: Settings,
) -> tuple[LoopData, LoopModel, AxisEffects | None]:
    """Refine an axis' friction and position effects through its loop; None where held-out data object."""
    mine = axis_effects(plant, data.axis)
    if mine is None:
        return data, trial, None
    kept, before = mine, errors(data, trial, held_out=True)
    for turn in range(settings.turns):
        near = replace(kept, error=mine.error)
        refined = refine(first_part(data), trial, motion, near, explore=turn < 2)
        change = refined.columns(motion) @ refined.theta - kept.columns(motion) @ kept.theta
        renewed = replace(data, d=data.d + change[:, None])
        retried = _refit(first_part(renewed), trial, bounds, afresh=turn == 1)
        after = errors(renewed, retried, held_out=True)
        # every signal counts against itself: an error of e of 10 % would drown one of u of 2 %
        falls = np.array([before[name] / max(after[name], 1e-300) for name in before])
        gain = float(np.exp(np.mean(np.log(falls))))
        if falls.min() < 1.0 / settings.much_worse or gain < 1.0 / settings.no_worse:
            break
        kept, data, trial, before = refined, renewed, retried, after
        if gain * settings.pays < 1.0:
            break
    return data, trial, None if kept is mine else kept


def _refit(
    data: LoopData, near: LoopModel, bounds: Bounds | None, *, afresh: bool = False, judged: bool = False
) -> LoopModel:
    """Return a loop of the same structure for other data, searched from ``near`` and, ``afresh``, from usual places."""
    starts = near.theta[None]
    if afresh:
        starts = np.concatenate([starts, starting_points(near.layout, FRESH)])
    return identify_loop(data, near.structure, bounds=bounds, starts=starts, judged=judged)
