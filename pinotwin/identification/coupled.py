"""The controllers of all axes, and the form with which a twin is simulated, decided on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from pinotwin.analysis.disturbance import generalised_disturbance
from pinotwin.arrays import Floats
from pinotwin.effects import Effect, Presliding
from pinotwin.errors import PinotwinError
from pinotwin.identification.servo.certainty import shared
from pinotwin.identification.servo.output_error import Found
from pinotwin.identification.servo.problem import PLANT, AxisProblem, Factors, skipped
from pinotwin.identification.servo.structure import look, settle
from pinotwin.identification.settings import USUAL, Settings, Tell, better
from pinotwin.log import Log
from pinotwin.logs.quality import lattice
from pinotwin.loop import Servo, command_rates
from pinotwin.motion import Motion
from pinotwin.simulation import compare, simulate
from pinotwin.simulation.plant import plant_of
from pinotwin.simulation.state import Lookup
from pinotwin.system.threads import side_by_side
from pinotwin.twin import OpenLoop, Parameters, Twin

Plant = TypeVar("Plant", bound=OpenLoop)


@dataclass
class Servos:
    """What was found."""

    servos: dict[str, Servo] = field(default_factory=dict)  # controller of each axis, from all windows
    trials: dict[str, Servo] = field(default_factory=dict)  # from the first windows only
    factors: dict[str, Factors] = field(default_factory=dict)  # on the plant of the axes
    quality: dict[str, Any] = field(default_factory=dict)  # per axis the errors, in the fit and held out
    notes: list[str] = field(default_factory=list)  # axes that were left out, and why


def fit_servos(
    plant: OpenLoop, motion: Motion, raw: Motion, axes: Sequence[str], tell: Tell, settings: Settings
) -> Servos:
    """Identify the controller of every axis that has a command, an effort and motion, from rows with nothing filtered.

    The prepared motion says what the axes disturb one another by; ``tell`` gets stage and share done [0 to 1].
    """
    assert raw.qr is not None
    d, vr = generalised_disturbance(plant, motion, plant.diagonal), command_velocity(raw)
    lookup = plant_of(plant, raw.qr, vr).tables

    def first(name: str) -> tuple[AxisProblem, Found] | str:
        """Return an axis alone with a first controller, or why it has none."""
        i = plant.machine.axes[name].index
        assert raw.qr is not None
        if np.ptp(raw.qr[:, i]) == 0.0 or not np.isfinite(raw.u[:, i]).any():
            return "it does not move, or its effort is not logged"
        dry = _friction_effort(plant, motion, name)
        problem = axis_problem(plant, motion, raw, vr, dry - d[:, i], lookup, name)
        refinable = problem and _refinable(plant, motion, problem, dry, name, settings.no_worse)
        servo = problem and refinable and look(problem, *refinable, settings)
        if not problem or not servo:
            return "no law keeps the simulated axis on its command; plant and log do not fit together"
        return problem, servo

    found, looked = Servos(), {}
    looks = side_by_side(first, axes)
    for k, name in enumerate(axes):
        tell(f"controller of {name}", k / len(axes))
        one = next(looks)
        if isinstance(one, str):
            found.notes.append(f"no controller of {name}: {one}")
        else:
            looked[name] = one
    usual = shared(list(looked.values()))
    settled = side_by_side(
        lambda x: settle(*x[0], x[1], settings), list(zip(looked.values(), usual, strict=True))
    )
    for name, servo in zip(looked, settled, strict=True):
        found.servos[name] = servo.servo
        found.trials[name] = servo.trial or servo.servo
        found.factors[name] = servo.factors
        found.quality[name] = {
            "form": servo.servo.form,
            "fit": dict(zip("eu", servo.errors, strict=True)),
            "held_out": dict(zip("eu", servo.held_out, strict=True)),
            "friction": dict(zip(PLANT[1:], servo.factors[1:], strict=True)),
        }
        if not servo.held_out[0] <= settings.missed:
            found.notes.append(
                f"{name}: the identified controller fails to predict {servo.held_out[0]:.0%} of the tracking error "
                "on held-out data. Do not use its gains; an effect of the plant may be missing"
            )
    return found


def follows_exactly(raw: Motion, joint: int) -> bool:
    """Whether a joint of an unfiltered log errs no more than the steps in which position and command are written."""
    assert raw.qr is not None
    rows = np.r_[*raw.segments]
    told = np.stack([raw.regulated[rows, joint], raw.qr[rows, joint]])
    told = told[:, np.isfinite(told).all(axis=0)]
    if not told.size:
        return False
    steps = [(lattice(x) or (0.0, 0.0))[0] for x in told]
    least = max(*steps, 4.0 * float(np.spacing(np.max(np.abs(told)))))
    return float(np.ptp(told[1])) > least >= float(np.ptp(told[1] - told[0]))


def _refinable(
    plant: OpenLoop, motion: Motion, problem: AxisProblem, dry: Floats, name: str, no_worse: float
) -> tuple[tuple[str, ...], Callable[[Factors], bool]]:
    """Return which friction can be refined with no worse effort on unseen rows, and what those say of factors."""
    i = plant.machine.axes[name].index
    _, judge = problem.split()
    rows = np.r_[*judge.windows]
    rows = rows[motion.use[rows, i] & np.isfinite(motion.u[rows, i])]
    left = (motion.u - plant.effort(motion))[rows, i]
    mine = [e for e in plant.effects if e.axis == name]
    gives = [e for e in mine if isinstance(e, Presliding)]
    there = {
        "viscous": problem.viscous != 0.0 and bool(np.any(motion.v[rows, i])),
        "dry": bool(np.any(dry[rows])),
        "fading": any(e.fades for e in mine) or any(e.stribeck for e in gives),
        "distance": bool(gives),
    }

    def allowed(factors: Factors) -> bool:
        moved = _friction_effort(with_factors(plant, {name: factors}), motion, name) - dry
        moved += (factors[1] - 1.0) * problem.viscous * motion.v[:, i]
        return float(np.sum((left - moved[rows]) ** 2)) <= no_worse**2 * float(np.sum(left**2))

    return tuple(k for k, x in there.items() if x), allowed


def in_steps(found: Servos, raw: Motion) -> Servos:
    """Return the controllers closed on a position in the steps in which the log has it, where it has any."""
    steps = {name: lattice(raw.regulated[:, raw.index(name)]) or (0.0, 0.0) for name in found.servos}
    servos, trials = (
        {name: replace(servo, encoder=steps[name]) for name, servo in laws.items()}
        for laws in (found.servos, found.trials)
    )
    return replace(found, servos=servos, trials=trials)


def with_factors(plant: Plant, factors: Mapping[str, Factors]) -> Plant:
    """Return the plant with friction of its axes multiplied, its table included; see :data:`Factors`."""
    theta, viscous = plant.theta.copy(), np.array(plant.diagonal["viscous"], dtype=float)
    effects, changed = list(plant.effects), dict[str, float]()
    for n, (key, effect, s) in enumerate(zip(plant.keys, plant.effects, plant.slices, strict=True)):
        if effect.axis not in factors or effect.axis is None:
            continue
        by = factors[effect.axis]
        for k, coefficient in enumerate(effect.coefficients()):
            share = _share(effect, coefficient.name, by)
            if share != 1.0:
                theta[s.start + k] *= share
                changed[f"{key}.{coefficient.name}"] = float(theta[s.start + k])
        if isinstance(effect, Presliding) and by[4] != 1.0:
            changed[f"{key}.x_s"] = by[4] * effect.x_s
            effects[n] = replace(effect, x_s=by[4] * effect.x_s)
    for axis, factor in factors.items():
        viscous[plant.machine.axes[axis].index] *= factor[1]
    table = Parameters(replace(row, value=changed.get(row.name, row.value)) for row in plant.parameters)
    diagonal = {**plant.diagonal, "viscous": viscous}
    return replace(plant, effects=tuple(effects), theta=theta, diagonal=diagonal, parameters=table)


def _share(effect: Effect, coefficient: str, factors: Factors) -> float:
    """Return the factor on a coefficient of an effect."""
    _, viscous, dry, fading, _ = factors
    if effect.causes[0] == "viscous":
        return viscous
    if effect.depends not in ("direction", "displacement") or coefficient in ("m", "d"):
        return 1.0
    return fading if effect.fades or (isinstance(effect, Presliding) and coefficient == "s") else dry


def axis_problem(
    plant: OpenLoop, motion: Motion, raw: Motion, vr: Floats, load: Floats, lookup: Lookup, name: str
) -> AxisProblem | None:
    """Return one axis alone with what loads it [N or N·m], shape (n,), or None if no stretch is long enough."""
    i = plant.machine.axes[name].index
    assert raw.qr is not None
    windows = _windows(raw, vr[:, i])
    if not windows:
        return None
    problem = AxisProblem(
        step=raw.step,
        qr=raw.qr[:, i].copy(),
        vr=vr[:, i].copy(),
        q=raw.regulated[:, i].copy(),
        v=motion.v[:, i].copy(),
        u=raw.u[:, i].copy(),
        load=load,
        inertia=float(plant.diagonal["inertia"][i]),
        viscous=float(plant.diagonal["viscous"][i]),
        tables=own_friction(lookup, i),
        windows=windows,
        stretches=tuple(raw.segments),
    )
    y = problem.measured
    return replace(problem, sizes=np.maximum(np.sqrt(np.mean(y**2, axis=0)), 1e-300))


def command_velocity(raw: Motion) -> Floats:
    """Return the velocity of the commands by cubic splines, shape (n, nv)."""
    assert raw.qr is not None
    out = np.zeros_like(raw.qr)
    for s in raw.segments:
        for i, x in enumerate(raw.qr.T):
            out[s, i] = command_rates(x[s], raw.step)[0]
    return out


def _windows(
    raw: Motion, vr: Floats, longest: float = 6.0, most: int = 4, least: int = 20
) -> tuple[slice, ...]:
    """Return windows, ``longest`` [s] each, where the axis moves most; ``least`` is left of them behind the start."""
    found, least = [], skipped(raw.step) + least
    for s in raw.segments:
        count = max(1, int(np.ceil((s.stop - s.start) * raw.step / longest)))
        if s.stop - s.start > 60:
            count = max(count, min(3, (s.stop - s.start) // 60))
        edges = np.linspace(s.start, s.stop, count + 1).astype(int)
        found += [slice(int(a), int(b)) for a, b in pairwise(edges) if b - a >= least]
    usable = [s for s in found if np.ptp(vr[s]) > 0.0]
    return tuple(
        sorted(sorted(usable, key=lambda s: -float(np.mean(vr[s] ** 2)))[:most], key=lambda s: s.start)
    )


def _friction_effort(plant: OpenLoop, motion: Motion, name: str) -> Floats:
    """Return the effort of what the axis' kernel computes itself: dry friction and friction of speed, (n,)."""
    i = plant.machine.axes[name].index
    total = np.zeros(len(motion))
    for effect, s in zip(plant.effects, plant.slices, strict=True):
        own = effect.axis == name and effect.depends in ("direction", "displacement", "velocity")
        if own and effect.causes[0] != "viscous":
            total += effect.along(motion, plant.theta[s])[:, i]
    return total


def own_friction(t: Lookup, i: int) -> Lookup:
    """Return the friction of one joint as the tables of a machine of one joint."""
    dry = (t.directions[:, 0] == i) & (t.directions[:, 1] < 0)
    speeds, slips = t.speeds == i, t.slips == i
    zeros = [np.zeros(int(mask.sum()), dtype=np.intp) for mask in (dry, speeds, slips)]
    return t._replace(
        position=np.zeros(1),
        place=np.array([[0, 1]], dtype=np.intp),
        grid=np.array([[0.0, 1.0]]),
        slowness=t.slowness[[i]],
        speeds=zeros[1],
        velocity=t.velocity[speeds],
        directions=np.stack([zeros[0], zeros[0] - 1], axis=1),
        slope=t.slope[dry],
        dry=t.dry[dry].sum(axis=0, keepdims=True),  # over the same speeds
        slips=zeros[2],
        give=t.give[slips],
        slip=t.slip[slips],
        memory=t.memory[slips],
    )


def choice(trial: Twin, log: Log, tried: tuple[str, ...], settings: Settings = USUAL) -> dict[str, Any]:
    """Return which form predicts the end of a log best from its command, which none has seen, and the errors of each.

    On a machine with passive joints the free black box is the usual one (chapter 7 of the source). Another must also
    predict the log from its beginning on as well as that: some drift off within seconds.
    """
    t = log.t
    length = min((t[-1] - t[0]) / 3.0, settings.judged)
    end = log.rows(slice(int(np.searchsorted(t, t[-1] - length - 1.0)), None))  # run for a second before it
    start = int(np.searchsorted(end.t, t[-1] - length))
    both = {form: forecast_errors(trial, end, start, form) for form in tried}
    errors = {form: 0.5 * (e + u) for form, (e, u) in both.items()}
    usual = "black" if trial.machine.passive else "coupled"
    usual = usual if usual in errors else tried[0]
    best = better(usual, [x for x in tried if x != usual], lambda form: errors[form], settings.pays)
    if not np.isfinite(errors[best]):
        best = "coupled" if "coupled" in errors else best
    if best != usual:
        first = log.rows(slice(0, int(np.searchsorted(t, t[0] + settings.beginning)) + 1))
        e, other = (sum(forecast_errors(trial, first, 0, form)) for form in (best, usual))
        best = best if e <= other else usual
    kept = {form: None if not np.isfinite(x) else x for form, x in errors.items()}
    tracking = both[best][0] if np.isfinite(both[best][0]) else None
    return {
        "use": best,
        "held_out": kept,
        "tracking": tracking,
        "from": float(end.t[start]),
        "to": float(t[-1]),
    }


def forecast_errors(twin: Twin, log: Log, start: int, form: str) -> tuple[float, float]:
    """Return the mean errors of e and of u over all axes, each over its RMS [-]; infinite if the loop fails."""
    try:
        said = simulate(twin, log, controller=form)
    except PinotwinError:
        return np.inf, np.inf
    found = compare(twin.machine, log.rows(slice(start, None)), said.rows(slice(start, None)))
    ratios = ([found[name][signal]["nrmse"] for name in twin.servos] for signal in "eu")
    e, u = (
        float(np.mean(x[np.isfinite(x)])) if np.isfinite(x).any() else np.inf for x in map(np.array, ratios)
    )
    return e, u
