"""By how much the logged effort of each axis is ahead of its position, found with the plant.

Most drives log a current at once beside a position that went through a filter or a bus: ``u(t) = m(t + lead)``, m the
model's, to first order ``m + lead dm/dt``: a column of the same least squares, so that the interval knows of the other
parameters. The effort is put back and the step repeated (Gauss-Newton), on rows well above standstill: how dry
friction turns is no lead. Real drives show 0.8 to 3.2 ms, joint torque sensors none that is significant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects.layout import effect_slices
from pinotwin.errors import DataError
from pinotwin.identification.assemble import Rows, choose_rows, thin
from pinotwin.identification.plant import Plant, fit_options
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import differentiate, low_pass
from pinotwin.solve.lead import put_back
from pinotwin.solve.linear import Options, linear
from pinotwin.solve.problem import Problem

_ORDER = 4  # of the low-pass that the effort went through


def find_leads(
    machine: Machine,
    plant: Plant,
    *,
    longest: float = 0.02,
    sure: float = 5.0,
    worth: float = 0.05,
    finest: float = 0.025,
    fast: float = 0.1,
) -> dict[str, dict[str, Any]]:
    """Return the lead of every axis that the log tells, from rows faster than the share ``fast`` of its top speed.

    ``lead`` is the time by which the effort is ahead of the position, negative when it comes late, beside its
    ``standard_error`` [s]. It is ``significant``, to be put back, where it is ``sure`` of these from zero, shorter than
    ``longest`` [s] (18 ms is the longest seen on a drive; more is another fault of the model) and explains the share
    ``worth`` of the residual's power. The sampling of a controller leaves a standard error of ``finest`` steps of the
    log in any case.
    """
    motion, top = plant.motion, np.abs(plant.motion.v).max(axis=0, initial=0.0)
    rows = choose_rows(replace(motion, use=np.ones_like(motion.use)))  # unbroken, to be differentiated
    usable = (motion.use & (np.abs(motion.v) > fast * top))[rows.sample]
    mask = np.concatenate([usable[:, joint] for joint in rows.joints])
    fitted = zip(plant.rows.joints, plant.rows.kept, strict=True)
    try:
        columns, motors = _columns(machine, plant, rows)
        turns, _ = _columns(machine, plant, rows, dry=True)
        problem = plant.fit.problem.rows(np.concatenate([usable[kept, joint] for joint, kept in fitted]))
        start = plant.fit.sigma[np.isin(list(plant.fit.problem.slices), list(problem.slices))]
        options = replace(fit_options(machine, plant.effects, motion), start=start)
        problem, options = _beside(problem, options, turns[mask])
        fit = linear(problem, replace(options, inference="none", sigma=start))
        before, p = fit.residual, problem.parameters
        wide, options = _beside(problem, options, columns[mask])
        found = np.zeros(len(motors))
        for inference in ("none", "none", options.inference):
            y = _efforts(machine, motion, rows, motors, found)[mask] if found.any() else wide.y
            fit = linear(replace(wide, y=y), replace(options, inference=inference, start=fit.sigma))
            found = np.clip(found + fit.theta[p:], -2.0 * longest, 2.0 * longest)
    except DataError:  # too few such rows
        return {}
    out = {}
    for motor, lead, spread in zip(motors, found, np.sqrt(np.diag(fit.covariance)[p:]), strict=True):
        name = machine.names[motor]
        own = problem.slices.get(motor)
        if name not in machine.axes or own is None or not np.isfinite(spread):
            continue
        share = 1.0 - float(np.sum(fit.residual[own] ** 2) / max(np.sum(before[own] ** 2), 1e-300))
        error = float(np.hypot(spread, finest * motion.step))
        significant = sure * error < abs(lead) < longest and share > worth
        out[name] = {"lead": float(lead), "standard_error": error, "significant": bool(significant)}
    return out


def _beside(problem: Problem, options: Options, columns: Floats) -> tuple[Problem, Options]:
    """Return a problem with more columns, shape (rows, n), without bounds."""
    p, n = problem.parameters, columns.shape[1]
    wide = problem.beside(columns, [f"column {p + k}" for k in range(n)])
    return wide, options.by_coefficient(lambda x, none: np.append(x, np.full(n, none)))


def _columns(machine: Machine, plant: Plant, rows: Rows, *, dry: bool = False) -> tuple[Floats, list[int]]:
    """Return a column a motor, the rate of its effort, or of ``dry`` friction's, in its joints; which motors."""
    ratio, motion, n = _ratio(machine), plant.motion, len(rows.sample)
    pairs = zip(plant.effects, effect_slices(plant.effects), strict=True)
    acting = [(effect, s) for effect, s in pairs if not dry or effect.depends == "direction"]
    effort = sum((effect.along(motion, plant.theta[s]) for effect, s in acting), np.zeros_like(motion.q))
    model = np.zeros((n, machine.nv))
    model[:, rows.joints] = thin(motion, effort[:, rows.joints])
    step = motion.step * motion.decimation
    edges = np.flatnonzero(np.diff(rows.block)) + 1
    blocks = [slice(int(a), int(b)) for a, b in zip(np.r_[0, edges], np.r_[edges, n], strict=True)]
    blocks = [b for b in blocks if b.stop - b.start > 3 * _ORDER]
    smooth = low_pass(model, 1.0 / step, motion.cutoff, _ORDER, blocks)
    rate = np.nan_to_num(differentiate(smooth, step, blocks)) @ np.linalg.inv(ratio)
    columns = np.concatenate([rate * ratio[:, joint] for joint in rows.joints])
    motors = [int(k) for k in np.flatnonzero(np.linalg.norm(columns, axis=0) > 0.0)]
    return columns[:, motors], motors


def _ratio(machine: Machine) -> Floats:
    return np.eye(machine.nv) if machine.transmission is None else machine.transmission


def _efforts(machine: Machine, motion: Motion, rows: Rows, motors: list[int], leads: Floats) -> Floats:
    """Return the measured efforts at the rows, those of the motors put back by their leads."""
    ratio = _ratio(machine)
    u = np.nan_to_num(motion.u) @ np.linalg.inv(ratio)
    for k, lead in zip(motors, leads, strict=True):
        for s in motion.segments if lead else ():
            u[s, k] = put_back(motion.t[s], u[s, k], lead)
    joint = u @ ratio
    if motion.external is not None:
        joint = joint + motion.external
    return thin(motion, joint[:, list(rows.joints)]).T.ravel()
