"""``update``: more healthy logs into a twin, without the rows of those that it has seen (:mod:`pinotwin.twin.moments`).

At the shapes found the problem stays linear: coefficients, bodies, errors, scatter and validation error follow anew;
shapes, leads, corner of the low-pass and controllers stay, and what the closed loops moved the friction by.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.columns import bind
from pinotwin.dynamics.parameters import with_parameters
from pinotwin.errors import DataError, TwinError
from pinotwin.identification.assemble import assemble, choose_rows, coefficient_names
from pinotwin.identification.bodies import near_urdf
from pinotwin.identification.friction import at_one_speed, friction_scatter
from pinotwin.identification.judge import CrossValidated, error_row, judge, log_edges, warnings
from pinotwin.identification.misfit import misfit_with
from pinotwin.identification.pipeline import provenance
from pinotwin.identification.plant import Plant, fit_options, open_loop, standard_parameters
from pinotwin.identification.settings import USUAL, Settings, Tell
from pinotwin.identification.smooth import memory
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.logs.prepare import prepare
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.solve.covariance import spread
from pinotwin.solve.crossval import held_out
from pinotwin.solve.linear import linear, solve
from pinotwin.solve.problem import Problem
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin import OpenLoop, Twin
from pinotwin.twin.misfit import Misfit
from pinotwin.twin.moments import Moments
from pinotwin.twin.twin import TwinLike, as_twin

HELD = "logs were added by update: shapes, leads and controllers are those of the first identification"


@one_blas_thread
def update(
    twin: TwinLike,
    log: LogLike | Sequence[LogLike],
    *,
    report: Tell | None = None,
    settings: Settings = USUAL,
) -> Twin:
    """Add healthy logs to a twin, as if it had been identified from all of them at the shapes that it has.

    Args:
        twin: or its folder.
        log: healthy servo log(s) of the same machine, or their files; those that it holds are passed over.
        report: called with the stage and the share done.
        settings: the numbers by which it decides.

    Returns:
        The new twin; the same one if it holds all logs already.

    Raises:
        TwinError: the twin keeps too little of its logs.
        LogError: a channel is missing or unusable.
        DataError: a log is too slow, or holds too little.
    """
    twin, tell = as_twin(twin), report or (lambda stage, done: None)
    fresh = {x.fingerprint(): x for x in as_logs(log)}
    fresh = {key: x for key, x in fresh.items() if key not in {row["fingerprint"] for row in twin.data}}
    if not fresh:
        return twin
    if twin.moments is None or twin.misfit is None or twin.machine.passive:
        why = "has passive joints" if twin.machine.passive else "keeps no moments of its logs"
        raise TwinError(f"{twin.machine.name}: this twin {why}; identify it again on all logs")
    tell("preparing the logs", 0.1)
    new = [_motion(twin, twin.misfit.motion.step, item) for item in fresh.values()]
    tell("adding the logs", 0.4)
    found = _added(twin, twin.moments, twin.misfit, new, settings)
    data = [provenance(x, bind(x, twin.machine.columns), m) for x, m in zip(fresh.values(), new, strict=True)]
    return replace(found, data=[*twin.data, *data])


def _motion(twin: Twin, step: float, log: Log) -> Motion:
    """Return a log prepared as the others, whose sampling interval is ``step`` [s]."""
    bound = bind(log, twin.machine.columns)
    motion = prepare(twin.machine, bound, **twin.settings)
    if motion.step > 1.01 * step:
        rates = f"{1.0 / motion.step:.4g} Hz, the twin's logs {1.0 / step:.4g} Hz"
        raise DataError(f"{log.source}: it has {rates}; record it as fast")
    if motion.step < 0.99 * step:
        motion = prepare(twin.machine, bound, **{**twin.settings, "resample": 1.0 / step})
    return motion


@dataclass(frozen=True)
class _Solved:
    """What moments say at the shapes of a twin: the plant, a row each of its factors, and every log from the others."""

    plant: Plant
    known: CrossValidated
    root: Floats  # F with F F' = (W'W)^-1 of all rows over their noise, shape (p, rank)
    price: Mapping[str, Any] | None  # of bodies that can exist

    @classmethod
    def of(
        cls, twin: Twin, motion: Motion, moments: Moments, settings: Settings, *, judged: bool = False
    ) -> _Solved:
        """Solve for the coefficients; bodies weigh as they did where no log is to be predicted from the others."""
        model = with_parameters(twin.machine.model, moments.pi)  # a saved twin's own URDF has what was found
        machine = replace(twin.machine, model=model)
        options, price = fit_options(machine, twin.effects, motion), twin.quality["consistency"]
        found, problem = solve(moments.whole, options), moments.problem(coefficient_names(twin.effects))
        options = replace(options, sigma=found.sigma, inference="none")
        inverse = found.rank.root @ found.rank.root.T
        fit = replace(
            linear(problem, options), covariance=inverse @ moments.scores @ inverse, dof=moments.dof
        )
        edges = log_edges(problem, problem.block) if judged else None
        held = None if edges is None else held_out(problem, options=options, edges=edges)
        folds, chosen = settings.folds if held is None else len(held.theta), choose_rows(motion)
        known = CrossValidated(twin.effects, len(motion), chosen, problem, problem.block, folds, held)
        shapes = [row for row in twin.parameters if row.kind == "shape"]
        errors, bounds = ([getattr(row, x) for row in shapes] for x in ("error", "verdict"))
        at_bound = np.array(bounds) == "at its bound"
        pi = standard_parameters(machine, twin.effects, fit.theta)
        plant = Plant(twin.effects, chosen, fit, fit.theta, pi, np.array(errors), at_bound, motion)
        if price is not None:
            if held is None:
                settings = replace(settings, urdf_rows=(price["urdf_rows"],))
            rows = moments.correlated(fit.theta, fit.sigma) if judged else price["correlated_rows"]
            plant, known, price = near_urdf(machine, plant, known, settings, rows)
        return cls(plant, known, found.rank.root, price)

    def scores(self, problem: Problem) -> tuple[Floats, Floats]:
        """Return the covariance of the summed scores of more rows, shape (p, p), and degrees of freedom, shape (p,)."""
        fit, error = self.plant.fit, problem.y - problem.W @ self.plant.fit.theta
        levels = dict(zip(fit.problem.slices, fit.sigma, strict=True))
        sigma = np.array([levels.get(j, rms(error[part])) for j, part in problem.slices.items()])
        N = fit.factor.T @ fit.factor
        covariance, dof = spread(problem, sigma, error, self.root)
        return N @ covariance @ N, dof


def _added(
    twin: Twin, held: Moments, known: Misfit, new: Sequence[Motion], settings: Settings, most: int = 50
) -> Twin:
    """Return a twin that has seen more logs than it held, of which it keeps at most so many apart."""
    before, rows = _Solved.of(twin, known.motion, held, settings), list(map(choose_rows, new))
    problems = [assemble(twin.scene(m), twin.effects, r) for m, r in zip(new, rows, strict=True)]
    for motion, problem in zip(new, problems, strict=True):
        left = problem.y - problem.W @ twin.theta
        if all(rms(left[part]) > np.std(problem.y[part]) for part in problem.slices.values()):
            raise DataError(
                f"{motion.source}: the twin of {twin.machine.name} explains nothing of any effort in it; it is a log "
                "of another machine, or its units or signs differ"
            )
    nv, lags, nothing = twin.machine.nv, memory(new[0]), (0.0 * held.scores, 0.0 * held.scores[0])
    rough = held + Moments.of(problems, nv, twin.theta, lags, *nothing, held.pi)
    free = _Solved.of(twin, known.motion, rough, settings)
    told = [sum(x) for x in zip(*map(free.scores, problems), strict=True)]
    moments = held + Moments.of(problems, nv, free.plant.fit.theta, lags, *told, held.pi)
    after = _Solved.of(twin, known.motion, moments := moments.shorter(most), settings, judged=True)
    parts = [
        CrossValidated(twin.effects, len(m), r, p, np.full(len(m), k), 1, None)
        for k, (m, r, p) in enumerate(zip(new, rows, problems, strict=True), len(held.logs))
    ]
    fit, moved = after.plant.fit, after.plant.theta + twin.theta - before.plant.theta
    theta, pi = np.clip(moved, fit.lower, fit.upper), after.plant.pi + twin.pi - before.plant.pi
    plant = replace(after.plant, theta=theta, pi=pi)
    misfit, blocks = misfit_with(open_loop(twin.machine, plant), known, new, parts, after.known, settings)
    plant, sums = at_one_speed(twin.machine, replace(plant, motion=misfit.motion), settings)
    fit, found = plant.fit, open_loop(twin.machine, plant)
    quality = judge(twin.machine, plant, found, after.known, None)
    quality["axes"] = _figures(twin, moments, quality["axes"], after.known.problem, blocks)
    days = friction_scatter(found, moments, fit.sigma)
    old = warnings(twin.quality, twin, misfit.motion, settings)
    said = [x for x in twin.quality["warnings"] if x not in (*old, HELD)]
    quality = {**twin.quality, **quality, "consistency": after.price, "days": days, "one_speed": sums}
    quality["preparation"] = [*twin.quality["preparation"], *(note for m in new for note in m.notes)]
    quality["warnings"] = [*warnings(quality, found, misfit.motion, settings), *said, HELD]
    quality.pop("validation_source", None)
    solved = {f.name: getattr(found, f.name) for f in fields(OpenLoop) if f.name != "diagonal"}
    return replace(twin, **solved, quality=quality, groups=fit.group_names(), misfit=misfit, moments=moments)


def _figures(
    twin: Twin, moments: Moments, axes: Mapping[str, Any], problem: Problem, blocks: CrossValidated | None
) -> dict[str, Any]:
    """Return the figures of every axis over the rows themselves, from those over their factors."""
    out = {}
    for j, part in problem.slices.items():
        name = twin.machine.names[j]
        n = sum(log.rows[j] for log in moments.logs)
        share, mean = np.sqrt((part.stop - part.start) / n), moments.sums[:, j].sum() / n
        std = max(np.sqrt(max(problem.y[part] @ problem.y[part] / n - mean**2, 0.0)), 1e-300)
        row, held = dict(axes[name]), dict(axes[name]["held_out"])
        row |= {"rms": row["rms"] * share, "fit_std": row["rms"] * share / std, "rows": n}
        row["held_out"] = held | {"rms": held["rms"] * share, "nrmse_std": held["rms"] * share / std}
        if blocks is not None and blocks.held is not None and j in blocks.problem.slices:
            here = blocks.problem.slices[j]
            row["held_out"] = error_row(blocks.problem.y[here], blocks.held.error[here])
        old = twin.quality["axes"].get(name, {})
        out[name] = row | {k: old[k] for k in ("lag1", "durbin_watson") if k in old}
    return out
