"""The parameter table of a twin, from what the fit found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.identification.loop_parts import Loops
from pinotwin.identification.plant import Plant
from pinotwin.machine import Machine
from pinotwin.solve.result import LinearFit
from pinotwin.twin.open_loop import OpenLoop
from pinotwin.twin.parameters import Parameter, Parameters, verdict


def open_loop(machine: Machine, fit: Plant) -> OpenLoop:
    """Return what a fit found of a machine."""
    return OpenLoop(
        machine=machine,
        effects=fit.effects,
        theta=fit.theta,
        covariance=fit.fit.covariance,
        parameters=parameter_table(fit),
        pi=fit.pi,
    )


def parameter_table(plant: Plant) -> Parameters:
    """Return one row per coefficient and per searched shape."""
    rows: list[Parameter] = []
    keys, shapes = (
        effect_keys(plant.effects),
        iter(zip(plant.shape_errors, plant.shape_at_bound, strict=True)),
    )
    for key, effect, where in zip(keys, plant.effects, effect_slices(plant.effects), strict=True):
        rows += _linear_rows(key, effect, where, plant)
        seen = bool(np.any(np.abs(plant.theta[where]) > 0))
        for shape, value in zip(effect.shapes(), effect.shape_values(), strict=True):
            error, at_bound = next(shapes)
            known = bool(np.isfinite(error)) and seen and not at_bound
            word = verdict(value, float(error), at_bound=bool(at_bound))
            word = word if seen else "not determined: its coefficients are zero"
            error, name = float(error) if known else np.nan, f"{key}.{shape.name}"
            rows.append(Parameter(name, key, "shape", value, shape.unit, error, known, word))
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
        )


def _verdict(fit: LinearFit, at: int, value: float, error: float) -> str:
    if at in fit.unexcited:
        return "not determined: nothing in this log excites it"
    if not fit.determined[at]:
        group = next((g for g in fit.groups if at in g), ())
        others = ", ".join(fit.names[i] for i in group if i != at)
        return f"not determined: not separable from {others}" if others else "not determined"
    return verdict(value, error, at_bound=bool(fit.active[at]))


def refined_table(plant: OpenLoop, found: Loops) -> Parameters:
    """Return the table of a plant with the rows that its closed loops refined."""
    rows = {row.name: row for row in plant.parameters}
    keys = dict(zip(map(id, found.effects), plant.keys, strict=True))
    for axis in found.refined.values():
        for effect, name, value, error in axis.numbers():
            row = rows[f"{keys[id(effect)]}.{name}"]
            known = row.determined and bool(np.isfinite(error)) and error > 0.0
            word = verdict(value, error, at_bound=value == 0.0) if known else row.verdict
            error = error if known else np.nan
            rows[row.name] = replace(row, value=value, error=error, determined=known, verdict=word)
    return Parameters(rows.values())


def at_bounds(rows: Sequence[Parameter]) -> list[str]:
    """Return the names of the parameters that ended at a bound."""
    return [row.name for row in rows if row.verdict == "at its bound"]
