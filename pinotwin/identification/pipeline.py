"""``identify``: logs to twin (thesis Fig. 4-6), with progress and with its own judgement."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import diagonal
from pinotwin.dynamics.parameters import parameters
from pinotwin.effects.scene import with_model
from pinotwin.errors import DataError
from pinotwin.identification.assemble import assemble
from pinotwin.identification.judge import error_row, prediction_rows, warnings, whiteness_row
from pinotwin.identification.lead import find_leads
from pinotwin.identification.misfit import misfit_of
from pinotwin.identification.plant import Plant, fit_options, fit_plant
from pinotwin.identification.springs import with_springs
from pinotwin.identification.table import at_bounds, parameter_table
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike, as_logs
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.machine.given import MachineLike, as_machine
from pinotwin.motion import Motion
from pinotwin.solve.crossval import held_out
from pinotwin.solve.linear import Options
from pinotwin.threads import one_blas_thread
from pinotwin.twin import Twin

FOLDS = 5


@one_blas_thread
def identify(  # noqa: PLR0913, the public call: every option is a keyword
    machine: MachineLike,
    log: LogLike | Sequence[LogLike],
    *,
    validate: LogLike | Sequence[LogLike] | None = None,
    loop: bool = True,
    consistent: bool = True,
    cutoff: float | None = None,
    decimate: int | None = None,
    resample: float | None = None,
    report: Callable[[str, float], None] | None = None,
    springs: bool = True,
) -> Twin:
    """Find the model of a machine in its logs.

    All axes are fitted in one problem, so that a parameter that two axes share is found once.

    Args:
        machine: what is believed about it; or its folder, URDF or bundled name.
        log: servo log(s) to fit, or their files.
        validate: log(s) to judge on; without them the judgement is on held-out blocks.
        loop: also identify the closed loops of the axes whose command is logged.
        consistent: require inertias that a real body could have.
        cutoff: corner of the zero-phase low-pass [Hz]; chosen from the data when None.
        decimate: fit one row in so many; chosen from the corner when None.
        resample: rate of the even clock to put the logs on [Hz]; theirs when None.
        report: called with the stage and the share done.
        springs: also find those of passive joints; not where their vibration was predicted from springs.

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the logs hold too little to identify anything.
    """
    tell = report or _silent
    tell("preparing the log", 0.02)
    machine, logs = as_machine(machine).require_physical(), as_logs(log)
    machine = _as_logged(machine, logs, resample)
    prepared = functools.partial(prepare, log=logs, cutoff=cutoff, decimate=decimate)
    tell("fitting the plant", 0.1)
    machine, motion, plant, leads = _with_leads(machine, prepared, consistent and not machine.passive, loop)
    tell("judging the plant", 0.4)
    table = parameter_table(machine, plant)
    quality = _quality(machine, motion, plant) | {"leads": leads, "at_bound": at_bounds(table)}
    if validate is not None:
        _validate(machine, plant, as_logs(validate, "validate"), _settings(machine, motion), quality)
    quality["warnings"] = warnings(quality, dict(zip(machine.names, machine.rotary, strict=True)))
    twin = Twin(
        machine=machine,
        effects=plant.effects,
        theta=plant.theta,
        covariance=plant.fit.covariance,
        parameters=table,
        pi=plant.pi,
        quality=quality,
        data=[_provenance(item, motion) for item in logs],
        settings=_settings(machine, motion),
        groups=plant.fit.group_names(),
    )
    twin = _with_loops(twin, motion, logs if loop and motion.qr is not None else [], tell, springs)
    return replace(twin, misfit=misfit_of(twin, motion))


def _as_logged(machine: Machine, logs: Sequence[Log], resample: float | None) -> Machine:
    """Return the machine as its logs show it: on the clock asked for, joints that nothing measured locked."""
    if resample is not None:
        machine = replace(machine, data=replace(machine.data, resample=resample))
    seen = all(_sees_passive(machine, item) for item in logs)
    return machine if seen else machine.with_rigid_joints()


def _with_leads(
    machine: Machine, prepared: Callable[[Machine], Motion], consistent: bool, loop: bool
) -> tuple[Machine, Motion, Plant, dict[str, Any]]:
    """Return machine, motion and plant with the leads of the efforts that are significant, and all leads.

    A lead that machine.yaml gives is believed, and an axis that lists a delay has it there; a passive joint's
    vibration is no place to look for others. Where a closed loop is identified as well, leads are told but left
    in: the loop goes round by the channels as they were logged, and the black box did not bear it otherwise
    (measured on EMPS).
    """
    motion = prepared(machine)
    plant = _plant(machine, motion, consistent)
    given = {name: axis.lead for name, axis in machine.axes.items() if axis.lead is not None}
    found = {} if machine.passive else find_leads(machine, plant.motion, plant)
    listed = {name for name, axis in machine.axes.items() if any(e.logged_effort for e in axis.effects)}
    found = {name: lead for name, lead in found.items() if name not in given and name not in listed}
    closed = loop and motion.qr is not None
    applied = {name: lead.seconds for name, lead in found.items() if lead.significant and not closed}
    if applied:
        axes = {name: replace(axis, lead=applied.get(name, axis.lead)) for name, axis in machine.axes.items()}
        machine = replace(machine, axes=axes)
        motion = prepared(machine)
        plant = _plant(machine, motion, consistent)
    said: dict[str, Any] = {name: {"lead": lead, "given": True} for name, lead in given.items()}
    for name, lead in found.items():
        said[name] = {"lead": lead.seconds, "standard_error": lead.error, "significant": lead.significant}
        said[name]["applied"] = name in applied
    return machine, plant.motion, plant, said


def _plant(machine: Machine, motion: Motion, consistent: bool) -> Plant:
    """Return the plant; a failure after repairs of the clock names these first."""
    try:
        return fit_plant(machine, motion, consistent_inertia=consistent)
    except DataError as error:
        clock = [note for note in motion.notes if ": t: " in note]
        if not clock:
            raise
        raise DataError(f"{clock[0]}; check the clock before anything else ({error})") from None


def _with_loops(
    twin: Twin, motion: Motion, logs: list[Log], tell: Callable[[str, float], None], springs: bool
) -> Twin:
    """Return the twin with the springs of its passive joints, if asked for, and the closed loops of its axes.

    The motors' rows leave open what moves on a passive joint: that joint's own row completes them, which
    is why the plant is not asked for consistent inertias before.
    """
    twin = with_springs(twin, motion) if springs else twin
    twin = replace(twin, diagonal=diagonal(twin, motion))
    if not logs:
        return twin
    from pinotwin.identification.loops import with_loops

    return with_loops(twin, motion, logs, lambda stage, done: tell(stage, 0.45 + 0.5 * done))


def _sees_passive(machine: Machine, log: Log) -> bool:
    """Whether the vibration of every passive joint was measured (see ``pinotwin vibration``)."""
    return all(f"{name}.v" in log or f"{name}.q" in log for name in machine.passive)


def _silent(stage: str, done: float) -> None:
    del stage, done


def _settings(machine: Machine, motion: Motion) -> dict[str, Any]:
    """Return the options of :func:`pinotwin.prepare` that prepare any log as these were."""
    return {
        "cutoff": _finite(motion.cutoff) or 0.0,
        "decimate": motion.decimation,
        "order": machine.data.order,
        "resample": machine.data.resample,
        "lead": {name: axis.lead for name, axis in machine.axes.items() if axis.lead is not None},
        "leave_out": [list(x) for x in machine.data.leave_out],
    }


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _quality(machine: Machine, motion: Motion, plant: Plant) -> dict[str, Any]:
    """Return the figures of the fit, per axis and together."""
    fit, names = plant.fit, machine.names
    problem = fit.problem
    error = problem.y - problem.W @ plant.theta
    options = fit_options(machine, plant.effects, motion)
    held = _held_out_error(problem, options)
    axes = {}
    for joint, rows in problem.slices.items():
        own = error_row(problem.y[rows], error[rows])
        axes[names[joint]] = {
            "fit": own["nrmse"],
            "fit_std": own["nrmse_std"],
            "rms": own["rms"],
            "held_out": error_row(problem.y[rows], held[rows]),
            **whiteness_row(error[rows]),
            "rows": int(rows.stop - rows.start),
        }
    found = plant.consistency
    return {
        "axes": axes,
        "relative_error": float(np.linalg.norm(error) / np.linalg.norm(problem.y)),
        "condition": float(fit.condition),
        "rank": int(fit.rank),
        "parameters": len(plant.theta),
        "not_separable": [list(group) for group in fit.group_names()],
        "consistency": None
        if found is None
        else {"moved": found.moved, "cost_ratio": _finite(found.cost_ratio)},
        "folds": FOLDS,
        "preparation": list(motion.notes),
    }


def _held_out_error(problem, options: Options):  # type: ignore[no-untyped-def]
    try:
        return held_out(problem, folds=FOLDS, options=options).error
    except DataError:
        return np.full(len(problem.y), np.nan)


def _validate(
    machine: Machine,
    plant: Plant,
    logs: Log | Sequence[Log],
    settings: dict[str, Any],
    quality: dict[str, Any],
) -> None:
    """Add the errors on logs that were not fitted."""
    motion = with_model(prepare(machine, logs, **settings), plant.effects, plant.theta)
    rows = prediction_rows(assemble(motion, plant.effects), plant.theta, machine.names)
    for name, row in rows.items():
        if name in quality["axes"]:
            quality["axes"][name]["validation"] = row
    quality["validation_source"] = motion.source


def _provenance(log: Log, motion: Motion) -> dict[str, Any]:
    return {
        "source": log.source,
        "samples": len(log),
        "rate": 1.0 / motion.step,
        "fingerprint": log.fingerprint(),
        "notes": [*log.notes, *(note.removeprefix(f"{log.source}: ") for note in motion.notes)],
    }


def nominal_twin(machine: Machine) -> Twin:
    """Return the twin of a machine as described: CAD inertias, every other coefficient zero."""
    effects = machine.effects
    options = fit_options(machine, effects)
    assert options.prior is not None
    theta = options.prior.mean
    return Twin(
        machine=machine,
        effects=effects,
        theta=theta,
        covariance=np.zeros((len(theta), len(theta))),
        parameters=(),
        pi=parameters(machine.model),
    )
