"""A payload that was found, put into the numbers of a machine or a twin: a body on a link, or one taken off it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import BODY_NAMES, body_count, parameters, pseudo_inertia, with_parameters
from pinotwin.twin import Twin

LEAST = 1e-3  # Mass that stays on a link from which more was taken off than the model has there [kg]


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
    second = pseudo_inertia(body)[:3, :3] - np.outer(h, h) / m
    values, axes = np.linalg.eigh(second)
    about = (axes * np.maximum(values, 0.0)) @ axes.T + np.outer(h, h) / m
    inertia = np.trace(about) * np.eye(3) - about
    tensor = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return sign * np.concatenate([[m], h, tensor])


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
