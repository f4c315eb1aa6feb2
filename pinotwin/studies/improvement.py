"""``improve``: identify, ask what is missing, add it, identify again, while it helps on a sealed log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.conclusion.sizes import size_text, told
from pinotwin.diagnosis.phrases import on_axis
from pinotwin.diagnosis.result import Found
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.machine import Machine, MachineLike, as_machine
from pinotwin.notebook import Card, Shown, share_cell
from pinotwin.twin import Twin

Tell = Callable[[str, float], None]
Errors = Mapping[str, Mapping[str, float]]
"""Axis -> ``u`` (effort along the measured motion), ``e`` (tracking error from the command): RMS error / RMS."""


@dataclass(frozen=True)
class Step:
    """One model on the way."""

    # what was added to the model before, one text each: cause, axis and size with its unit
    added: Sequence[str]
    errors: Errors  # on the sealed logs, see :data:`Errors`
    kept: bool = True  # whether the sealed logs are predicted better than by the model before


@dataclass(frozen=True, repr=False)
class Improvement(Card):
    """The best twin, and the steps that led to it."""

    twin: Twin  # the last one that was kept
    steps: Sequence[Step]  # all models, the machine as described first
    end: str  # why there are no more

    def rows(self) -> list[list[str]]:
        """Return the cells of a table: step, error of the effort and of tracking on every axis, in per cent."""
        signals = [(name, signal) for name, row in self.steps[0].errors.items() for signal in row]
        return [
            [
                f"{k}" if step.kept else f"{k} (not kept)",
                *(share_cell(step.errors[name].get(signal)) for name, signal in signals),
            ]
            for k, step in enumerate(self.steps)
        ]

    def head(self) -> list[str]:
        """Return the title of each column of :meth:`rows`."""
        return ["step", *(f"{name}.{signal}" for name, row in self.steps[0].errors.items() for signal in row)]

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin improve --json`` writes."""
        steps = [{"added": list(s.added), "errors": s.errors, "kept": s.kept} for s in self.steps]
        return {"machine": self.twin.machine.name, "steps": steps, "end": self.end}

    def _shown(self) -> Shown:
        return f"Improvement of {self.twin.machine.name}", self.head(), self.rows(), self.end


def improve(
    machine: MachineLike,
    log: LogLike | Sequence[LogLike],
    *,
    validate: LogLike | Sequence[LogLike],
    seed: int = 0,
    most: int = 5,
    report: Tell | None = None,
) -> Improvement:
    """Identify a machine, add what its model lacks, identify it again, until nothing helps on a sealed log.

    Args:
        machine: what is believed about it; or its folder, URDF or bundled name, or a ``pin.Model``.
        log: servo log(s) of the healthy machine to fit, or their files.
        validate: log(s) that neither fit nor diagnosis sees; they decide whether a step is kept.
        seed: of everything random.
        most: largest number of steps after the first.
        report: called with the stage and the share done.

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the logs hold too little.
    """
    tell = report or (lambda stage, done: None)
    believed, logs, sealed = as_machine(machine), as_logs(log), as_logs(validate, "validate")
    twin = identify(believed, logs, validate=sealed, report=_part(tell, 0, most, ""))
    steps = [Step((), sealed_errors(twin, sealed))]
    for k in range(1, most + 1):
        found = diagnose(believed, logs, seed=seed, report=_part(tell, k, most, "diagnosis: "))
        added = [
            e for e in found.effects if _parts(replace(found, effects=(e,)).repaired()) != _parts(believed)
        ]
        if not added:
            why = f"what the diagnosis finds is no part of a machine: {'; '.join(map(_said, found.effects))}"
            return Improvement(twin, steps, why if found.effects else "the diagnosis finds no further effect")
        richer = found.repaired()
        better = identify(richer, logs, validate=sealed, report=_part(tell, k + 0.5, most, ""))
        errors = sealed_errors(better, sealed)
        kept = ratio(steps[-1].errors, errors) < 1.0
        steps.append(Step([_said(e) for e in added], errors, kept))
        if not kept:
            return Improvement(twin, steps, "what was found last does not help on the sealed log")
        believed, twin = richer, better
    return Improvement(twin, steps, f"stopped after {most} steps")


def sealed_errors(twin: Twin, sealed: Sequence[Log]) -> Errors:
    """Return the errors on logs that the twin was judged on: of the effort, and of tracking where it has loops."""
    axes = twin.quality["axes"]
    errors = {name: {"u": float(row["validation"]["nrmse"])} for name, row in axes.items()}
    if twin.servos or twin.loops:
        simulated = [twin.simulate(log).errors for log in sealed]
        for name, row in errors.items():
            if all("e" in run.get(name, {}) for run in simulated):
                row["e"] = float(np.mean([run[name]["e"]["nrmse"] for run in simulated]))
    return errors


def ratio(before: Errors, after: Errors) -> float:
    """Return the geometric mean of the errors' ratios over all axes and signals that both have [1]."""
    pairs = [
        (x, after[name][signal])
        for name, row in before.items()
        for signal, x in row.items()
        if signal in after.get(name, {}) and x > 0.0 and after[name][signal] > 0.0
    ]
    return float(np.exp(np.mean([np.log(y / x) for x, y in pairs]))) if pairs else np.inf


def _part(tell: Tell, step: float, most: int, prefix: str) -> Tell:
    """Return the report of half a step."""
    return lambda stage, done: tell(prefix + stage, (step + 0.5 * done) / (most + 1))


def _parts(machine: Machine) -> list[Any]:
    """Return what a diagnosis can add to: effects and limit of every axis, springs, bodies."""
    axes = [(axis.effects, axis.effort_limit) for axis in machine.axes.values()]
    return [axes, dict(machine.passive), list(machine.model.inertias)]


def _said(e: Found) -> str:
    """Return a named cause with its axis and its size."""
    return ", ".join([on_axis(e.effect, e.axis), *map(size_text, told(e.size)[:3])])
