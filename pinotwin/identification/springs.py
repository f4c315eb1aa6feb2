r"""The equation of a passive joint: its spring, its damper, and what of its body no motor sees.

Without a measured effort theta = 0 would solve its row among the motors', so it comes second, alone, with their beta_1
as the ruler for force (thesis Section 7.2; the source leaves the spring implicit):

    W_d(q, v, a) beta + k q_d + c v_d = 0,      beta ~ N(beta_1, cov_1),

both sides band-passed, for the slow angle is not measured. The link's own inertia about the joint, which no motor
sees, has a wide prior around the CAD value and is found here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import parameters
from pinotwin.identification.bodies import bodies_of, body_rows
from pinotwin.identification.settings import Settings
from pinotwin.motion import Motion
from pinotwin.signals.filters import vibration_band
from pinotwin.solve.bodies import Evidence, near
from pinotwin.solve.sandwich import long_run
from pinotwin.twin import OpenLoop
from pinotwin.twin.parameters import Parameters, verdict


def find_springs(plant: OpenLoop, motion: Motion, settings: Settings) -> tuple[OpenLoop, dict[str, Any]]:
    """Return the plant with springs of moving passive joints; RMS of what each leaves and of its torque [N·m or N]."""
    rows: dict[str, Any] = {}
    for joint in plant.machine.passive:
        if f"{joint}.spring" in plant.keys and np.ptp(motion.v[:, motion.index(joint)]) > 0.0:
            plant, rows[joint] = _find_spring(plant, motion, joint, settings)
    return plant, rows


def keep_spring(plant: OpenLoop, joint: str, spring: tuple[float, float], settings: Settings) -> OpenLoop:
    """Return the plant with a spring of the motors' rows, as doubtful as the CAD, and CAD for what no motor sees.

    ``spring`` is its stiffness and damping [N·m/rad or N/m, N·m·s/rad or N·s/m].
    """
    mean, precision = _prior(plant, settings.cad_doubt)
    k = len(mean) - 2
    cov = np.zeros_like(precision)
    cov[:k, :k] = np.linalg.inv(precision[:k, :k])
    cov[k:, k:] = np.diag((settings.cad_doubt * np.array(spring)) ** 2)
    return _updated(plant, joint, np.append(mean[:k], spring), cov, settings)


def _find_spring(
    plant: OpenLoop, motion: Motion, joint: str, settings: Settings, memory: float = 0.25
) -> tuple[OpenLoop, dict[str, float]]:
    """Return the plant with a joint's spring, RMS of rest and torque; residuals correlate for ``memory`` [s]."""
    machine = plant.machine
    index, base = machine.passive[joint].index, machine.base
    W = base.regressor(machine.model, motion.q, motion.v, motion.a)[:, index]
    rows = []
    for part in motion.segments:
        spring = np.stack([_angle(motion, part, index), motion.v[part, index]], axis=1)
        rows.append(vibration_band(np.hstack([W[part], spring]), 1.0 / motion.step))
    X = np.concatenate(rows)
    mean, precision = _prior(plant, settings.cad_doubt)
    lag, sigma = max(1, round(memory / motion.step)), 1.0
    for _ in range(4):
        A = X.T @ X / sigma**2 + precision
        theta = np.asarray(np.linalg.solve(A, precision @ mean), dtype=float)
        e = X @ theta
        # independent noise is worth fewer samples when it is correlated
        sigma = float(np.sqrt(np.mean(e**2) * min(lag, len(e) // 20)))
    inverse = np.linalg.inv(A)
    cov = inverse @ (long_run(X * e[:, None] / sigma**2, lag) + precision) @ inverse
    load = float(np.sqrt(np.mean((X[:, -2] * theta[-2]) ** 2)))
    left = float(np.sqrt(np.mean(e**2)))
    return _updated(plant, joint, theta, cov, settings), {"residual": left, "load": load}


def _angle(motion: Motion, part: slice, index: int) -> Floats:
    """Return the angle of a joint; the integral of its velocity where it was not measured."""
    q: Floats = motion.q[part, index]
    if np.ptp(q) > 0.0:
        return q
    spline = scipy.interpolate.CubicSpline(motion.step * np.arange(len(q)), motion.v[part, index])
    return np.asarray(spline.antiderivative()(spline.x), dtype=float)


def _prior(plant: OpenLoop, doubt: float, least: float = 0.02) -> tuple[Floats, Floats]:
    """Return mean and precision of (beta, k, c): the motors' rows, and CAD within ``doubt`` or ``least`` of a unit."""
    machine = plant.machine
    at = plant.slices[plant.keys.index("rigid_body")]
    cad = machine.base.from_standard(parameters(machine.model))
    units = np.array(machine.base.units)
    size = np.array([np.abs(cad[units == u]).max() for u in units])
    wide = (doubt * np.maximum(np.abs(cad), np.maximum(least * size, 1e-6))) ** -2.0
    table = {p.name: p for p in plant.parameters}
    seen = np.array([table[f"rigid_body.{label}"].determined for label in machine.base.labels])
    precision = np.diag(np.append(wide, [1e-12, 1e-12]))
    mean = np.append(cad, [0.0, 0.0])
    b = np.flatnonzero(seen)
    cov = plant.covariance[at, at][np.ix_(b, b)]
    scale = 1.0 / np.sqrt(np.diag(cov))
    own = np.linalg.pinv(cov * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    right = precision @ mean
    precision[np.ix_(b, b)] += own
    right[b] += own @ plant.theta[at][b]
    return np.linalg.solve(precision, right), precision


def _updated(plant: OpenLoop, joint: str, theta: Floats, cov: Floats, settings: Settings) -> OpenLoop:
    """Return the plant with the rigid body and the spring of the joint's own row."""
    machine, base = plant.machine, plant.machine.base
    rigid = plant.slices[plant.keys.index("rigid_body")]
    spring = plant.slices[plant.keys.index(f"{joint}.spring")]
    b = len(base)
    scale = np.sqrt(np.diag(cov)[:b])
    correlation = cov[:b, :b] / np.outer(scale, scale)
    factor = np.linalg.cholesky(np.linalg.inv(correlation)).T / scale
    free = np.full(b, np.inf)
    evidence = Evidence(factor, factor @ theta[:b], theta[:b], np.arange(b), -free, free)
    bodies, dummy = bodies_of(machine)
    found = near(evidence, bodies, settings.urdf_rows[0])
    whole, full = plant.theta.copy(), plant.covariance.copy()
    whole[rigid], whole[spring] = found.theta, np.maximum(theta[b:], 0.0)
    for at, own in ((rigid, slice(0, b)), (spring, slice(b, b + 2))):
        full[at, :] = full[:, at] = 0.0
        full[at, at] = cov[own, own]
    errors = np.sqrt(np.maximum(np.diag(cov), 0.0))
    names = [*(f"rigid_body.{n}" for n in base.labels), f"{joint}.spring.k", f"{joint}.spring.c"]
    values = np.concatenate([whole[rigid], whole[spring]])
    rows = {p.name: p for p in plant.parameters}
    for name, value, error in zip(names, values.tolist(), errors.tolist(), strict=True):
        word = verdict(value, error, at_bound=False)
        rows[name] = replace(rows[name], value=value, error=error, determined=True, verdict=word, dof=np.inf)
    said = body_rows(machine, found, dummy, 1.0, settings)
    parameters = Parameters(rows.values())
    return replace(plant, theta=whole, covariance=full, parameters=parameters, pi=found.pi, bodies=said)
