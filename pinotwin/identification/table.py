"""The parameter table of a twin, from what the fit found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.identification.loop_parts import Loops
from pinotwin.identification.plant import Plant
from pinotwin.identification.refine import AxisEffects
from pinotwin.machine import Machine
from pinotwin.twin.open_loop import OpenLoop
from pinotwin.twin.parameters import Parameter, Parameters, verdict


def parameter_table(machine: Machine, plant: Plant) -> Parameters:
    """Return one row per coefficient and per searched shape."""
    rows: list[Parameter] = []
    keys = effect_keys(plant.effects)
    at = 0
    for key, effect, where in zip(keys, plant.effects, effect_slices(plant.effects), strict=True):
        rows += _linear_rows(key, effect, where, plant)
        count = len(effect.shapes())
        rows += _shape_rows(key, effect, slice(at, at + count), where, plant)
        at += count
    return Parameters(rows)


def open_loop(machine: Machine, fit: Plant) -> OpenLoop:
    """Return what a fit found of a machine."""
    return OpenLoop(
        machine=machine,
        effects=fit.effects,
        theta=fit.theta,
        covariance=fit.fit.covariance,
        parameters=parameter_table(machine, fit),
        pi=fit.pi,
    )


def _linear_rows(key: str, effect: Effect, where: slice, plant: Plant) -> list[Parameter]:
    fit = plant.fit
    error = fit.standard_errors[where]
    names, prior = effect.labels(), effect.nominal()
    rows = []
    for k, coefficient in enumerate(effect.coefficients()):
        at = where.start + k
        known = bool(fit.determined[at])
        value = float(plant.theta[at])
        rows.append(
            Parameter(
                name=f"{key}.{names[k]}",
                effect=key,
                kind="linear",
                value=value,
                unit=coefficient.unit,
                error=float(error[k]) if known else np.nan,
                determined=known,
                verdict=_verdict(plant, at, value, float(error[k])),
                prior=None if prior is None else float(prior[k]),
                meaning=coefficient.name if names[k] != coefficient.name else "",
            )
        )
    return rows


def _verdict(plant: Plant, at: int, value: float, error: float) -> str:
    fit = plant.fit
    if at in fit.unexcited:
        return "not determined: nothing in this log excites it"
    if not fit.determined[at]:
        group = next((g for g in fit.groups if at in g), ())
        others = ", ".join(fit.names[i] for i in group if i != at)
        return f"not determined: not separable from {others}" if others else "not determined"
    return verdict(value, error, at_bound=bool(fit.active[at]))


def _shape_rows(key: str, effect: Effect, which: slice, where: slice, plant: Plant) -> list[Parameter]:
    rows = []
    errors, bounds = plant.shape_errors[which], plant.shape_at_bound[which]
    seen = bool(np.any(np.abs(plant.theta[where]) > 0))
    pairs = zip(effect.shapes(), effect.shape_values(), errors, bounds, strict=True)
    for shape, value, error, at_bound in pairs:
        known = bool(np.isfinite(error)) and seen and not at_bound
        word = verdict(value, float(error), at_bound=bool(at_bound))
        rows.append(
            Parameter(
                name=f"{key}.{shape.name}",
                effect=key,
                kind="shape",
                value=value,
                unit=shape.unit,
                error=float(error) if known else np.nan,
                determined=known,
                verdict=word if seen else "not determined: its coefficients are zero",
            )
        )
    return rows


def refined_table(plant: OpenLoop, found: Loops) -> Parameters:
    """Return the table of a plant with the rows that its closed loops refined."""
    rows = {row.name: row for row in plant.parameters}
    for axis in found.refined.values():
        keys = dict(zip(map(id, found.effects), plant.keys, strict=True))
        linear, shape = list(zip(axis.theta, axis.error, strict=True)), _shape_numbers(axis)
        for effect in axis.effects:
            key = keys[id(effect)]
            names = [c.name for c in effect.coefficients()]
            for name in names:
                value, error = linear.pop(0)
                rows[f"{key}.{name}"] = _renewed(rows[f"{key}.{name}"], float(value), float(error))
            for item in effect.shapes():
                value, error = shape.pop(0)
                rows[f"{key}.{item.name}"] = _renewed(rows[f"{key}.{item.name}"], value, error)
    return Parameters(rows.values())


def _shape_numbers(axis: AxisEffects) -> list[tuple[float, float]]:
    """Return value and standard error of every shape, in plain units."""
    out = []
    errors = list(axis.shape_error) if axis.shape_error is not None else []
    for effect in axis.effects:
        for item, value in zip(effect.shapes(), effect.shape_values(), strict=True):
            error = errors.pop(0) if errors else np.nan
            out.append((value, float(value * error if item.log else error)))
    return out


def _renewed(row: Parameter, value: float, error: float) -> Parameter:
    known = row.determined and np.isfinite(error) and error > 0.0
    return replace(
        row,
        value=value,
        error=error if known else np.nan,
        determined=known,
        verdict=verdict(value, error, at_bound=value == 0.0) if known else row.verdict,
    )


def at_bounds(rows: Sequence[Parameter]) -> list[str]:
    """Return the names of the parameters that ended at a bound."""
    return [row.name for row in rows if row.verdict == "at its bound"]
