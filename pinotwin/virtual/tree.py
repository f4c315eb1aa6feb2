"""From a URDF to a :class:`~pinotwin.virtual.rigid.Tree`, and what the truth does to it.

The shipped URDF is what CAD believes. The simulated truth moves every mass, centre of mass and
inertia by a pseudo-inertia congruence ``J -> A J A^T`` (Wensing et al. 2018,
doi:10.1109/LRA.2017.2729659): any regular ``A`` keeps a body physically possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import MachineError, nearest
from pinotwin.virtual.rigid import Tree


def load_model(urdf: Path | str, joints: Sequence[str]) -> pin.Model:
    """Return the Pinocchio model of a URDF with every joint not in ``joints`` locked at zero.

    Args:
        urdf: path of the file, or the XML text itself.
        joints: names of the joints that move.

    Raises:
        MachineError: the file cannot be read, or a joint does not exist.
    """
    text = str(urdf)
    inline = text.lstrip().startswith("<")
    where = "URDF text" if inline else text
    try:
        model = pin.buildModelFromXML(text) if inline else pin.buildModelFromUrdf(text)
    except (ValueError, RuntimeError) as error:
        raise MachineError(f"{where}: not a URDF that Pinocchio can read: {error}") from None
    known = list(model.names)[1:]
    for name in joints:
        if name not in known:
            raise MachineError(f"{where}: no joint {name!r}; {nearest(name, known)}")
    locked = [model.getJointId(name) for name in known if name not in joints]
    return pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model


def tree_of(model: pin.Model) -> Tree:
    """Return the tree of a model whose joints all have one degree of freedom."""
    nv = model.nv
    if model.njoints - 1 != nv:
        raise MachineError(f"{model.name}: virtual machines need joints of one degree of freedom")
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    rotary = np.zeros(nv, dtype=np.intp)
    axis, placement, offset, moment = (np.zeros((nv, *s)) for s in ((3,), (3, 3), (3,), (3,)))
    mass, inertia = np.zeros(nv), np.zeros((nv, 3, 3))
    for i in range(nv):
        column = pin.getJointJacobian(model, data, i + 1, pin.LOCAL).reshape(6, -1)[:, model.idx_vs[i + 1]]
        rotary[i] = int(np.linalg.norm(column[3:]) > 0.5)
        axis[i] = column[3:] if rotary[i] else column[:3]
        placement[i] = model.jointPlacements[i + 1].rotation
        offset[i] = model.jointPlacements[i + 1].translation
        body = model.inertias[i + 1]
        mass[i], moment[i] = body.mass, body.mass * body.lever
        inertia[i] = about_origin(body.mass, body.lever, body.inertia)
    parent = np.array([p - 1 for p in list(model.parents)[1:]], dtype=np.intp)
    gravity = np.array(model.gravity.linear)
    armature = np.zeros(nv)
    return Tree(parent, rotary, axis, placement, offset, mass, moment, inertia, armature, gravity)


def about_origin(mass: float, centre: Floats, inertia: Floats) -> Floats:
    """Return the inertia about the origin from that about the centre of mass, shape (3, 3)."""
    c = np.asarray(centre)
    return np.asarray(inertia) + mass * (c @ c * np.eye(3) - np.outer(c, c))


def _pseudo(mass: float, moment: Floats, inertia: Floats) -> Floats:
    J = np.empty((4, 4))
    J[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    J[:3, 3] = J[3, :3] = moment
    J[3, 3] = mass
    return J


def perturbed(tree: Tree, spread: tuple[float, float], rng: np.random.Generator) -> Tree:
    """Return the tree with inertials that are off by ``spread``, each body still possible.

    Args:
        tree: what CAD believes.
        spread: smallest and largest relative error of mass and of each gyration axis [-].
        rng: source of the errors.
    """
    mass, moment, inertia = tree.mass.copy(), tree.moment.copy(), tree.inertia.copy()
    for i in range(len(mass)):
        size = rng.uniform(*spread, 4)
        A = np.eye(4)
        # Half of the relative error each: a second moment scales with the square of a length.
        A[:3, :3] += np.diag(rng.choice((-0.25, 0.25), 3) * size[:3])
        A[:3, :3] += np.triu(rng.normal(0.0, 0.02, (3, 3)), 1) * (spread[1] > 0)
        if mass[i] > 0.0:
            gyration = np.sqrt(max(np.trace(tree.inertia[i]) / (2.0 * mass[i]), 0.0))
            A[:3, 3] = rng.normal(0.0, 0.3 * spread[1], 3) * gyration
        J = A @ _pseudo(mass[i], moment[i], inertia[i]) @ A.T
        J *= 1.0 + rng.choice((-1.0, 1.0)) * size[3]
        mass[i], moment[i] = J[3, 3], J[:3, 3]
        inertia[i] = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
    return tree._replace(mass=mass, moment=moment, inertia=inertia)


def with_payload(tree: Tree, body: int, mass: float, centre: Floats) -> Tree:
    """Return the tree with a point mass [kg] on a body, at ``centre`` [m] in its joint frame."""
    masses, moment, inertia = tree.mass.copy(), tree.moment.copy(), tree.inertia.copy()
    masses[body] += mass
    moment[body] += mass * np.asarray(centre)
    inertia[body] += about_origin(mass, np.asarray(centre), np.zeros((3, 3)))
    return tree._replace(mass=masses, moment=moment, inertia=inertia)


def tilted(tree: Tree, joint: int, angles: Floats) -> Tree:
    """Return the tree with one joint frame turned by small angles [rad] about its own axes."""
    placement = tree.placement.copy()
    placement[joint] = placement[joint] @ pin.exp3(np.asarray(angles, dtype=float))
    return tree._replace(placement=placement)


def with_hidden_joint(tree: Tree, joint: int, share: float) -> Tree:
    """Return the tree with a second joint of the same axis that carries ``share`` of the body.

    The joint and its body are split: ``1 - share`` of the inertia stays with the drive and its
    encoder, ``share`` and all that the body carries move on a joint appended behind it (a
    carriage that bends). The new joint is ``joint + 1``; later indices move up by one.
    """
    fields = {}
    for name in ("rotary", "axis", "mass", "moment", "inertia", "armature"):
        value = getattr(tree, name)
        fields[name] = np.insert(value, joint + 1, value[joint], axis=0)
    for name in ("mass", "moment", "inertia"):
        fields[name][joint] *= 1.0 - share
        fields[name][joint + 1] *= share
    fields["armature"][joint + 1] = 0.0
    fields["placement"] = np.insert(tree.placement, joint + 1, np.eye(3), axis=0)
    fields["offset"] = np.insert(tree.offset, joint + 1, np.zeros(3), axis=0)
    moved = np.where(tree.parent >= joint, tree.parent + 1, tree.parent)
    fields["parent"] = np.insert(moved, joint + 1, joint)
    return tree._replace(**fields)
