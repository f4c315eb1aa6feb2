"""``identify``: logs to twin (thesis Fig. 4-6), with progress and with its own judgement."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import diagonal
from pinotwin.arrays import Ints
from pinotwin.columns import bind
from pinotwin.dynamics.parameters import parameters
from pinotwin.effects.scene import without_model
from pinotwin.errors import DataError
from pinotwin.identification.assemble import assemble
from pinotwin.identification.bending import Bending, bend_all, bending_warnings, bends, find_bending, holds
from pinotwin.identification.bodies import near_urdf
from pinotwin.identification.friction import at_one_speed, friction_scatter
from pinotwin.identification.judge import CrossValidated, judge, warnings
from pinotwin.identification.lead import find_leads
from pinotwin.identification.loops import ClosedLoops, close_loops
from pinotwin.identification.misfit import misfit_of
from pinotwin.identification.plant import Plant, fit_plant, open_loop
from pinotwin.identification.scale import Sizes, with_sizes
from pinotwin.identification.settings import USUAL, Settings, Tell
from pinotwin.identification.smooth import memory
from pinotwin.identification.springs import find_springs, keep_spring
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.logs.prepare import EvenLogs, prepare
from pinotwin.logs.quality.recorded import habits
from pinotwin.machine import Machine, MachineLike, as_machine
from pinotwin.motion import Motion
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin import OpenLoop, Twin
from pinotwin.twin.moments import Moments


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
    report: Tell | None = None,
    springs: bool = True,
    effects: Iterable[Any] | Mapping[str, Iterable[Any]] = (),
    settings: Settings = USUAL,
) -> Twin:
    """Find the model of a machine in its logs: all axes in one problem, what two axes share once.

    Args:
        machine: what is believed about it; or its folder, URDF or bundled name, or a ``pin.Model``.
        log: servo log(s) to fit, or their files.
        validate: log(s) to judge on; without them the judgement is on held-out blocks.
        loop: also identify the closed loops of the axes whose command is logged.
        consistent: require inertias that a real body could have.
        cutoff: corner of the zero-phase low-pass [Hz]; chosen from the data when None.
        decimate: fit one row in so many; chosen from the corner when None.
        resample: rate of the even clock to put the logs on [Hz]; theirs when None.
        report: called with the stage and the share done.
        springs: also find those of passive joints; not where their vibration was predicted from springs.
        effects: what is fitted beside what the machine lists, see :meth:`pinotwin.Machine.listing`.
        settings: the numbers by which it decides.

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the logs hold too little to identify anything.
    """
    tell = report or (lambda stage, done: None)
    tell("preparing the log", 0.02)
    machine, logs, sizes = _as_logged(as_machine(machine), effects, given := as_logs(log), resample, settings)
    tell("fitting the plant", 0.1)
    bending = find_bending(machine, logs, settings)
    even = EvenLogs.of(machine, bend_all(bending, logs), machine.data)
    even.require_long()
    fitted = functools.partial(_plant, even=even, cutoff=cutoff, decimate=decimate, settings=settings)
    machine, fit, leads = _with_leads(machine, fitted, loop)
    tell("judging the plant", 0.4)
    later = _unseen(machine, validate, bending, preparation := _preparation(machine, fit.motion))
    fit, validated, price = _with_bodies(machine, fit, consistent, even.whose, settings)
    fit, sums = at_one_speed(machine, fit, settings)
    plant = open_loop(machine, fit)
    quality = judge(machine, fit, plant, validated, later)
    quality |= {"consistency": price, "leads": leads, "one_speed": sums, "sizes": sizes.axes}
    plant, quality["springs"] = _completed(plant, fit.motion, springs, bending, settings)
    closed = ClosedLoops(plant)
    if loop and fit.motion.qr is not None:
        closed = close_loops(plant, fit.motion, even, tell, settings)
    closed = replace(closed, plant=sizes.stated(closed.plant))
    said = [*sizes.notes(machine), *warnings(quality, plant, fit.motion, settings), *closed.warnings]
    quality["warnings"] = [*bending_warnings(bending), *said]
    data = [provenance(raw, bound, fit.motion) for raw, bound in zip(given, logs, strict=True)]
    return _twin(closed, fit, validated, settings, quality, data=data, settings=preparation)


def _twin(
    closed: ClosedLoops, fit: Plant, known: CrossValidated, by: Settings, quality: Any, **rest: Any
) -> Twin:
    """Return the twin of a plant and its loops, with what it keeps of its logs."""
    plant, motion, linear, problem = closed.plant, fit.motion, fit.fit, known.problem
    if not known.serves(plant.effects, motion):  # loops changed the effects
        problem = assemble(plant.scene(without_model(motion)), plant.effects, known.rows)
    log, N = known.log[known.rows.sample[problem.time]], linear.factor.T @ linear.factor
    parts, lags = [problem.rows(log == k) for k in np.unique(log)], memory(motion)
    scores, pi = N @ linear.covariance @ N, parameters(plant.machine.model)
    moments = Moments.of(parts, plant.machine.nv, plant.theta, lags, scores, linear.dof, pi)
    days = friction_scatter(plant, moments, linear.sigma)
    return closed.twin(
        quality={**quality, "days": days, **closed.quality},
        groups=linear.group_names(),
        misfit=misfit_of(plant, motion, known, by),
        moments=moments,
        **rest,
    )


def _with_bodies(
    machine: Machine, fit: Plant, consistent: bool, log: Ints, settings: Settings
) -> tuple[Plant, CrossValidated, dict[str, Any] | None]:
    """Return the plant with bodies near the URDF's if asked for, its rows part by part, and the price of bodies."""
    validated = CrossValidated.of(machine, fit.effects, fit.motion, (fit.rows, fit.fit), settings.folds, log)
    if not consistent or machine.passive:  # a passive joint's own row completes its bodies, see find_springs
        return fit, validated, None
    return near_urdf(machine, fit, validated, settings)


def _unseen(
    machine: Machine, validate: Any, bending: Bending | None, settings: Mapping[str, Any]
) -> Motion | None:
    """Return the motion of the logs to judge on; None where there are none."""
    logs = [] if validate is None else [bind(log, machine.columns) for log in as_logs(validate, "validate")]
    return prepare(machine, bend_all(bending, logs), **settings) if logs else None


def _as_logged(
    machine: Machine, effects: Any, raw: list[Log], resample: float | None, settings: Settings
) -> tuple[Machine, list[Log], Sizes]:
    """Return the machine as its bound logs show it, unmeasured joints locked, and what a unit of effort is."""
    machine = machine.listing(effects)
    if resample is not None:
        machine = replace(machine, data=replace(machine.data, resample=resample))
    unsized = {name: replace(column, found=0.0) for name, column in machine.columns.items()}
    logs = [bind(log, unsized) for log in raw]
    seen = bends(machine, logs) or all(holds(log, name) for log in logs for name in machine.passive)
    machine, sizes = with_sizes(machine if seen else machine.with_rigid_joints(), logs, settings)
    return machine, [bind(log, machine.columns) for log in logs], sizes


def _completed(
    plant: OpenLoop, motion: Motion, springs: bool, bending: Bending | None, settings: Settings
) -> tuple[OpenLoop, dict[str, Any]]:
    """Return the plant with the springs of its passive joints, if asked for, and its diagonal; and their fit."""
    rows: dict[str, Any] = {}
    for spring in () if bending is None else bending.springs:
        plant = keep_spring(plant, spring.name, (spring.stiffness, spring.damping), settings)
    if springs and bending is None:
        plant, rows = find_springs(plant, motion, settings)
    return replace(plant, diagonal=diagonal(plant, motion)), rows


def _with_leads(
    machine: Machine, fitted: Callable[[Machine], Plant], loop: bool
) -> tuple[Machine, Plant, dict[str, Any]]:
    """Return machine and plant with the leads of the efforts that are significant, and all leads.

    One given in machine.yaml, or listed as a delay, is believed; a passive joint's vibration shows none. With a closed
    loop leads are told but left in: it goes round by the channels as they were logged.
    """
    plant = fitted(machine)
    given = {name: axis.lead for name, axis in machine.axes.items() if axis.lead is not None}
    found = {} if machine.passive else find_leads(machine, plant)
    listed = {name for name, axis in machine.axes.items() if any(e.logged_effort for e in axis.effects)}
    found = {name: row for name, row in found.items() if name not in given and name not in listed}
    closed = loop and plant.motion.qr is not None
    applied = {name: row["lead"] for name, row in found.items() if row["significant"] and not closed}
    if applied:
        axes = {name: replace(axis, lead=applied.get(name, axis.lead)) for name, axis in machine.axes.items()}
        machine = replace(machine, axes=axes)
        plant = fitted(machine)
    said: dict[str, Any] = {name: {"lead": lead, "given": True} for name, lead in given.items()}
    said |= {name: {**row, "applied": name in applied} for name, row in found.items()}
    return machine, plant, said


def _plant(
    machine: Machine, even: EvenLogs, cutoff: float | None, decimate: int | None, settings: Settings
) -> Plant:
    """Return the plant; a failure after repairs of the clock names these first."""
    motion = even.motion(machine, cutoff=cutoff, decimate=decimate)
    try:
        return fit_plant(machine, motion, settings)
    except DataError as error:
        clock = [note for note in motion.notes if ": t: " in note]
        if not clock:
            raise
        raise DataError(f"{clock[0]}; check the clock before anything else ({error})") from None


def _preparation(machine: Machine, motion: Motion) -> dict[str, Any]:
    """Return the options of :func:`pinotwin.prepare` that prepare any log as these were."""
    return {
        "cutoff": float(motion.cutoff) if np.isfinite(motion.cutoff) else 0.0,
        "decimate": motion.decimation,
        "order": machine.data.order,
        "resample": machine.data.resample,
        "lead": {name: axis.lead for name, axis in machine.axes.items() if axis.lead is not None},
        "leave_out": [list(x) for x in machine.data.leave_out],
    }


def provenance(log: Log, bound: Log, motion: Motion) -> dict[str, Any]:
    """Return what a twin says of a log that it was fitted to, as it was read and with its columns bound."""
    return {
        "source": log.source,
        "samples": len(log),
        "rate": 1.0 / motion.step,
        "fingerprint": log.fingerprint(),
        "recorded": habits(bound, motion.names),
        "notes": [*log.notes, *(note.removeprefix(f"{log.source}: ") for note in motion.notes)],
    }
