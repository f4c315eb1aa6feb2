"""The standard parameters of a machine as one vector, and back.

    pi = [m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz] of joint 1, ... joint N, [Ja_1 ... Ja_nv]

In Pinocchio's order, about the joint frame; products of inertia are tensor elements, I_xy = -∫ x y dm. The reflected
rotor inertia of every velocity (``model.armature``) adds to the joint's inertia and carries no weight. All that needs
a model with one coordinate per velocity, or whole logs, checks it here.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, MachineError


def require_simple(model: pin.Model) -> None:
    """Refuse a model with a joint whose coordinates are not as many as its velocities (nq != nv)."""
    mimics = [n for n, j in zip(model.names, model.joints, strict=True) if "Mimic" in j.shortname()]
    if mimics:
        raise MachineError(
            f"machine {model.name!r}: mimic joints {mimics} are not supported; load the URDF with "
            "mimic=False and describe the coupling in machine.yaml"
        )
    if model.nq != model.nv:
        odd = [n for n, j in zip(model.names, model.joints, strict=True) if j.nq != j.nv]
        raise MachineError(
            f"machine {model.name!r}: joints {odd} have nq != nv; rewrite 'continuous' as "
            "'revolute' with wide limits, and lock or remove floating, planar and spherical joints"
        )


def as_log(model: pin.Model, **arrays: Floats) -> list[Floats]:
    """Return arrays of shape (n, nv), all of one n, as C-contiguous floats; others are refused by their name."""
    require_simple(model)
    out: list[Floats] = []
    for name, values in arrays.items():
        x = np.ascontiguousarray(values, dtype=float)
        if x.ndim != 2 or x.shape[1] != model.nv:
            raise DataError(
                f"{name} has shape {x.shape}, expected (n, {model.nv}): one row per sample, one "
                f"column per joint of {model.name!r}"
            )
        if out and len(x) != len(out[0]):
            first = next(iter(arrays))
            raise DataError(f"{name} has {len(x)} rows but {first} has {len(out[0])}")
        out.append(x)
    return out


def require_depth_first(model: pin.Model) -> None:
    """Refuse joints out of depth-first order: ``pin.crba`` would be wrong without a word."""
    for i in range(2, model.njoints):
        above = i - 1
        while above > model.parents[i]:
            above = model.parents[above]
        if above != model.parents[i]:
            raise MachineError(
                f"machine {model.name!r}: joint {model.names[i]!r} is not in depth-first order; "
                "add the joints branch by branch, or load the machine from a URDF"
            )


BODY_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
BODY_UNITS = ("kg", *["kg·m"] * 3, *["kg·m²"] * 6)


def body_count(model: pin.Model) -> int:
    """Return the number of moving bodies, one per joint (the universe is not one)."""
    return int(model.njoints) - 1


def parameter_count(model: pin.Model) -> int:
    """Return the length of ``pi``: ten per joint and one rotor inertia per velocity."""
    return 10 * body_count(model) + int(model.nv)


def parameters(model: pin.Model) -> Floats:
    """Return ``pi`` of a model [kg, kg·m, kg·m²; rotor inertia kg or kg·m²], shape (p,)."""
    bodies = [model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]
    return np.concatenate([*bodies, np.asarray(model.armature, dtype=float)])


def with_parameters(model: pin.Model, pi: Floats) -> pin.Model:
    """Return a copy of the model with ``pi``, shape (p,); MachineError: another length, moments without mass."""
    values = np.asarray(pi, dtype=float)
    if values.shape != (parameter_count(model),):
        raise MachineError(
            f"machine {model.name!r}: pi has shape {values.shape}, expected ({parameter_count(model)},)"
        )
    copy = model.copy()
    for i in range(1, model.njoints):
        body = np.ascontiguousarray(values[10 * (i - 1) : 10 * i])
        if body[0] != 0.0:
            copy.inertias[i] = pin.Inertia.FromDynamicParameters(body)
            continue
        if np.any(body[1:4]):
            raise MachineError(
                f"joint {model.names[i]!r}: first moments {body[1:4]} without mass; give the body a mass"
            )
        xx, xy, yy, xz, yz, zz = body[4:]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        copy.inertias[i] = pin.Inertia(0.0, np.zeros(3), tensor)
    copy.armature = values[10 * body_count(model) :]
    return copy


def parameter_names(model: pin.Model) -> tuple[str, ...]:
    """Return the names of ``pi``: ``m_Z``, ``mx_B``, ``Ixx_C``, ``Ja_Z``...; rotors of one joint are numbered."""
    joints = list(zip(model.joints, model.names, strict=True))[1:]
    bodies = [f"{part}_{name}" for _, name in joints for part in BODY_NAMES]
    return (*bodies, *(f"Ja_{n}{k}" if j.nv > 1 else f"Ja_{n}" for j, n in joints for k in range(j.nv)))


def parameter_units(model: pin.Model) -> tuple[str, ...]:
    """Return the units of ``pi``; a rotor inertia is in kg on a slide, in kg·m² on a rotation."""
    rotor = ["kg·m²" if turns else "kg" for turns in rotary(model)]
    return (*BODY_UNITS * body_count(model), *rotor)


def joint_axis(model: pin.Model, joint: int) -> tuple[bool, Floats]:
    """Return whether a joint of one degree of freedom turns, and its unit axis in its own frame, shape (3,)."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, np.zeros(kind.nq), np.zeros(kind.nv))
    S = np.asarray(data.S).reshape(6)
    turns = bool(np.any(S[3:]))
    return turns, S[3:] if turns else S[:3]


def rotary(model: pin.Model) -> tuple[bool, ...]:
    """Return for every velocity whether it is a rotation [rad/s] rather than a slide [m/s]."""
    require_simple(model)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    J = data.J.reshape(6, model.nv)  # Pinocchio drops the last axis if nv is 1
    return tuple(bool(np.linalg.norm(column[3:]) > 0.5) for column in J.T)


# pseudo-inertia of each parameter alone at one
BASIS = np.array([pin.PseudoInertia.FromDynamicParameters(alone).toMatrix() for alone in np.eye(10)])


def pseudo_inertia(pi: Floats) -> Floats:
    """Return the pseudo-inertia of ten parameters, (..., 10) to (..., 4, 4).

        J = [[Sigma, h], [h', m]],   Sigma = tr(I)/2 E - I   [kg·m², kg·m; kg·m, kg]

    Positive semidefinite exactly when some distribution of mass has them (Wensing, Kim & Slotine 2018,
    doi:10.1109/LRA.2017.2729659).
    """
    return np.tensordot(pi, BASIS, 1)


def dynamic_parameters(J: Floats) -> Floats:
    """Return the ten parameters of a pseudo-inertia, (4, 4) to (10,)."""
    xx, yy, zz = np.trace(J[:3, :3]) - np.diag(J[:3, :3])
    return np.array([J[3, 3], *J[:3, 3], xx, -J[0, 1], yy, -J[0, 2], -J[1, 2], zz])
