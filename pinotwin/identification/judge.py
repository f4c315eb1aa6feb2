"""How good a fit is: errors per axis, in sample and cross-validated, whiteness, condition, bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.effects import Effect, needs_model
from pinotwin.effects.position import PositionTable
from pinotwin.effects.scene import with_model
from pinotwin.errors import DataError
from pinotwin.identification.assemble import Rows, assemble, choose_rows
from pinotwin.identification.plant import Plant, fit_options
from pinotwin.identification.settings import USUAL, Settings
from pinotwin.machine import Machine
from pinotwin.machine.urdf import no_urdf_holds
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.solve.crossval import HeldOut, fold_order, held_out
from pinotwin.solve.problem import Problem
from pinotwin.solve.result import LinearFit
from pinotwin.twin import OpenLoop


@dataclass(frozen=True, eq=False)
class CrossValidated:
    """A linear problem of a machine's effects, cross-validated: its rows predicted part by part from the others."""

    effects: tuple[Effect, ...]  # with fixed shapes
    length: int  # rows of the motion
    rows: Rows  # which of them the problem holds
    problem: Problem  # rows and columns
    log: Ints  # number of the log of each row of the motion, shape (n,)
    folds: int  # parts of the logs: whole ones where there are enough
    held: HeldOut | None  # what the parts predict of one another; None where there are too few rows

    @classmethod
    def of(
        cls,
        machine: Machine,
        effects: Sequence[Effect],
        motion: Motion,
        known: tuple[Rows, LinearFit] | None = None,
        folds: int = USUAL.folds,
        log: Ints | None = None,
    ) -> Self:
        """Cross-validate the problem of some effects, fitted already or of a motion's rows (n,)."""
        rows = known[0] if known else choose_rows(motion)
        problem = known[1].problem if known else assemble(motion, effects, rows)
        options = replace(fit_options(machine, effects, motion), start=known[1].sigma if known else None)
        log = np.zeros(len(motion), dtype=np.intp) if log is None else log
        edges = log_edges(problem, log[rows.sample[problem.time]])
        try:
            held = held_out(problem, folds, options=options, edges=edges)
        except DataError:
            held = None
        folds = folds if held is None else len(held.theta)
        return cls(tuple(effects), len(motion), rows, problem, log, folds, held)

    def serves(self, effects: Sequence[Effect], motion: Motion) -> bool:
        """Whether that of these effects on a motion would be the same; not where columns follow theta."""
        same = list(map(id, effects)) == list(map(id, self.effects)) and len(motion) == self.length
        return same and not needs_model(effects)


def log_edges(problem: Problem, log: Ints, fewest: int = 3, most: int = 12) -> Ints | None:
    """Return where numbered logs begin, and the end, of rows, shape (rows,): ``most`` parts at most; None if few."""
    order, times = fold_order(problem)
    starts = np.array([order[log == k].min() for k in np.unique(log)])
    if len(starts) < fewest:
        return None
    first = np.linspace(0, len(starts), min(len(starts), most) + 1).astype(int)[:-1]
    return np.append(starts[first], times)


def error_row(y: Floats, error: Floats) -> dict[str, float]:
    """Return the figures of one axis' effort and error [N or N·m], shape (m,); ``nrmse_std`` leaves gravity out."""
    size = rms(error)
    spread, whole = max(float(np.std(y)), 1e-300), max(rms(y), 1e-300)
    return {"rms": size, "nrmse": size / whole, "nrmse_std": size / spread}


def whiteness_row(residual: Floats) -> dict[str, float]:
    """Return lag-one correlation and Durbin-Watson statistic of one axis' residual, shape (m,)."""
    e = residual - residual.mean()
    power = float(e @ e)
    if power <= 0.0 or len(e) < 3:
        return {"lag1": 0.0, "durbin_watson": 2.0}
    return {"lag1": float(e[1:] @ e[:-1]) / power, "durbin_watson": float(np.sum(np.diff(e) ** 2)) / power}


def warnings(
    quality: Mapping[str, Any], plant: OpenLoop, motion: Motion, settings: Settings = USUAL
) -> list[str]:
    """Return what the reader should know before trusting the numbers."""
    machine = plant.machine
    rotary = dict(zip(machine.names, machine.rotary, strict=True))
    out = [
        f"{name}: no effort in the log (channel {name}.u is missing or never changes): friction of this axis is not "
        "identified"
        for name, axis in machine.axes.items()
        if np.isnan(motion.u[:, axis.index]).all()
    ]
    if no_urdf_holds(plant.model):
        out.append(
            "the inertias that were found are impossible (a mass or a moment of inertia is negative): the URDF of a "
            "saved twin keeps those of the description; identify with physical consistency for a URDF of what was found"
        )
    if quality["condition"] > settings.condition:
        out.append(
            f"condition number {quality['condition']:.1e}: some parameters trade off against each "
            "other; more varied motion would part them"
        )
    out += [f"not separable on this log: {', '.join(group)}" for group in quality["not_separable"]]
    for name, row in quality.get("one_speed", {}).items():
        effort, speed = ("N·m", "rad/s") if rotary[name] else ("N", "m/s")
        size = f"{row['effort']:.4g} ± {row['half']:.2g} {effort} at {row['speed']:.3g} {speed}"
        out.append(f"{name} moves at one speed: of its friction only c + b v = {size} is known")
    out += coarser_tables(machine.effects, plant.effects)
    for name in quality["at_bound"]:
        out.append(f"{name} ended at its bound")
    for name, row in quality["axes"].items():
        held = row["held_out"]["nrmse_std"]
        if np.isfinite(held) and held > 2.0 * max(row["fit_std"], 1e-3) and held > 0.1:
            out.append(
                f"{name}: held-out error {held:.0%} of the effort's deviation against "
                f"{row['fit_std']:.0%} in the fit: the log is too short or too uniform"
            )
        if row["held_out"]["nrmse_std"] > 0.5:
            unit = "N·m" if rotary.get(name) else "N"
            out.append(
                f"{name}: the model explains little of this axis' effort "
                f"({row['held_out']['rms']:.3g} {unit} left); see `pinotwin diagnose`"
            )
    return out


def coarser_tables(given: Sequence[Effect], used: Sequence[Effect]) -> list[str]:
    """Return a line [m or rad] for each table whose knots are further apart than was asked for."""
    return [
        f"{b.axis}: the knots of its position table are {b.spacing:.3g} {b.unit('x')} apart, not {a.spacing:.3g}: "
        f"at most {b.most} on a travel; finer waves are its pitches"
        for a, b in zip(given, used, strict=False)
        if isinstance(a, PositionTable) and isinstance(b, PositionTable) and b.spacing > a.spacing
    ]


def signs_of_missing_effects(
    quality: Mapping[str, Any], rigid_pairs: int = 2, settings: Settings = USUAL
) -> list[str]:
    """Return what in the figures of a twin suggests an effect that its machine does not list."""
    loops, servos = quality.get("loops", {}), quality.get("servos", {})
    return [
        *(f"{name} ended at its bound" for name in quality["at_bound"]),
        *(
            f"{name}: its loop vibrates with more poles than a rigid axis has"
            for name, row in loops.items()
            if row["pole_pairs"] > rigid_pairs
        ),
        *(
            f"{name}: its controller misses {row['held_out']['e']:.0%} of the tracking error"
            for name, row in servos.items()
            if row["held_out"]["e"] > settings.missed
        ),
    ]


def judge(
    machine: Machine, plant: Plant, found: OpenLoop, validated: CrossValidated, later: Motion | None
) -> dict[str, Any]:
    """Return the figures of a fitted plant, ``found``, per axis and together; an unseen motion adds ``validation``."""
    fit, problem = plant.fit, plant.fit.problem
    error = problem.y - problem.W @ plant.theta
    held = np.full(len(problem.y), np.nan) if validated.held is None else validated.held.error
    axes = {}
    for joint, rows in problem.slices.items():
        own = error_row(problem.y[rows], error[rows])
        axes[machine.names[joint]] = {
            "fit": own["nrmse"],
            "fit_std": own["nrmse_std"],
            "rms": own["rms"],
            "held_out": error_row(problem.y[rows], held[rows]),
            **whiteness_row(error[rows]),
            "rows": int(rows.stop - rows.start),
        }
    out = {
        "axes": axes,
        "relative_error": float(np.linalg.norm(error) / np.linalg.norm(problem.y)),
        "condition": float(fit.condition),
        "rank": int(fit.rank),
        "parameters": len(plant.theta),
        "not_separable": [list(group) for group in fit.group_names()],
        "folds": validated.folds,
        "at_bound": [row.name for row in found.parameters if row.verdict == "at its bound"],
        "preparation": list(plant.motion.notes),
    }
    if later is not None:
        later = with_model(later, plant.effects, plant.theta)
        problem = assemble(later, plant.effects)
        error = problem.y - problem.W @ plant.theta
        for joint, rows in problem.slices.items():
            if machine.names[joint] in axes:
                axes[machine.names[joint]]["validation"] = error_row(problem.y[rows], error[rows])
        out["validation_source"] = later.source
    return out
