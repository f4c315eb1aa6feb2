r"""What several logs, or one speed alone, tell of friction.

By what it differs from log to log: for each part of it a factor a log, normal about one.

``r_k = U_k d_k + e_k``, d_k ~ N(0, diag(s^2)): U_k are the courses of an axis' friction effects in log k, r_k what the
model leaves. The widths s follow by expectation and maximisation (Dempster, Laird & Rubin 1977), drawn to what real
machines show from day to day as if two more logs had shown it: a model of one log has that alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from pinotwin.arrays import Floats
from pinotwin.effects.family import FRICTION
from pinotwin.effects.layout import effect_slices
from pinotwin.identification.plant import Plant, open_loop
from pinotwin.identification.settings import Settings
from pinotwin.machine import Machine
from pinotwin.twin import OpenLoop
from pinotwin.twin.moments import Moments


def friction_scatter(
    plant: OpenLoop, moments: Moments, sigma: Floats, prior: float = 0.05, prior_logs: float = 2.0
) -> dict[str, dict[str, float]]:
    """Return axis -> friction effect -> scatter of logs over its size [1]; ``sigma`` is the rows' noise [N or N·m]."""
    out: dict[str, dict[str, float]] = {}
    correlated = moments.correlated(plant.theta, sigma)
    step = np.append(plant.theta, -1.0)
    for joint in moments.joints:
        axis = plant.machine.names[joint]
        parts = zip(plant.keys, plant.effects, plant.slices, strict=True)
        own = {k: s for k, e, s in parts if e.family is FRICTION and e.axis == axis}
        if not own:
            continue
        factors = [log.factors[joint] for log in moments.logs]
        left = [-F @ step for F in factors]
        power = sum(x @ x for x in left) / max(sum(log.rows[joint] for log in moments.logs), 1)
        courses = [np.stack([F[:, s] @ plant.theta[s] for s in own.values()], axis=1) for F in factors]
        level = np.sqrt(max(correlated * power, 1e-300))
        scaled = [(U / level, r / level) for U, r in zip(courses, left, strict=True)]
        found = widths(scaled, prior, prior_logs)
        out[axis] = {key.split(".", 1)[1]: float(x) for key, x in zip(own, found, strict=True)}
    return out


def widths(logs: Sequence[tuple[Floats, Floats]], prior: float, count: float) -> Floats:
    """Return the width of every part, (parts,), from its courses (k, parts) and what is left (k,) in each log [1]."""
    s2 = np.full(logs[0][0].shape[1], prior**2)
    if len(logs) < 2:
        return np.sqrt(s2)
    few = len(logs) / (len(logs) - 1)  # the model has seen these logs
    N, g = (np.array(x) for x in zip(*((U.T @ U, U.T @ r) for U, r in logs), strict=True))
    for _ in range(200):
        C = np.linalg.inv(N + np.diag(1.0 / s2))
        seen = few * np.einsum("kij,kj->ki", C, g) ** 2 + np.diagonal(C, axis1=1, axis2=2)
        before, s2 = s2, (count * prior**2 + seen.sum(axis=0)) / (count + len(logs))
        if (np.abs(s2 - before) <= 1e-13 * s2).all():
            break
    return np.sqrt(s2)


def at_one_speed(
    machine: Machine, plant: Plant, settings: Settings
) -> tuple[Plant, dict[str, dict[str, float]]]:
    """Return a plant that claims no part of a friction of one speed; axis -> speed, effort there, 95 % ``half`` [SI].

    It is one speed where four fifths of the travel are covered within the share ``one_speed`` of the middle one. How
    the axis turns would part dry from viscous friction, and there neither is a true law.
    """
    fit, motion, near, sums = plant.fit, plant.motion, settings.one_speed, {}
    determined, groups = fit.determined.copy(), list(fit.groups)
    pairs = list(zip(plant.effects, effect_slices(plant.effects), strict=True))
    for joint in fit.problem.slices:
        name, v, moving = motion.names[joint], motion.v[:, joint], motion.moving(joint)
        mine = [(e, s) for e, s in pairs if e.axis == name and e.depends in ("direction", "velocity")]
        if len({effect.depends for effect, _ in mine}) < 2 or not v[moving].any():
            continue
        speeds = np.sort(np.abs(v[moving]))
        slow, speed, fast = np.interp([0.1, 0.5, 0.9], np.cumsum(speeds) / speeds.sum(), speeds)
        if max(speed - slow, fast - speed) > near * speed:
            continue
        there = moving & (np.abs(v) >= slow)
        side, weights = np.sign(v[there]) / there.sum(), np.zeros(len(plant.theta))
        for effect, where in mine:
            weights[where] = side @ effect.columns(motion).values[there, 0]
        # what is left there is friction too: the fit bends it to how the axis turns
        felt = 0.0 if motion.external is None else motion.external
        left = (motion.u + felt - open_loop(machine, plant).effort(motion))[there, joint]
        own = [k for _, where in mine for k in range(where.start, where.stop)]
        determined[own] = False
        groups.append(tuple(own))
        half = stdtrit(fit.dof[own].min(), 0.975) * np.sqrt(weights @ fit.covariance @ weights)
        numbers = (side @ v[there], weights @ plant.theta + side @ left, half)
        sums[name] = dict(zip(("speed", "effort", "half"), map(float, numbers), strict=True))
    return replace(plant, fit=replace(fit, determined=determined, groups=tuple(groups))), sums
