"""From a URDF to the model of the true machine, and to the arrays that the compiled loop reads.

The truth moves every body's inertia by ``J -> A J A^T`` of its pseudo-inertia (Wensing et al. 2018,
doi:10.1109/LRA.2017.2729659): any regular ``A`` keeps it physically possible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import MachineError, require
from pinotwin.virtual.rigid import Tree


def load_model(urdf: Path, joints: Sequence[str]) -> pin.Model:
    """Return the model of a URDF with every joint not in ``joints`` locked at zero, or a :class:`MachineError`."""
    try:
        model = pin.buildModelFromUrdf(str(urdf))
    except (ValueError, RuntimeError) as error:
        raise MachineError(f"{urdf}: not a URDF that Pinocchio can read: {error}") from None
    known = list(model.names)[1:]
    for name in joints:
        require(name, known, f"{urdf}: no joint", MachineError)
    locked = [model.getJointId(name) for name in known if name not in joints]
    return pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model


def axes_of(model: pin.Model) -> tuple[Ints, Floats]:
    """Return of every joint whether it turns, (nv,), and its unit axis in its own frame, (nv, 3)."""
    if model.njoints - 1 != model.nv:
        raise MachineError(f"{model.name}: virtual machines need joints of one degree of freedom")
    data, still = model.createData(), pin.neutral(model)
    full = [pin.computeJointJacobian(model, data, still, i).reshape(6, -1) for i in range(1, model.njoints)]
    own = np.array([J[:, k] for J, k in zip(full, list(model.idx_vs)[1:], strict=True)]).reshape(-1, 6)
    rotary = np.linalg.norm(own[:, 3:], axis=1) > 0.5
    return rotary.astype(np.intp), np.where(rotary[:, None], own[:, 3:], own[:, :3])


def assembled(
    model: pin.Model,
    bodies: Sequence[pin.Inertia],
    tilts: Mapping[str, Sequence[float]] | None = None,
    bends: Mapping[str, float] | None = None,
) -> pin.Model:
    """Return the model with other bodies, tilted and bending joints, and one coordinate for each joint.

    ``tilts``: joint -> small angles [rad] of its frame about its own axes; ``bends``: joint -> share of its body [-]
    that, with all that it carries, moves on a second joint of the same axis, ``<joint>~``, behind drive and encoder.
    """
    out = pin.Model()
    out.name, out.gravity = model.name, model.gravity
    carrier = [0]  # joint that carries what each joint of the model carried
    for i, (turns, axis) in enumerate(zip(*axes_of(model), strict=True), 1):
        name, body = model.names[i], bodies[i - 1]
        kind = (pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned)(*axis)
        tilt = pin.SE3(pin.exp3(np.array((tilts or {}).get(name, (0.0, 0.0, 0.0)))), np.zeros(3))
        share = (bends or {}).get(name, 0.0)
        joint = out.addJoint(carrier[model.parents[i]], kind, model.jointPlacements[i] * tilt, name)
        out.inertias[joint] = _part(body, 1.0 - share)
        if name in (bends or {}):
            joint = out.addJoint(joint, kind, pin.SE3.Identity(), f"{name}~")
            out.inertias[joint] = _part(body, share)
        carrier.append(joint)
    for name, frame in links_of(model).items():
        out.addFrame(pin.Frame(name, carrier[frame.parentJoint], frame.placement, pin.FrameType.BODY))
    return out


def _part(body: pin.Inertia, share: float) -> pin.Inertia:
    return pin.Inertia(share * body.mass, body.lever, share * body.inertia)


def links_of(model: pin.Model) -> dict[str, pin.Frame]:
    """Return the moving links of a model by name."""
    return {f.name: f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0}


def tree_of(model: pin.Model) -> Tree:
    """Return the arrays that the compiled loop reads of a model."""
    bodies, placements = list(model.inertias)[1:], list(model.jointPlacements)[1:]
    return Tree(
        np.array([p - 1 for p in list(model.parents)[1:]], dtype=np.intp),
        *axes_of(model),
        np.array([place.rotation for place in placements]),
        np.array([place.translation for place in placements]),
        np.array([body.mass for body in bodies]),
        np.array([body.mass * body.lever for body in bodies]),
        np.array([body.matrix()[3:, 3:] for body in bodies]),
        np.array(model.armature),
        np.array(model.gravity.linear),
    )


def inertia_at(model: pin.Model, q: Floats) -> Floats:
    """Return the mass matrix at a position, shape (nv, nv)."""
    return np.array(pin.crba(model, model.createData(), q))


def gravity_at(model: pin.Model, q: Floats) -> Floats:
    """Return the efforts that hold the machine still, shape (nv,)."""
    return np.array(pin.computeGeneralizedGravity(model, model.createData(), q))


def perturbed(model: pin.Model, spread: tuple[float, float], rng: np.random.Generator) -> list[pin.Inertia]:
    """Return possible bodies; mass and gyration axes are off by the smallest to largest of ``spread`` [-]."""
    out = []
    for body in list(model.inertias)[1:]:
        size = rng.uniform(*spread, 4)
        A = np.eye(4)
        # Half of the relative error each: a second moment scales with the square of a length.
        A[:3, :3] += np.diag(rng.choice((-0.25, 0.25), 3) * size[:3])
        A[:3, :3] += np.triu(rng.normal(0.0, 0.02, (3, 3)), 1) * (spread[1] > 0)
        J = body.toPseudoInertia().toMatrix()
        if body.mass > 0.0:
            gyration = np.sqrt(max(np.trace(J[:3, :3]) / body.mass, 0.0))
            A[:3, 3] = rng.normal(0.0, 0.3 * spread[1], 3) * gyration
        J = A @ J @ A.T * (1.0 + rng.choice((-1.0, 1.0)) * size[3])
        out.append(pin.PseudoInertia.FromMatrix(J).toInertia() if body.mass > 0.0 else body)
    return out
