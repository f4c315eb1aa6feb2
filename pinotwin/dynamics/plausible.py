"""The bodies of a URDF as they are believed before any log: inertias that can exist, and rods for those made up."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Mask
from pinotwin.dynamics.parameters import body_count, dynamic_parameters, parameters, pseudo_inertia


def plausible(model: pin.Model, acting: Mask) -> tuple[Floats, Mask]:
    """Return standard parameters, shape (p,), with which all ``acting`` bodies can exist, and which are dummies."""
    # Dummies have no mass, a negative or a huge moment of inertia, or all are alike or of 1 kg.
    pi, count = parameters(model), body_count(model)
    bodies = pi[: 10 * count].reshape(-1, 10)
    some = bodies[acting]
    alike = len(some) > 2 and np.allclose(some, some[0], rtol=1e-6, atol=1e-9 * np.abs(some[0]).max())
    ones = len(some) > 1 and np.allclose(some[:, 0], 1.0, rtol=0.0, atol=1e-9)
    wide = np.isin(list(model.names[1:]), list(oversized_bodies(model)))
    moments = np.array([np.linalg.eigvalsh(body.inertia) for body in model.inertias[1:]])
    negative = moments[:, 0] < -0.01 * np.abs(moments[:, -1]) - 1e-12
    dummy = acting & (alike | ones | (bodies[:, 0] <= 0.0) | wide | negative)
    for k in np.flatnonzero(acting):
        bodies[k] = _rod(model, int(k) + 1) if dummy[k] else _possible(bodies[k])
    return pi, dummy


def oversized_bodies(model: pin.Model, times: float = 10.0) -> dict[str, tuple[float, float]]:
    """Return the joints that move a body far wider than the machine: its radius of gyration, the machine's size [m]."""
    places = [*model.jointPlacements[2:], *(pin.SE3(np.eye(3), body.lever) for body in model.inertias[1:])]
    size = max(1.0, sum(float(np.linalg.norm(place.translation)) for place in places))
    bodies = zip(map(str, model.names[1:]), model.inertias[1:], strict=True)
    wide = {name: float(np.sqrt(np.abs(x.inertia).max() / x.mass)) for name, x in bodies if x.mass > 0.0}
    return {name: (radius, size) for name, radius in wide.items() if radius > times * size}


def _possible(body: Floats, least: float = 0.02, point: float = 0.01) -> Floats:
    """Return ten parameters that can exist; a body without any spread gets that of ``point`` [m²]."""
    J = pseudo_inertia(body)
    mass, centre = J[3, 3], J[:3, 3] / J[3, 3]
    spread, axes = np.linalg.eigh(J[:3, :3] - mass * np.outer(centre, centre))
    largest = spread[-1] if spread[-1] > 1e-9 * mass * point else mass * point
    J[:3, :3] = (axes * np.maximum(spread, least * largest)) @ axes.T + mass * np.outer(centre, centre)
    return dynamic_parameters(J)


def _rod(model: pin.Model, joint: int, radius: float = 0.06, density: float = 1000.0) -> Floats:
    """Return the ten parameters of a cylinder from a joint to the next on it, at least a diameter long [m, kg/m³]."""
    children = [i for i in range(joint + 1, model.njoints) if model.parents[i] == joint]
    way = model.jointPlacements[children[0]].translation if children else np.array([0.0, 0.0, radius])
    reach = float(np.linalg.norm(way))
    axis = way / reach if reach > 1e-6 else np.array([0.0, 0.0, 1.0])
    length = max(reach, 2.0 * radius)
    mass = density * np.pi * radius**2 * length
    along, across = np.outer(axis, axis), np.eye(3) - np.outer(axis, axis)
    tensor = mass * (radius**2 / 2.0 * along + (radius**2 / 4.0 + length**2 / 12.0) * across)
    return np.asarray(pin.Inertia(mass, way / 2.0, tensor).toDynamicParameters())
