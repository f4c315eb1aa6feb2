"""A payload as a body that can exist: mass, centre of mass and inertia, with intervals, added to a link or taken off.

The numbers are the change of the link's own parameters; ten free ones would imitate much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import (
    BODY_NAMES,
    body_count,
    dynamic_parameters,
    parameters,
    pseudo_inertia,
    with_parameters,
)
from pinotwin.twin import Twin

LEAST = 1e-3  # Mass that stays on a link from which more was taken off than the model has there [kg]
UNKNOWN = 0.3  # Standard error from which a centre of mass is not determined [m]


def centre_of(pi: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return centre of mass in the frame of the joint and its standard errors [m], shape (3,) each.

    From the ten parameters [m, m c, I ...] that were found; errors are inf where the mass is not determined.
    """
    m = float(pi[0])
    if abs(m) < 2.0 * float(np.sqrt(max(covariance[0, 0], 0.0))) or m == 0.0:
        return np.zeros(3), np.full(3, np.inf)
    c = pi[1:4] / m
    J = np.concatenate([-c[:, None], np.eye(3)], axis=1) / m  # derivative of m c / m by [m, m c]
    return c, np.sqrt(np.maximum(np.diag(J @ covariance[:4, :4] @ J.T), 0.0))


def possible(pi: Floats, covariance: Floats, model: pin.Model, *, removal: bool) -> bool:
    """Whether a body added, or on ``removal`` taken off, can have these parameters, by two standard errors.

    A mass is positive unless taken off, and then no heavier than the machine; its centre lies no farther off than that.
    """
    centre, spread = centre_of(pi, covariance)
    if not np.isfinite(spread).all():
        return True
    m, error = float(pi[0]), float(np.sqrt(max(covariance[0, 0], 0.0)))
    whole = sum(body.mass for body in model.inertias)
    if m < 0.0 and (not removal or -m - 2.0 * error > whole):
        return False
    return float(np.linalg.norm(centre)) - 2.0 * float(np.linalg.norm(spread)) <= reach(model)


def reach(model: pin.Model) -> float:
    """Return how far a machine may carry something from a joint [m]: its own length, a metre at least."""
    return max(1.0, float(sum(np.linalg.norm(p.translation) for p in model.jointPlacements)))


def physical(pi: Floats) -> Floats:
    """Return the ten parameters (m, m c, I about the joint; negative of a body taken off) of the nearest possible body.

    Mass and centre, which a motion tells best, are kept; about that its second moments have no negative eigenvalue
    (Wensing et al. 2018, doi:10.1109/LRA.2017.2729659). Both have shape (10,).
    """
    sign = -1.0 if pi[0] < 0.0 else 1.0
    body = sign * np.asarray(pi, dtype=float)
    m = float(body[0])
    if m == 0.0:
        return np.zeros(10)
    h = body[1:4]
    J, apart = pseudo_inertia(body), np.outer(h, h) / m
    values, axes = np.linalg.eigh(J[:3, :3] - apart)
    J[:3, :3] = (axes * np.maximum(values, 0.0)) @ axes.T + apart
    return sign * dynamic_parameters(J)


def plain_body(numbers: Floats) -> Floats:
    """Return the ten parameters of a body from mass, first moments and one inertia about all axes, those first (5,)."""
    m, x, y, z, inertia = numbers[:5]
    return np.array([m, x, y, z, inertia, 0.0, inertia, 0.0, 0.0, inertia])


def found_body(theta: Mapping[str, float]) -> Floats:
    """Return the ten parameters of a named payload, as a body that can exist."""
    return physical(np.array([theta[name] for name in BODY_NAMES]))


def loaded(model: pin.Model, joint: str, pi: Floats) -> pin.Model:
    """Return a model with a body added to the link that a joint moves, or taken off it."""
    values = parameters(model)
    at = 10 * (model.getJointId(joint) - 1)
    whole = values[at : at + 10] + pi
    whole[0] = max(float(whole[0]), LEAST)
    values[at : at + 10] = physical(whole)
    return with_parameters(model, values)


def loaded_twin(twin: Twin, axis: str, pi: Floats) -> Twin:
    """Return a twin with a body added to the link of an axis, or taken off it."""
    machine = twin.machine
    joint = machine.axis(axis).joint
    at = 10 * (machine.model.getJointId(joint) - 1)
    more = np.zeros(10 * body_count(machine.model) + machine.nv)
    more[at : at + 10] = pi
    theta = twin.theta.copy()
    theta[twin.slices[twin.keys.index("rigid_body")]] += machine.base.from_standard(more)
    return replace(twin, theta=theta, pi=parameters(loaded(twin.model, joint, pi)))
