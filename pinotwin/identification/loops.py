"""The closed loop of every axis whose command is logged (thesis Fig. 4-6, steps 4.2 and 4.3).

Inputs are the command and the generalised disturbance of the identified plant, outputs the tracking
error and the effort. Beside that black box the controller itself is identified, so that the two can be compared and a
gain can be changed afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import generalised_disturbance
from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.identification.coupled import (
    BETTER,
    Servos,
    choice,
    fit_servos,
    follows_exactly,
    in_steps,
    with_factors,
)
from pinotwin.identification.flexible import KEY, tie_loops, vibration_loops
from pinotwin.identification.loop_parts import Loops, errors, first_part, loop_data
from pinotwin.identification.refine import AxisEffects, axis_effects, refine
from pinotwin.identification.table import refined_table
from pinotwin.log import Log
from pinotwin.logs.prepare import EvenLogs
from pinotwin.loop import (
    LoopData,
    LoopModel,
    Servo,
    Structure,
    close,
    identify_loop,
)
from pinotwin.loop.layout import Bounds, lay_out
from pinotwin.loop.search import starting_points
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin import OpenLoop, Twin

SLOWEST = 1.0 / 50.0
"""Longest sampling interval at which a closed loop is identified [s]."""
POOR = 0.05
"""Held-out tracking error of the coupled form, as a share of its RMS, above which the free black box is
identified as well: an effort that is missed otherwise is the plant's, whatever the form of the loop."""
PAYS = 0.95
"""A larger order is taken if it brings the held-out error below this share of the smaller one's."""
MOST_PAIRS = 3
MODES = ((8.0, 0.3), (25.0, 0.05), (60.0, 0.2))
"""Frequencies [Hz] and damping ratios from which a further pair is searched."""
NO_WORSE = 1.01
"""Refined effects have as many numbers as before: they are kept unless held-out data speak against."""
BEGINNINGS, FRESH = 4, 2
"""Usual places from which the poles are searched at first, and once more beside refined friction."""
MISSED = 0.1
"""Mean held-out error of a loop, each signal over its RMS, from which its last search also starts afresh."""
MUCH_WORSE = 1.1
"""No signal may lose more than this for the others' gain."""
ROUNDS, EXPLORED, ENOUGH = 4, 2, 1.03
"""Most turns of loop and effects, of which the first explore; they end when one gains less than 3 %."""


@dataclass(frozen=True)
class ClosedLoops:
    """What the closed loops add to a twin.

    Attributes:
        plant: with the friction and tables that the loops refined.
        loops: closed loop of each axis (black box, or the linearised coupled form).
        servos: controller of each axis.
        quality: rows ``servos``, ``loops``, ``simulation`` of the twin's quality.
        warnings: axes that were left out, and why.
    """

    plant: OpenLoop
    loops: Mapping[str, LoopModel] = field(default_factory=dict)
    servos: Mapping[str, Servo] = field(default_factory=dict)
    quality: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def twin(self, **rest: Any) -> Twin:
        """Return the twin of the plant with these loops; the rest are its other attributes."""
        return Twin.of(self.plant, **({"loops": self.loops, "servos": self.servos} | rest))


def close_loops(
    plant: OpenLoop, motion: Motion, even: EvenLogs, tell: Callable[[str, float], None]
) -> ClosedLoops:
    """Return the closed loops of a plant's axes, and the form to simulate them in.

    The coupled form comes first; where it predicts the tracking error of held-out rows well, its linearised
    system gives poles and transfer functions. Otherwise, on machines with passive joints, and where
    machine.yaml states orders, the source's free black box is identified beside it, and held-out rows decide
    between them: poles are read from the form that simulates.

    Args:
        plant: with its diagonal.
        motion: prepared log(s) with commands.
        even: the same, unfiltered.
        tell: called with the stage and the share of this step done.
    """
    if motion.step > SLOWEST:
        note = (
            f"no closed loop: the log has {1.0 / motion.step:.3g} Hz, at least {1.0 / SLOWEST:.0f} are needed"
        )
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
    found = fit_servos(plant, motion, raw, axes, lambda stage, done: tell(stage, 0.5 * done))
    plant = with_factors(plant, found.factors)
    found, judged = _by_encoders(plant, found, in_steps(found, raw), even.logs[-1])
    error, tracking = judged["held_out"]["coupled"], judged["tracking"]
    asked = bool(machine.passive or _stated(machine) or len(found.servos) < len(axes))
    if error is not None and tracking is not None and tracking < POOR and not asked:
        closed = _linearised(plant, found.servos, motion)
    else:
        closed = _black_boxes(plant, motion, axes, lambda stage, done: tell(stage, 0.5 + 0.5 * done))
        judged = choice(closed.twin(servos=found.trials), even.logs[-1], ("coupled", "black"))
        if judged["use"] == "coupled" and error is not None and not asked:
            refined = judged["held_out"]["coupled"] < error
            closed = _linearised(closed.plant if refined else plant, found.servos, motion)
    return replace(
        closed,
        servos=found.servos,
        quality={"servos": found.quality, "simulation": judged, **closed.quality},
        warnings=(*said, *found.notes, *closed.warnings),
    )


def _by_encoders(plant: OpenLoop, plain: Servos, stepped: Servos, log: Log) -> tuple[Servos, dict[str, Any]]:
    """Return the controllers closed on encoder steps, unless others predict held-out rows better, and their errors.

    A log that was rounded when it was written has steps that no controller saw.
    """
    steps = any(servo.encoder[0] for servo in stepped.servos.values())
    tried = [
        (s, choice(Twin.of(plant, servos=s.trials), log, ("coupled",)), usual)
        for s, usual in ((plain, BETTER), *([(stepped, 1.0)] if steps else []))
    ]

    def error(told: dict[str, Any]) -> float:
        found = told["held_out"]["coupled"]
        return np.inf if found is None else float(found)

    return min(tried, key=lambda x: error(x[1]) / x[2])[:2]


def _stated(machine: Machine) -> bool:
    """Whether machine.yaml states the order of a loop."""
    return any(shape.stated for shape in machine.loop.values())


def _linearised(plant: OpenLoop, servos: Mapping[str, Servo], motion: Motion) -> ClosedLoops:
    """Return the loops that coupled axes make."""
    M, C = plant.diagonal["inertia"], plant.diagonal["viscous"]
    disturbance = generalised_disturbance(plant, motion, plant.diagonal)
    loops, notes = {}, []
    rows: dict[str, dict[str, Any]] = {}
    for name, servo in servos.items():
        i = plant.machine.axes[name].index
        try:
            loop = close(servo, float(M[i]), float(C[i]), axis=name)
        except DataError as error:  # what dry friction holds may be unstable without it
            notes.append(f"no poles of {name}: {error}")
            continue
        loops[name] = loop
        rows[name] = {"real_poles": loop.structure.real_poles, "pole_pairs": loop.structure.pole_pairs}
        rows[name]["refined"] = False
        try:
            data = loop_data(motion, disturbance, name)
            rows[name] |= {"fit": errors(data, loop), "held_out": errors(data, loop, held_out=True)}
        except DataError as error:  # a log of a few seconds with a hole has no rows for it
            notes.append(f"no held-out error of the loop of {name}: {error}")
    return ClosedLoops(plant, loops, quality={"loops": rows}, warnings=tuple(notes))


def _black_boxes(
    plant: OpenLoop, motion: Motion, axes: Sequence[str], tell: Callable[[str, float], None]
) -> ClosedLoops:
    """Return the free loops, with the vibration of passive joints and tied to the mass where there are such."""
    found = fit_loops(plant, motion, axes, tell)
    refined = replace(plant, effects=found.effects, theta=found.theta, parameters=refined_table(plant, found))
    models, rows = dict(found.models), dict(found.quality)
    if plant.machine.passive:
        for axis, row in vibration_loops(refined, found.models, motion).items():
            rows[axis] = {**rows[axis], KEY: row}
        for axis, (model, row) in tie_loops(refined, found.models, motion).items():
            models[axis], rows[axis] = model, {**rows[axis], **row}
    return ClosedLoops(refined, models, quality={"loops": rows}, warnings=tuple(found.notes))


def fit_loops(
    plant: OpenLoop, motion: Motion, axes: Sequence[str], tell: Callable[[str, float], None]
) -> Loops:
    """Identify the loop of every axis that has a command, an effort and motion.

    Args:
        plant: with its diagonal.
        motion: prepared log(s) with commands.
        axes: to look at.
        tell: called with the stage and the share of this step done.
    """
    found = Loops(plant.effects, plant.theta.copy())
    disturbance = generalised_disturbance(plant, motion, plant.diagonal, modes=False)
    for k, name in enumerate(axes):
        tell(f"closed loop of {name}", k / len(axes))
        fit = _fit_loop(plant, motion, disturbance, name)
        found.notes += fit.notes
        if fit.model is not None:
            found.models[name], found.quality[name] = fit.model, fit.quality
        if fit.refined is not None:
            _keep(found, *fit.refined)
    return found


@dataclass(frozen=True)
class _Fit:
    """What was found of one axis: its loop and its judgement, its effects before and after refinement."""

    model: LoopModel | None = None
    quality: dict[str, Any] = field(default_factory=dict)
    refined: tuple[AxisEffects, AxisEffects] | None = None
    notes: tuple[str, ...] = ()


def _fit_loop(plant: OpenLoop, motion: Motion, disturbance: Floats, name: str) -> _Fit:
    """Return the loop of one axis; a note where there is none."""
    try:
        data = loop_data(motion, disturbance, name)
        trial = _choose(plant, data, name)
        data, trial, refined = _refined(plant, motion, data, trial)
        doubted = _score(data, trial) > MISSED
        model = _refit(data, trial, _bounds(plant.machine, name), afresh=doubted, judged=True)
    except DataError as error:
        return _Fit(notes=(f"no closed loop of {name}: {error}",))
    return _Fit(model, _judged(data, model, trial) | {"refined": refined is not None}, refined)


def _refined(
    plant: OpenLoop, motion: Motion, data: LoopData, trial: LoopModel
) -> tuple[LoopData, LoopModel, tuple[AxisEffects, AxisEffects] | None]:
    """Refine an axis' friction and position effects through its loop, unless held-out data object.

    The first part of the log refines, the rest judges. Loop and effects are found in turn: poles that
    were fitted beside wrong friction pull the friction along, most of all where a structure bends.

    Returns:
        Data with the disturbance of the effects that were kept, the loop of its first part, and the effects before
        and after; None where they stay as they are.
    """
    deviations = np.sqrt(np.maximum(np.diag(plant.covariance), 0.0))
    mine = axis_effects(plant.effects, plant.slices, plant.theta, deviations, data.axis)
    if mine is None:
        return data, trial, None
    kept, before = mine, errors(data, trial, held_out=True)
    for turn in range(ROUNDS):
        near = replace(kept, error=mine.error)
        better = refine(first_part(data), trial, motion, near, explore=turn < EXPLORED)
        change = better.columns(motion) @ better.theta - kept.columns(motion) @ kept.theta
        renewed = replace(data, d=data.d + change[:, None])
        bounds = _bounds(plant.machine, data.axis)
        retried = _refit(first_part(renewed), trial, bounds, afresh=turn == EXPLORED - 1)
        after = errors(renewed, retried, held_out=True)
        gain = _gain(before, after)
        if gain < 1.0 / NO_WORSE:
            break
        kept, data, trial, before = better, renewed, retried, after
        if gain < ENOUGH:
            break
    return data, trial, None if kept is mine else (mine, kept)


def _gain(before: dict[str, float], after: dict[str, float]) -> float:
    """Return by how much the errors fall, geometric mean; 0 if one of them rises much for it.

    Every signal counts against itself: an error of e of 10 % would drown one of u of 2 %.
    """
    ratios = np.array([before[name] / max(after[name], 1e-300) for name in before])
    return 0.0 if ratios.min() < 1.0 / MUCH_WORSE else float(np.exp(np.mean(np.log(ratios))))


def _keep(found: Loops, old: AxisEffects, new: AxisEffects) -> None:
    found.theta[list(new.where)] = new.theta
    swap = {id(a): b for a, b in zip(old.effects, new.effects, strict=True)}
    found.effects = tuple(swap.get(id(effect), effect) for effect in found.effects)
    found.refined[new.axis] = new


def _bounds(machine: Machine, name: str) -> Bounds | None:
    """Return the bounds of the search that machine.yaml states for an axis."""
    return machine.loop[name].bounds or None if name in machine.loop else None


def _refit(
    data: LoopData, near: LoopModel, bounds: Bounds | None, *, afresh: bool = False, judged: bool = False
) -> LoopModel:
    """Return a loop of the same structure fitted to other data, its search started from ``near``.

    Poles that were found beside wrong friction can sit in the wrong basin: ``afresh`` also starts from
    a few usual places.
    """
    starts = np.array([_theta(near)])
    if afresh:
        starts = np.concatenate([starts, starting_points(near.layout, FRESH)])
    return identify_loop(data, near.structure, bounds=bounds, starts=starts, judged=judged)


def _theta(model: LoopModel) -> list[float]:
    """Return the logarithms of the searched poles, in the order of the search."""
    return [float(np.log(x)) for part in model.sections if part.free for x in part.values]


def _beside(model: LoopModel) -> Floats:
    """Return starts for one more pair beside the poles of a model: light modes over the band."""
    return np.array([[*_theta(model), np.log(2.0 * np.pi * f), np.log(zeta)] for f, zeta in MODES])


def _choose(plant: OpenLoop, data: LoopData, name: str) -> LoopModel:
    """Return the loop, of the stated order or of the order that pays, fitted to the first part."""
    given = plant.machine.loop.get(name)
    if given is not None and given.stated:
        structure = Structure(given.real_poles, given.pole_pairs, given.feedforward_poles, given.numerators)
        return _found(first_part(data), structure, given.bounds)
    trial = _found(first_part(data), Structure())
    error = _score(data, trial)
    for pairs in range(2, MOST_PAIRS + 1):
        other = identify_loop(
            first_part(data), Structure(pole_pairs=pairs), starts=_beside(trial), judged=False
        )
        score = _score(data, other)
        if score > PAYS * error:
            break
        trial, error = other, score
    return trial


def _found(data: LoopData, structure: Structure, bounds: Bounds | None = None) -> LoopModel:
    """Return a first loop; few starts will do, for its friction is still to be refined."""
    layout = lay_out(structure, data.step, (data.d.shape[1], data.outputs.shape[1]), bounds)
    starts = starting_points(layout, BEGINNINGS)
    return identify_loop(data, structure, bounds=bounds, starts=starts, judged=False)


def _score(data: LoopData, model: LoopModel) -> float:
    """Return the mean held-out error of the outputs, each over its RMS."""
    return float(np.mean(list(errors(data, model, held_out=True).values())))


def _judged(data: LoopData, model: LoopModel, trial: LoopModel) -> dict[str, Any]:
    return {
        "real_poles": model.structure.real_poles,
        "pole_pairs": model.structure.pole_pairs,
        "fit": errors(data, model),
        "held_out": errors(data, trial, held_out=True),
    }
