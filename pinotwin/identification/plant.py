"""The open-loop plant: all axes in one problem, shapes searched, coefficients solved (Eq. 3.17-3.21)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.dynamics.parameters import parameters
from pinotwin.effects import Effect, needs_model, with_model_effort
from pinotwin.effects.layout import effect_keys, effect_slices, rigid_body_of
from pinotwin.identification.assemble import Rows, assemble, choose_rows, pieces
from pinotwin.identification.settings import USUAL, Settings
from pinotwin.identification.shapes import Found, search_shapes, widened
from pinotwin.identification.smooth import with_beliefs
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.result import LinearFit
from pinotwin.twin import OpenLoop
from pinotwin.twin.parameters import Parameter, Parameters, verdict


@dataclass(frozen=True)
class Plant:
    """What the fit of the open loop found."""

    effects: tuple[Effect, ...]  # with the shapes found
    rows: Rows  # which rows were fitted
    fit: LinearFit  # linear fit at those shapes
    theta: Floats  # coefficients, shape (p,)
    # standard inertial parameters; of the least squares the nearest to the URDF's, possible or not
    pi: Floats
    shape_errors: Floats  # standard error of every searched shape, in the order of the effects
    shape_at_bound: Mask  # whether it ended at a bound
    motion: Motion  # what was fitted, with the model's own effort where an effect scales with it
    # see :attr:`pinotwin.twin.OpenLoop.bodies`; none before they are asked for
    bodies: tuple[Mapping[str, Any], ...] = ()


def fit_plant(machine: Machine, motion: Motion, settings: Settings = USUAL) -> Plant:
    """Identify the open-loop dynamics of a machine from one motion."""
    effects = tuple(effect.fitted_to(motion) for effect in machine.effects)
    rows = choose_rows(motion)
    plain = tuple(effect for effect in effects if not effect.needs)
    told = iter(with_beliefs(plain, motion, rows, lambda e: fit_options(machine, e, motion)))
    effects = tuple(effect if effect.needs else next(told) for effect in effects)
    motion, (fit, effects, errors, bounds) = _settled(machine, motion, effects, rows, settings)
    pi = standard_parameters(machine, effects, fit.theta)
    return Plant(effects, rows, fit, fit.theta, pi, errors, bounds, motion)


def standard_parameters(machine: Machine, effects: Sequence[Effect], theta: Floats) -> Floats:
    """Return the standard inertial parameters of coefficients (p,) that are nearest to the URDF's, shape (p_std,)."""
    P, pi0 = machine.base.P, parameters(machine.model)
    return np.asarray(pi0 + np.linalg.pinv(P) @ (theta[rigid_body_of(effects)[1]] - P @ pi0))


def _settled(
    machine: Machine, motion: Motion, effects: tuple[Effect, ...], rows: Rows, settings: Settings
) -> tuple[Motion, Found]:
    """Solve, again and again where an effect scales with the model's effort: first with that of the other effects."""
    if not needs_model(effects):
        return motion, _solve(motion, effects, rows, fit_options(machine, effects, motion), settings)
    plain = tuple(effect for effect in effects if not effect.needs)
    first = _solve(motion, plain, rows, fit_options(machine, plain, motion), settings)
    motion = with_model_effort(motion, first[1], first[0].theta)
    options = fit_options(machine, effects, motion)
    known = iter(first[1])
    effects = tuple(effect if effect.needs else next(known) for effect in effects)
    unknown = [k for k, effect in enumerate(effects) if effect.needs]
    for _ in range(12):
        solved = _solve(motion, effects, rows, options, settings, unknown)
        effects, unknown = solved[1], []
        before, motion = motion.model, with_model_effort(motion, solved[1], solved[0].theta)
        assert before is not None
        assert motion.model is not None
        if np.linalg.norm(motion.model - before) <= 1e-6 * np.linalg.norm(motion.model):
            break
    return motion, solved


def fit_options(machine: Machine, effects: Sequence[Effect], motion: Motion | None = None) -> Options:
    """Return bounds from the effects, and the CAD values as prior for what the data leave open.

    With a motion, table knots are weakly held within the size of their axis' effort: none then runs away.
    """
    coefficients = [c for effect in effects for c in effect.coefficients()]
    mean = np.zeros(len(coefficients))
    mean[rigid_body_of(effects)[1]] = machine.base.from_standard(parameters(machine.model))
    belief, alike, ridge = _beliefs(effects, motion)
    return Options(
        prior=mean,
        belief=belief,
        alike=alike,
        ridge=ridge,
        lower=np.array([c.lower for c in coefficients]),
        upper=np.array([c.upper for c in coefficients]),
    )


def _beliefs(effects: Sequence[Effect], motion: Motion | None) -> tuple[Floats | None, ...]:
    """Return rows of what is believed, how many of the data are as one of each, and the ridge of what is held."""
    slices, rows, alike = effect_slices(effects), [], []
    ridge = np.full(slices[-1].stop, np.inf)
    for effect, where in zip(effects, slices, strict=True):
        if (said := effect.belief()) is not None:
            own = np.zeros((len(said[0]), len(ridge)))
            own[:, where] = said[0]
            rows.append(own)
            alike.append(np.full(len(own), said[1]))
        elif effect.held and motion is not None:
            assert effect.axis is not None
            u = motion.u[:, motion.index(effect.axis)]
            ridge[where] = max(float(np.sqrt(np.nanmean(u**2))), 1e-12) if np.isfinite(u).any() else 1.0
    held = ridge if np.isfinite(ridge).any() else None
    return (np.concatenate(rows), np.concatenate(alike), held) if rows else (None, None, held)


def _solve(
    motion: Motion,
    effects: tuple[Effect, ...],
    rows: Rows,
    options: Options,
    settings: Settings,
    unknown: Sequence[int] | None = None,
) -> Found:
    """Solve for coefficients and shapes; of the shapes only those of some effects are unknown, of None all."""
    searched = _shaped(motion, effects, rows)
    if not searched:
        count = sum(len(effect.shapes()) for effect in effects)
        fit = linear(assemble(motion, effects, rows), options)
        return fit, effects, np.full(count, np.nan), np.zeros(count, bool)

    def search(m: Motion, effects: tuple[Effect, ...], r: Rows, places: list[int], wide: list[int]) -> Found:
        """Search the shapes at some places, a part of them all over; then further ones where these pay."""
        found = search_shapes(m, effects, r, places, options, wide)
        wider = widened(m, found[1], r, settings.pays) if wide else {}
        if not wider:
            return found
        effects = tuple(wider.get(k, effect) for k, effect in enumerate(found[1]))
        again = [k for k in places if effects[k].axis in {effect.axis for effect in wider.values()}]
        return search_shapes(m, effects, r, places, options, again)

    short = pieces(motion, rows, settings) if unknown is None else None
    if short is None:
        fresh = searched if unknown is None else [k for k in searched if k in unknown]
        return search(motion, effects, rows, searched, fresh)
    seen: list[int] = []
    if short.use.any() and (seen := _shaped(short, effects, few := choose_rows(short))):
        effects = search(short, effects, few, seen, seen)[1]
    return search_shapes(motion, effects, rows, searched, options, [k for k in searched if k not in seen])


def _shaped(motion: Motion, effects: Sequence[Effect], rows: Rows) -> list[int]:
    """Return the places of the effects whose shapes the rows can tell."""
    return [k for k, e in enumerate(effects) if e.axis and e.shapes() and motion.index(e.axis) in rows.joints]


def open_loop(machine: Machine, fit: Plant) -> OpenLoop:
    """Return what a fit found of a machine."""
    return OpenLoop(
        machine=machine,
        effects=fit.effects,
        theta=fit.theta,
        covariance=fit.fit.covariance,
        parameters=parameter_table(fit),
        pi=fit.pi,
        bodies=fit.bodies,
    )


def parameter_table(plant: Plant) -> Parameters:
    """Return one row per coefficient and per searched shape."""
    rows: list[Parameter] = []
    shapes, effects = iter(zip(plant.shape_errors, plant.shape_at_bound, strict=True)), plant.effects
    for key, effect, where in zip(effect_keys(effects), effects, effect_slices(effects), strict=True):
        rows += _linear_rows(key, effect, where, plant)
        seen = bool(np.any(np.abs(plant.theta[where]) > 0))
        for shape, value in zip(effect.shapes(), effect.shape_values(), strict=True):
            error, at_bound = next(shapes)
            known = bool(np.isfinite(error)) and seen and not at_bound
            word = verdict(value, float(error), at_bound=bool(at_bound))
            word = word if seen else "not determined: its coefficients are zero"
            error, name = float(error) if known else np.nan, f"{key}.{shape.name}"
            dof = float(plant.fit.dof[where].min())  # told by the rows in which its columns act
            rows.append(Parameter(name, key, "shape", value, shape.unit, error, known, word, dof=dof))
    return Parameters(rows)


def _linear_rows(key: str, effect: Effect, where: slice, plant: Plant) -> Iterator[Parameter]:
    fit, prior = plant.fit, effect.nominal()
    for k, (coefficient, name) in enumerate(zip(effect.coefficients(), effect.labels(), strict=True)):
        at = where.start + k
        known, value, error = bool(fit.determined[at]), float(plant.theta[at]), float(fit.standard_errors[at])
        yield Parameter(
            name=f"{key}.{name}",
            effect=key,
            kind="linear",
            value=value,
            unit=coefficient.unit,
            error=error if known else np.nan,
            determined=known,
            verdict=_verdict(fit, at, value, error),
            prior=None if prior is None else float(prior[k]),
            meaning=coefficient.name if name != coefficient.name else "",
            dof=float(fit.dof[at]),
        )


def _verdict(fit: LinearFit, at: int, value: float, error: float) -> str:
    if at in fit.unexcited:
        return "not determined: nothing in this log excites it"
    if not fit.determined[at]:
        group = next((g for g in fit.groups if at in g), ())
        others = ", ".join(fit.names[i] for i in group if i != at)
        return f"not determined: not separable from {others}" if others else "not determined"
    return verdict(value, error, at_bound=bool(fit.active[at]))
